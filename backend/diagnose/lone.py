"""Wild samples of held-out experiments: they would count as a gap that no cause shrinks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from backend.diagnose.fitted import Fitted
from backend.diagnose.noise import Place, drop, numbered, places, strays
from backend.diagnose.subject import Subject
from backend.diagnose.unseen import Unseen, unseen

ROUNDS = 8  # one sample of each part at a time: a wild one bends what is smooth, so that others seem wild beside it


def set_lone_aside(fitted: Fitted) -> bool:
    """Drop samples of held-out experiments that nothing smooth explains beside a fit and that stand alone; false where
    there are none. Where neighbours stand off as well, the fit may miss a blow.
    """
    subject, wild, left = fitted.subject, set[Place](), set[Place]()
    data, keep = [p.data for p in subject.held_out], subject.held_noise.keep
    before, every = [k.copy() for k in keep], sorted(set(_counted(subject)))
    for _ in range(ROUNDS):
        if (made := unseen(fitted)) is None:
            break
        far, left = _far(subject, made)
        if not left:
            break
        worst = {max((p for p in left if p[:2] == part), key=lambda p: far[p]) for part in {p[:2] for p in left}}
        wild |= worst
        drop(data, keep, worst)
    for mask, was in zip(keep, before, strict=True):
        mask[:] = was
    alone = {p for p in wild if not _beside(every, p) & (wild | left - {p})}
    drop(data, keep, alone)
    return bool(alone)


def _counted(subject: Subject) -> list[Place]:
    """Where the rows of held-out experiments come from, in order."""
    data = [p.data for p in subject.held_out]
    return places(data, [subject.held_noise.whitening(d, i).keep for i, d in enumerate(data)])


def _far(subject: Subject, made: Unseen) -> tuple[dict[Place, float], set[Place]]:
    """Squares of what nothing smooth explains, by place [noise variances], and the places where they are too large."""
    at, off = _counted(subject), made.unexplained()
    of = numbered(at)
    far = dict(zip(dict.fromkeys(at), np.bincount(of, off**2).tolist(), strict=True))
    return far, {at[k] for k in np.flatnonzero(strays(off, of))}


def _beside(every: Sequence[Place], place: Place) -> set[Place]:
    """The same part's samples before and after."""
    k = every.index(place)
    return {p for p in (*every[max(k - 1, 0) : k], *every[k + 1 : k + 2]) if p[:2] == place[:2]}
