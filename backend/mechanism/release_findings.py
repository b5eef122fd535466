"""Releases that what was seen contradicts: before the first sample, amid a motion, or long before one."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from backend.mechanism.constraints import size_m
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.seen import recorded
from backend.mechanism.study import Experiment

GAP = 3.0  # intervals that a record may begin or end away from what it belongs to
FEW = 8  # still frames that tell how they move
DRIFTS = 0.04  # of the mechanism's size, or rad: what settles while it is held moves less
LEAVES, GONE = 0.01, 0.04  # of the same: between these a motion that begins gathers speed
WAITS = 2.0  # times as long as from one to the other; what is let go from rest has left at once: then it is one


def release_findings(experiment: Experiment, times: np.ndarray, mechanism: Mechanism) -> Iterator[str]:
    """Warnings that give the time and what was seen about it. times: of all that was measured, ascending [s]."""
    release, first, last = experiment.release, float(times[0]), float(times[-1])
    interval = float(np.median(np.diff(times))) if times.size > 1 else 0.0
    if release.time_s < first and (release.time_s < 0.0 or first - release.time_s > GAP * interval):
        yield (
            f"release.time_s is {release.time_s:g} s, {first - release.time_s:.3g} s before its first sample at "
            f"{first:g} s: nothing shows how it stood or moved until then. Check sign and clock"
        )
    if not release.at_rest and release.time_s + release.window_s > last:
        yield (
            f"release.window_s is {release.window_s:g} s, but its last sample comes {last - release.time_s:.3g} s "
            "after the release: the whole record says where it starts, and of a held-out one nothing is left to be "
            "foretold. Shorten the window"
        )
    if release.at_rest and release.states_a_window:
        yield (
            f"release.window_s is {release.window_s:g} s beside at_rest true, where the static frames alone say how it "
            'starts. Leave it out, or write "at_rest": false if it starts in motion'
        )
    if release.at_rest:
        yield from _moves_before(experiment, mechanism)
        if first - release.time_s <= GAP * interval:
            yield from _waits(experiment, mechanism)


def _moves_before(experiment: Experiment, mechanism: Mechanism) -> Iterator[str]:
    """Of what moves most, from the first to the last quarter of its still frames."""
    release, most, what = experiment.release.time_s, 0.0, ""
    for where, time, x, unit in recorded(experiment, mechanism):
        still = x[time < release]
        if still.size >= FEW:
            quarter = still.size // 4
            moved = abs(float(np.median(still[-quarter:]) - np.median(still[:quarter])))
            share = moved / (size_m(mechanism) if unit == "m" else 1.0)
            if share > max(most, DRIFTS):
                by = f"{1e3 * moved:.3g} mm" if unit == "m" else f"{moved:.3g} rad"
                most, what = share, f"{where} moves by {by} in its {still.size} samples before it"
    if what:
        yield (
            f"it is to be held still until its release at {release:g} s, and {what}: set release.time_s to when it was "
            'let go, or write "at_rest": false if it starts in motion'
        )


def _waits(experiment: Experiment, mechanism: Mechanism) -> Iterator[str]:
    """Of a record without still frames in which nothing moves at first: it was held, and let go later than stated."""
    release = experiment.release.time_s
    driven = experiment.inputs is not None or any(e.kind == "prescribed_motion" for e in mechanism.effects)
    begins: list[tuple[float, float, str]] = []
    for where, time, x, unit in recorded(experiment, mechanism):
        if driven or np.any(time < release) or time.size < FEW:
            return
        size = size_m(mechanism) if unit == "m" else 1.0
        smooth = np.median(np.lib.stride_tricks.sliding_window_view(x, 3), axis=1)  # of wild samples, one at a time
        time, off = time[1:-1], np.abs(smooth - np.median(x[:FEW])) / size
        left, gone = (np.flatnonzero(off > share) for share in (LEAVES, GONE))
        if left.size and gone.size:
            begins.append((float(time[left[0]]), float(time[gone[0]]), where))
            if left[0] < FEW:
                return
    if not begins:
        return
    left, gone, where = min(begins)
    gathers = gone - left
    if left - release > WAITS * gathers > 0.0:
        yield (
            f"release.time_s is {release:g} s, and nothing moves until {where} leaves at {left:.3g} s, to be away "
            f"{gathers:.2g} s later: what is let go moves at once; set release.time_s to when it was let go"
        )
