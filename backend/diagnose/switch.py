"""Causes that are nothing to first order while absent: stops, play, bending. They are tried at a few sizes each.

Sizes come from the motion itself: a stop stands somewhere in what a joint passes through; play and softness have the
size that their files expect, and some below and above.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from backend.diagnose.candidate import Candidate
from backend.diagnose.fitted import Fitted, start_of
from backend.diagnose.library import PLAYS, RUBBING
from backend.diagnose.seer import Seer
from backend.diagnose.subject import Subject
from backend.effects.catalogue import catalogue
from backend.effects.shapes import AbstractJointStop

SHARES = (0.25, 0.55, 0.85)  # of the way from the starts to the end of what a joint passes
LITTLE = 0.02  # rad or mechanism lengths: an end within so short a way is not looked for
FACTORS = (0.12, 0.25, 0.5, 1.0, 2.0)  # of the expected size
RUBS = 0.4  # of its sd before any data, where nobody states it: a coefficient of 0.1
TELLS = 0.9  # of the misfit: walls that rub leave at most this share of what smooth ones leave, or are not begun with
CAP = 10.0  # sd: of openings, what is missed by more counts no more
EARLY = 0.5  # of the records: later, what switched on at another moment has long gone its own way


def openings(
    subject: Subject, candidate: Candidate, passed: dict[str, np.ndarray], shares: Sequence[float] = SHARES
) -> Iterator[dict[str, float]]:
    """Values, by name, to begin a search from. passed: q of each joint that an unknown force would move (experiments,
    times), under the drawing or a cause. shares: of that way, at which an end of travel may stand.
    """
    if issubclass(catalogue()[candidate.kind], AbstractJointStop):
        q, size = passed.get(candidate.on[0]), subject.size_of(candidate.on[0])
        if q is None:  # it moves as it is told, or not at all
            return
        (p,), (take,) = candidate.parameters, candidate.takes
        first, last = (q[:, 0].max(), q.max()) if is_upper(candidate) else (q[:, 0].min(), q.min())
        if abs(last - first) > LITTLE * size:
            yield from ({p.name: float(first + share * (last - first))} for share in shares)
        if (drawn := float(subject.neutral[take[0]])) != _default(candidate):
            yield {p.name: drawn}
        return
    for factor in FACTORS:
        yield {
            p.name: float(np.clip(p.start + sd * factor, p.lower, p.upper))
            for p, sd in zip(candidate.parameters, candidate.prior_sd, strict=True)
        }


def is_upper(end: Candidate) -> bool:
    """Whether a candidate is the upper end of a joint's travel, which is far above as long as nobody draws it."""
    return _default(end) > 0.0


def _default(end: Candidate) -> float:
    """Where an end of travel stands that nobody draws [rad or m]."""
    return float(catalogue()[end.kind].declarations()[end.parameters[0].parameter].default or 0.0)


def promising(
    subject: Subject,
    candidate: Candidate,
    passed: dict[str, np.ndarray],
    beside: Sequence[Candidate] = (),
    known: Mapping[str, float] | None = None,
) -> tuple[float, dict[str, float], Candidate]:
    """Least sum of squares over the first half of the records, the opening that has it, and of what: the candidate, or
    the same with walls that rub and pins that lie anywhere in their holes before the release, as pins that rub do.

    Every experiment starts from its own static frames. beside: other candidates, at the values `known` by name.
    """
    best = (np.inf, {}, candidate)
    for values in openings(subject, candidate, passed):
        cost = _early(subject, (*beside, candidate), {**(known or {}), **values})
        best = min(best, (cost, values, candidate), key=lambda b: b[0])
    cost, values, _ = best
    if values and (rubbed := roughened(candidate, values)) is not None:
        rough, values = rubbed
        if (left := _early(subject, (*beside, rough), {**(known or {}), **values})) < TELLS * cost:
            return left, values, rough.settling(values[rough.parameters[0].name])
    return best


def roughened(candidate: Candidate, values: Mapping[str, float]) -> tuple[Candidate, dict[str, float]] | None:
    """The same play with walls that rub, and values to begin it from."""
    rough = rubbing(candidate)
    if rough is None:
        return None
    friction = rough.parameters[-1]
    return rough, {**values, friction.name: friction.start + RUBS * float(friction.prior_sd or 0.0)}


def rubbing(candidate: Candidate) -> Candidate | None:
    """The same play with walls that rub, as hard as drawn; None where nothing is loose or friction is stated."""
    own, way = len(candidate.parameters), next(iter(candidate.closer), candidate)
    names = [p.parameter for p in way.parameters]
    if candidate.kind not in PLAYS or RUBBING not in names[own:]:
        return None
    return replace(way.only([i < own or name == RUBBING for i, name in enumerate(names)]), closer=candidate.closer)


def _early(subject: Subject, candidates: Sequence[Candidate], values: Mapping[str, float]) -> float:
    """Sum of squares over the first half of the records: what a late blow does to the rest of one says little about its
    place.
    """
    choice = subject.choose(*candidates)
    probes = [subject.chosen(p, choice).first(EARLY) for p in subject.fit]
    return float(np.sum(capped(Seer(subject, probes, EARLY).left(start_of(subject, choice, values))) ** 2))


def capped(r: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Misses of up to ten sd each, where a motion is lost as well."""
    return np.clip(np.nan_to_num(r, nan=CAP), -CAP, CAP)


def let_go(baseline: Fitted) -> dict[str, np.ndarray]:
    """q of every joint (experiments, times) under the drawing, each experiment let go where its own static frames
    stand: starts that were fitted to what a stop does to a motion may keep it from ever reaching that stop.
    """
    subject, choice = baseline.subject, baseline.choice
    values = start_of(subject, choice)[: baseline.count]
    return _by_joint(subject, [p.coordinates(values, p.start) for p in baseline.probes])


def passed(fitted: Fitted) -> dict[str, np.ndarray]:
    """q of every joint (experiments, times) under a fitted model."""
    return _by_joint(fitted.subject, [p.coordinates(fitted.values, fitted.own(i)) for i, p in enumerate(fitted.probes)])


def _by_joint(subject: Subject, found: Sequence[np.ndarray]) -> dict[str, np.ndarray]:
    ids = subject.model.topology.joint_ids
    free = [id for id in subject.joints if id not in subject.told]
    return {id: np.stack([q[:, ids.index(id)] for q in found]) for id in free}
