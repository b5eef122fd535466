"""A set of candidates fitted to the data; where a fit of another set begins that is like one that ended."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from backend.diagnose.candidate import Candidate
from backend.diagnose.fitted import Fitted, start_of
from backend.diagnose.screen import Screen
from backend.diagnose.subject import Choice
from backend.mechanism.effect import kind_named


@dataclass(frozen=True)
class Cause:
    """A set of candidates fitted to the data, and its log evidence for noise alone."""

    fitted: Fitted
    log_z: float
    otherwise: Fitted | None = None
    """The same with what nobody states as it is assumed where this has it free, if that leaves hardly more; or free
    where this has it as assumed."""

    @property
    def candidates(self) -> tuple[Candidate, ...]:
        """Its members."""
        return self.fitted.choice.candidates

    @property
    def log_odds(self) -> float:
        """Of its members' kinds."""
        return sum(c.log_odds for c in self.candidates)

    @property
    def names(self) -> tuple[str, ...]:
        """Sorted names of its members."""
        return tuple(sorted(c.name for c in self.candidates))

    @property
    def shares_a_part(self) -> list[bool]:
        """Of each member after the first, whether it acts on the same part as one before it."""
        members = self.candidates
        return [any(a.reach & b.reach for b in members[:i]) for i, a in enumerate(members)][1:]

    @property
    def values(self) -> dict[str, float]:
        """Of all that is free, by name."""
        return dict(zip((p.name for p in self.fitted.choice.parameters), self.fitted.values.tolist(), strict=True))


def begun_from(fitted: Fitted, choice: Choice, values: Mapping[str, float] | None = None) -> np.ndarray:
    """Where a fit of another choice begins: at the values and starts of one that ended, and at these values."""
    known = dict(zip((p.name for p in fitted.choice.parameters), fitted.values, strict=True)) | dict(values or {})
    start = start_of(fitted.subject, choice, known)
    start[len(choice.parameters) :] = fitted.x[fitted.count :]
    return start


def as_last(fitted: Fitted, about: Screen, candidate: Candidate) -> dict[str, float] | None:
    """Values by which a candidate does to first order what the last member of a fit did, of the same shape where both
    have one; None where it cannot.
    """
    other, choice = fitted.choice.candidates[-1], fitted.choice
    own = slice(choice.own - len(other.parameters), choice.own)
    values = about.imitated(candidate, about.done_by(other, (fitted.values - choice.start)[own]))
    if values is None:
        return None
    shapes = dict(zip((p.parameter for p in other.parameters), fitted.values[own], strict=True))
    unknown = (p for p in candidate.parameters if p.name not in candidate.told and p.parameter in shapes)
    return values | {p.name: float(shapes[p.parameter]) for p in unknown}


def in_order(fitted: Fitted) -> bool:
    """Whether numbers that must not be less than others are not: friction at rest and while sliding."""
    values, at = fitted.values, 0
    for c in fitted.choice.candidates:
        own = dict(zip((p.parameter for p in c.parameters), values[at : at + len(c.parameters)], strict=True))
        at += len(c.parameters)
        for name, spec in kind_named(c.kind).parameters.items():
            if spec.at_least in own and name in own and own[name] < own[spec.at_least]:
                return False
    return True


def is_new(candidate: Candidate, parent: Cause) -> bool:
    """Not the same effect, nor one inside or around a shared one, of the parent's."""
    return not any(c.overlaps(candidate) for c in parent.candidates)
