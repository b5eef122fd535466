"""One possible cause of a gap: an effect of the library at a place where it can act, or everywhere alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from backend.effects.catalogue import catalogue
from backend.fit.free import FreeParameter

WIDE = 3.0  # of its prior's sd: as far as a number is thought to lie while nothing but slopes is known


@dataclass(frozen=True)
class Candidate:
    """One possible cause: an effect at one place, or the same effect everywhere.

    takes: for each of its own numbers, the library's parameters (indices) that carry it. parameters: those numbers,
    with `prior_sd` their sd before any data.
    """

    kind: str
    on: tuple[str, ...]
    places: tuple[str, ...]
    reach: frozenset[str]
    """Its places, and of a joint the bodies that it joins to others: where one thing would act that did the same."""
    parameters: tuple[FreeParameter, ...]
    takes: tuple[tuple[int, ...], ...]
    family: str
    tries: tuple[tuple[float, ...], ...]
    """For each of its numbers, values worth trying where its slope is nothing because the effect is absent; empty for
    sizes, which have one.
    """
    partial: bool = False
    """Whether it frees one number of several that are absent each by itself, as the ends of a joint's travel are."""
    closer: tuple[Candidate, ...] = ()
    """The same, with what nobody states of it free as well: how walls and ends of travel give, give back and rub, one
    for each size to begin from; or what of its shape is freed late."""

    label: str = ""
    """Of a shared one, its places in a word; empty otherwise."""
    share: float = 1.0
    """Of its kind's likelihood, beside an equal part for every candidate: each kind is as likely as the next, wherever
    it may act."""
    settled_m: float = 0.0
    """Of play: how far from the middle of its hole a pin may lie before the release, see `settled`."""

    @property
    def name(self) -> str:
        """`kind:place`, or `kind:all` for a shared one; `kind:all-a` or `kind:a+b` where others are drawn otherwise."""
        part = f".{self.parameters[0].parameter}" if self.partial else ""
        return f"{self.kind}:{self.label or self.on[0]}{part}"

    def settling(self, far_m: float) -> Candidate:
        """The same play with pins that may lie so far off before the release."""
        return replace(self, settled_m=far_m, closer=tuple(c.settling(far_m) for c in self.closer))

    def shaped_as(self, other: Candidate) -> Candidate:
        """The same with as much of its shape free as another of its kind has, where it can have that."""
        names = {p.parameter for p in other.parameters}
        ways = (c for c in (self, *self.closer) if {p.parameter for p in c.parameters} == names)
        return next(ways, self) if self.kind == other.kind else self

    @property
    def log_odds(self) -> float:
        """Of its kind, against the commonest, and of its place among those where the kind may act."""
        return float(np.log(catalogue()[self.kind].odds * self.share))

    @property
    def sought(self) -> bool:
        """Whether there are several ways to begin, of which no slope tells the better."""
        return any(len(values) > 1 for values in self.tries)

    @property
    def turning(self) -> int | None:
        """Which of its numbers is a phase: all that it does is a mixture of what it does at 0 and at a quarter turn."""
        phases = {name for name, p in catalogue()[self.kind].declarations().items() if p.phase}
        return next((i for i, p in enumerate(self.parameters) if p.parameter in phases), None)

    @property
    def prior_sd(self) -> np.ndarray:
        """Sd of its numbers before any data."""
        return np.array([p.prior_sd for p in self.parameters], float)

    @property
    def sizes(self) -> np.ndarray:
        """Which numbers say how much of it there is; the others only which shape it has."""
        return np.array([not worth for worth in self.tries], bool)

    @property
    def told(self) -> frozenset[str]:
        """Numbers, by name, of which slopes tell something while it is absent."""
        tells = self.sizes
        if self.proportional is not None:
            tells[self.proportional[1]] = True
        return frozenset(p.name for p, known in zip(self.parameters, tells, strict=True) if known)

    @property
    def one_sided(self) -> np.ndarray:
        """Which numbers cannot fall below where they start."""
        return np.array([p.lower >= p.start for p in self.parameters])

    @property
    def proportional(self) -> tuple[int, int] | None:
        """Of a spring that rests where nobody knows: its size, and the shape that acts in proportion to it."""
        declared = catalogue()[self.kind].declarations()
        for shape, p in enumerate(self.parameters):
            to = None if self.sizes[shape] else declared[p.parameter].proportional_to
            for size, other in enumerate(self.parameters):
                if other.parameter == to and other.start == 0.0:
                    return size, shape
        return None

    def steps(self, offsets: Float[np.ndarray, " own"]) -> Float[np.ndarray, " own"]:
        """Steps along its responses, of which one is that to its shape at the size that is expected of it, from how far
        its numbers lie off their starts.
        """
        made = offsets.copy()
        if self.proportional is not None:
            size, shape = self.proportional
            made[shape] *= offsets[size] / self.prior_sd[size]
        return made

    def offsets(self, step: Float[np.ndarray, " own"]) -> Float[np.ndarray, " own"]:
        """The other way; a spring that would push rests as far away as is thought possible."""
        made = step.copy()
        if self.proportional is not None:
            size, shape = self.proportional
            far, pull = WIDE * self.prior_sd[shape], step[shape] * self.prior_sd[size]
            made[size] = max(step[size], abs(pull) / far)
            made[shape] = pull / made[size] if made[size] > 0.0 else 0.0
        return made

    def allows(self, step: Float[np.ndarray, "*draws own"]) -> Bool[np.ndarray, " *draws"]:
        """Whether steps of its numbers lead where it can go, if one number says how much of it there is: friction does
        not drive.
        """
        if self.proportional is not None:  # a spring that pulls from afar may seem to push a little, too
            size, shape = self.proportional
            weakest = np.abs(step[..., shape]) * self.prior_sd[size] / (WIDE * self.prior_sd[shape])
            return step[..., size] > -weakest
        if self.sizes.sum() != 1:
            return np.ones(step.shape[:-1], bool)
        return ~np.any((step < 0) & self.one_sided & self.sizes, axis=-1)

    def overlaps(self, other: Candidate) -> bool:
        """Whether both are one effect, or one is inside or around the other, shared one."""
        return self.kind == other.kind and bool(set(self.on) & set(other.on))

    def only(self, kept: Sequence[bool] | Bool[np.ndarray, " own"]) -> Candidate:
        """With some of its numbers alone."""
        of = lambda numbers: tuple(n for n, keep in zip(numbers, kept, strict=True) if keep)  # noqa: E731
        return replace(self, parameters=of(self.parameters), takes=of(self.takes), tries=of(self.tries))

    def ties(self, count: int) -> np.ndarray:
        """(count, own): from its numbers to the library's."""
        ties = np.zeros((count, len(self.takes)))
        for own, all_ in enumerate(self.takes):
            ties[list(all_), own] = 1.0
        return ties
