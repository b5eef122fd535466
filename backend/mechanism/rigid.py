"""Markers of one body whose distances change, and markers that exchange their names: no motion does either."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from backend.mechanism.columns import plane_axis
from backend.mechanism.constraints import size_m
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.seen import Series, seen

if TYPE_CHECKING:
    import pandas as pd

CHANGES = 0.08  # of the mechanism's size: links that bend, cameras that lean and wild noise stay below half of it
ENDS = 0.05  # of the samples, left out on each side
STILL = 0.005  # of the size: what moves less while its body moves is stuck
FEW = 10  # samples in common below which nothing is said
APART = 5.0  # times as far as either moves from one sample to the next: no motion makes them change places
NEAR = 0.3  # of how far they are apart: so near to where the other was
LASTS = 3  # samples: what is exchanged for fewer is a wild sample, which a fit leaves out


def rigid_findings(tracks: pd.DataFrame, mechanism: Mechanism) -> Iterator[str]:
    """Warnings that name the markers, their body and the time."""
    series, size = seen(tracks, mechanism), size_m(mechanism)
    axis = plane_axis(mechanism)
    swapped = [found for one, other in combinations(series, 2) if (found := _exchange(one, other, size))]
    for one, other, time in swapped:
        yield (
            f'markers "{one.marker}" and "{other.marker}" exchange their places at {time:.4g} s, from one sample to '
            "the next: their names were taken for each other from there on; exchange them in those rows"
        )
    unsure = {one.marker for pair in swapped for one in pair[:2]}
    for body in dict.fromkeys(one.body for one in series if one.body):
        its = [one for one in series if one.body == body and one.marker not in unsure]
        yield from _not_rigid(body, its, axis, size)


def _exchange(one: Series, other: Series, size: float) -> tuple[Series, Series, float] | None:
    """When two markers change places [s] between two samples, for longer than a wild sample lasts."""
    time, axes, a, b = _together(one, other)
    if time.size < FEW or not axes.any():
        return None
    a, b = a[:, axes], b[:, axes]
    apart = np.linalg.norm(a - b, axis=1)[:-1]
    steps = np.maximum(np.linalg.norm(np.diff(a, axis=0), axis=1), np.linalg.norm(np.diff(b, axis=0), axis=1))
    crossed = np.maximum(np.linalg.norm(a[1:] - b[:-1], axis=1), np.linalg.norm(b[1:] - a[:-1], axis=1))
    usual = float(np.quantile(steps, 0.9))
    jumps = np.flatnonzero((crossed < NEAR * apart) & (apart > APART * usual) & (apart > STILL * size))
    ends = np.append(jumps, time.size - 1)
    for at, following in zip(jumps, ends[1:], strict=False):
        if following - at >= LASTS:
            return one, other, float(time[at + 1])
    return None


@dataclass(frozen=True)
class Changing:
    """Two markers of one body whose distance changes: between which [m], and since when it is no longer what it was
    [s]; None where it comes and goes.
    """

    one: Series
    other: Series
    low_m: float
    high_m: float
    since_s: float | None


def _not_rigid(body: str, series: list[Series], axis: int | None, size: float) -> Iterator[str]:
    """One sentence for a body: of the two markers whose distance changes most, and what would explain it."""
    changing = [found for one, other in combinations(series, 2) if (found := _changes(one, other, axis, size))]
    if not changing:
        return
    worst = max(changing, key=lambda pair: pair.high_m - pair.low_m)
    one, other = worst.one, worst.other
    count = {its.marker: sum(its in (pair.one, pair.other) for pair in changing) for its in (one, other)}
    still = [its for its in (one, other) if _spread(its) < STILL * size]
    drawn = 1e3 * float(np.linalg.norm(one.drawn_m - other.drawn_m))
    since = "" if worst.since_s is None else f" from {worst.since_s:.4g} s on"
    said = (
        f'markers "{one.marker}" and "{other.marker}", drawn {drawn:.3g} mm apart on body "{body}", are seen '
        f"{1e3 * worst.low_m:.3g} to {1e3 * worst.high_m:.3g} mm apart{since}, and a body is rigid: "
    )
    if len(still) == 1:
        yield said + f'"{still[0].marker}" does not move; check that it was tracked'
    elif worst.since_s is not None and (names := _renamed(series, axis, worst.since_s, size)):
        yield said + f'with the names of "{names[0]}" and "{names[1]}" exchanged since then it is; exchange them there'
    elif len(set(count.values())) > 1:
        yield said + f'"{max(count, key=lambda id: count[id])}" is the one that strays; check its name and its body'
    else:
        yield said + "check their names, and on which body each is drawn"


def _changes(one: Series, other: Series, axis: int | None, size: float) -> Changing | None:
    time, apart = _distance(one, other, axis)
    if time.size < FEW:
        return None
    low, high = (float(end) for end in np.quantile(apart, [ENDS, 1.0 - ENDS]))
    if high - low <= CHANGES * size:
        return None
    return Changing(one, other, low, high, _since(time, apart, 0.5 * CHANGES * size))


def _since(time: np.ndarray, apart: np.ndarray, far: float) -> float | None:
    """When a distance jumps from what it was at first, for good [s]; None where it comes and goes, or by and by."""
    off = np.abs(apart - np.median(apart[:FEW])) > far
    wrong = np.cumsum(off) + np.sum(~off) - np.cumsum(~off)  # samples on the wrong side of a jump after each
    last = int(np.argmin(wrong))
    before, after = apart[max(last - 2, 0) : last + 1], apart[last + 1 : last + 4]
    if last + 1 < FEW or time.size - last - 1 < FEW or wrong[last] > ENDS * time.size:
        return None
    step, usual = abs(np.median(after) - np.median(before)), float(np.quantile(np.abs(np.diff(apart)), 0.9))
    return float(time[last + 1]) if step > max(far, APART * usual) else None


def _renamed(series: list[Series], axis: int | None, since_s: float, size: float) -> tuple[str, str] | None:
    """Two markers with whose names exchanged all distances stay what they were before."""
    names = {one.marker: one for one in series}
    for exchanged in combinations(names, 2):
        called = dict(zip(exchanged, exchanged[::-1], strict=True))
        for a, b in combinations(names, 2):
            time, apart = _distance(names[a], names[b], axis)
            after, then = _distance(names[called.get(a, a)], names[called.get(b, b)], axis)
            was, became = apart[time < since_s], then[after >= since_s]
            if was.size and became.size and abs(np.median(became) - np.median(was)) > 0.25 * CHANGES * size:
                break
        else:
            return exchanged
    return None


def _distance(one: Series, other: Series, axis: int | None) -> tuple[np.ndarray, np.ndarray]:
    """Times at which both were seen [s], and how far apart [m], where enough coordinates were measured to tell."""
    time, axes, a, b = _together(one, other)
    if axis is not None and not axes.all():
        axes = axes & (np.arange(3) != axis)
    if axes.sum() < (3 if axis is None else 2):
        return np.zeros(0), np.zeros(0)
    return time, np.linalg.norm((a - b)[:, axes], axis=1)


def _spread(one: Series) -> float:
    """Over which a marker moves, but for its farthest samples [m]."""
    places = one.places_m[:, one.measured]
    places = places[np.isfinite(places).all(axis=1)]
    low, high = np.quantile(places, [ENDS, 1.0 - ENDS], axis=0) if len(places) else (np.zeros(1), np.zeros(1))
    return float(np.linalg.norm(high - low))


def _together(one: Series, other: Series) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Times at which both were seen (n,) [s], the coordinates that were measured of both (3,), and their places (n, 3)
    [m]; what repeats one number throughout counts as measured where it is all that a marker did.
    """
    axes = one.measured & other.measured
    time, first, second = np.intersect1d(one.time_s, other.time_s, return_indices=True)
    a, b = one.places_m[first], other.places_m[second]
    whole = np.isfinite(a[:, axes]).all(axis=1) & np.isfinite(b[:, axes]).all(axis=1)
    return time[whole], axes, a[whole], b[whole]
