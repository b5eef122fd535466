"""How probable each explanation is, and which others the same data cannot tell from it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from backend.diagnose.adequacy import scaled
from backend.diagnose.candidate import Candidate
from backend.diagnose.cause import Cause
from backend.diagnose.fitted import log_evidence
from backend.diagnose.screen import Screen
from backend.diagnose.which import APART

NONE, ONE, UNKNOWN, SEVERAL = 0.3, 0.5, 0.2, 0.1
"""Belief before any data in: nothing, one effect of the library, something that is not in it, several at once."""
ODDS = float(np.log(20.0))
IMITATED = (0.12, 0.4)
"""Chance that a member of a set only helps the others do what one thing outside the library does: where it acts apart
from them, and where it acts on the same part. Of pairs that fit, with which eleven sealed seeds' clear gaps were
answered, one of twenty-one whose members act apart did so, and three of eight whose members act on one part; of earlier
ones one of seven and all four.
"""
FAR = 8.0  # of a size's sd before any data
OUTSIZED = 0.45
"""Chance that a cause which is FAR times as large as its effect's file expects does what one thing outside the library
does: a clock that is 14% fast is what a rotor nobody drew looks like in a linkage of one freedom. Of four with clear
gaps, in sealed seeds and studies of others, two did; at one half a hair would call all of them unknown.
"""


@dataclass(frozen=True)
class Belief:
    """Causes, most probable first, with their probabilities beside `none` and `unknown`; log_z as weighed, with the
    beliefs before any data.
    """

    causes: tuple[Cause, ...]
    probability: np.ndarray
    log_z: np.ndarray
    none: float
    unknown: float

    @property
    def reported(self) -> list[int]:
        """Causes that the data leave standing beside the first: within odds of 20, or the same motion to 3 sd."""
        if not self.causes:
            return []
        best = self.causes[0]
        alike = [
            len(c.candidates) == len(best.candidates) and _fits_as_well(c, best) and self.log_z[0] - z < 3.0 * ODDS
            for c, z in zip(self.causes, self.log_z, strict=True)
        ]
        near = self.log_z > self.log_z[0] - ODDS
        return [i for i in range(len(self.causes)) if near[i] or alike[i]]


def _fits_as_well(c: Cause, best: Cause) -> bool:
    return abs(c.fitted.chi2 - best.fitted.chi2) < APART


def weigh(
    baseline: Cause | None,
    causes: Sequence[Cause],
    library_size: int,
    *,
    scale: float,
    softness: float = 1.0,
    unknown_log_z: float | None = None,
    foretold: Mapping[tuple[str, ...], float] | None = None,
    one_motion: Sequence[Sequence[tuple[str, ...]]] = (),
) -> Belief:
    """Probabilities from evidence and the beliefs before any data.

    one_motion: names of causes, group by group, whose evidence differs only by a law that nobody knows: each has the
    mean of its group's.
    foretold: log density of held-out experiments under the nearest causes, by their names; those farther off count as
    the worst of these.
    """
    width = scale / np.sqrt(softness)
    z = np.array([log_evidence(scaled(c.fitted, width)) for c in causes])
    if foretold and np.isfinite(most := max(foretold.values())):
        least = min(foretold.values())
        z = z + np.array([foretold.get(c.names, least) - most for c in causes])
    prior = np.array([log_prior(len(c.candidates), library_size) + c.log_odds for c in causes])
    alone = z
    z = _in_common(z, [c.names for c in causes], one_motion)
    fitting = z + prior
    true = fitting + np.log([_own(c) for c in causes])
    order = np.lexsort((-alone, -true))
    rest = []
    rest.append(-np.inf if baseline is None else np.log(NONE) + log_evidence(scaled(baseline.fitted, width)))
    rest.append(-np.inf if unknown_log_z is None else np.log(UNKNOWN) + unknown_log_z)
    total = logsumexp([*fitting, *rest])
    p = np.exp(true - total)
    none = float(np.exp(rest[0] - total))
    imitated = np.sum(np.exp(fitting - total) - p)
    unknown = min(float(np.exp(rest[1] - total) + imitated), 1.0 - none)  # rounding may not bring it past one
    return Belief(tuple(causes[i] for i in order), p[order], true[order], none, unknown)


def _in_common(
    z: np.ndarray, names: Sequence[tuple[str, ...]], groups: Sequence[Sequence[tuple[str, ...]]]
) -> np.ndarray:
    """Evidence with the mean of a group's for each of the group; together they are as probable as before."""
    found = z.copy()
    for group in groups:
        rows = [i for i, n in enumerate(names) if n in group]
        if rows:
            found[rows] = logsumexp(z[rows]) - np.log(len(rows))
    return found


def _own(cause: Cause) -> float:
    """Chance that a set that fits is not one thing imitated: members and an outsized one are doubted for one reason."""
    choice = cause.fitted.choice
    off = (cause.fitted.values - choice.start)[: choice.own] / choice.prior_sd[: choice.own]
    outsized = np.any(np.abs(off)[choice.sizes] > FAR)
    unimitated = float(np.prod([1.0 - IMITATED[together] for together in cause.shares_a_part]))
    return min(unimitated, 1.0 - OUTSIZED * float(outsized))


def log_prior(size: int, library: int) -> float:
    """Of one set of so many effects of a library, before any data and apart from what its kinds are worth. A library
    that holds fewer, because nearly all was left out of it, has one such set.
    """
    ways = 1.0
    for k in range(size):
        ways *= max(library - k, k + 1) / (k + 1.0)
    return float(np.log((ONE if size == 1 else SEVERAL * 0.3 ** (size - 2)) / ways))


def aliases(
    about: Screen, cause: Cause, others: Sequence[Candidate], tried: Mapping[tuple[str, ...], Cause], scale: float
) -> list[list[str]]:
    """`[kind, place]` of candidates any of which, in place of a member of the cause, these data cannot tell from it:
    by their fits where the set was tried, by their slopes beside the other members' elsewhere.
    """
    found: list[list[str]] = []
    at = 0
    for own in cause.candidates:
        part = slice(at, at + len(own.parameters))
        change = about.done_by(own, cause.fitted.values[part] - cause.fitted.choice.start[part]) / scale
        at += len(own.parameters)
        rest = [c for c in cause.candidates if c is not own]
        beside = [about.signature(c) / scale for c in rest]
        for k in others:
            if k.name in cause.names:
                continue
            set_ = tuple(sorted([k.name, *(c.name for c in rest)]))
            if set_ in tried:
                other = tried[set_].fitted
                apart = (other.chi2 - cause.fitted.chi2) / scale**2 + other.strain - cause.fitted.strain
            elif not np.any(change):  # a tolerance set free: slopes beside the tolerance itself say nothing
                continue
            else:
                T = np.concatenate([about.signature(k) / scale, *beside], 1)
                H = T.T @ T + np.diag(np.concatenate([k.prior_sd, *(c.prior_sd for c in rest)]) ** -2.0)
                b = T.T @ change
                apart = float(change @ change - b @ np.linalg.solve(H, b))
            alias = [k.kind, k.label or k.on[0]]
            if apart < APART and alias not in found:
                found.append(alias)
    return found
