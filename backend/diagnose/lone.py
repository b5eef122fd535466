"""Wild samples of held-out experiments: they would count as a gap that no cause shrinks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from backend.diagnose.fitted import Fitted
from backend.diagnose.noise import strays
from backend.diagnose.subject import Subject
from backend.diagnose.unseen import Unseen, unseen

ROUNDS = 8  # one sample of each part at a time: a wild one bends what is smooth, so that others seem wild beside it

Place = tuple[int, str, float]
"""Experiment, part and time: a marker's coordinates stand or fall together."""


def set_lone_aside(fitted: Fitted) -> bool:
    """Drop samples of held-out experiments that nothing smooth explains beside a fit and that stand alone; false where
    there are none. Where neighbours stand off as well, the fit may miss a blow.
    """
    subject, wild, left = fitted.subject, set[Place](), set[Place]()
    every = sorted(set(_places(subject)))
    for _ in range(ROUNDS):
        if (made := unseen(fitted)) is None:
            break
        far = _far(subject, made)
        left = {place for place, (_, stray) in far.items() if stray}
        if not left:
            break
        worst = {max((p for p in left if p[:2] == part), key=lambda p: far[p][0]) for part in {p[:2] for p in left}}
        wild |= worst
        _count(subject, worst, False)
    alone = {p for p in wild if not _beside(every, p) & (wild | left - {p})}
    _count(subject, wild - alone, True)
    return bool(alone)


def _places(subject: Subject) -> list[Place]:
    """Of every row that counts, in order."""
    found: list[Place] = []
    for i, probe in enumerate(subject.held_out):
        keep = subject.held_noise.whitening(probe.data, i).keep
        at = [probe.data.channels[c].at for c in probe.data.channel[keep]]
        found += [(i, part, float(t)) for part, t in zip(at, probe.data.time_s[keep], strict=True)]
    return found


def _far(subject: Subject, made: Unseen) -> dict[Place, tuple[float, bool]]:
    """By place: squares of what nothing smooth explains [noise variances], and whether they are too many."""
    places = _places(subject)
    number = {place: k for k, place in enumerate(dict.fromkeys(places))}
    of, off = np.array([number[place] for place in places]), made.unexplained()
    square, stray = np.bincount(of, off**2), np.bincount(of, strays(off, of)) > 0
    return {place: (float(square[k]), bool(stray[k])) for place, k in number.items()}


def _beside(every: Sequence[Place], place: Place) -> set[Place]:
    """The same part's samples before and after."""
    k = every.index(place)
    return {p for p in (*every[max(k - 1, 0) : k], *every[k + 1 : k + 2]) if p[:2] == place[:2]}


def _count(subject: Subject, places: set[Place], whether: bool) -> None:
    for i, part, time_s in places:
        data = subject.held_out[i].data
        at = np.array([c.at == part for c in data.channels])[data.channel] & (data.time_s == time_s)
        subject.held_noise.keep[i][at & np.isfinite(data.value)] = whether
