"""Which place throws a fit of shared values off, by trial: at an end that is far from the data, slopes tell nothing.

Where the beginning of the records is still explained, each place in turn gets another value; what all others share,
and everything else that is free, gives way by slopes over half its value. A simulation a trial, and the order of what
they leave says which places deserve a fit.

A name that slopes would add is weighed in the same way: where parts strike, a linear estimate may promise what no
simulation keeps.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from backend.fit.secant import MOST, secants
from backend.fit.solve import LeastSquares, Vector, step_within

SHARES = (0.25, 0.5, 1.0)  # of the way to where a linear estimate would lead
SIZES = (0.25, 4.0)  # of its value, or of its natural size where that is zero: the other value of a place


@dataclass(frozen=True)
class Trial:
    """A place (index), all values where it has another one, and the sum of squares left when the rest has given way."""

    place: int
    moved: Float[np.ndarray, " all"]
    left: float


def trials(
    few: LeastSquares,
    x: Vector,
    full: LeastSquares,
    every: Callable[[Vector], Float[np.ndarray, " all"]],
    places: Sequence[int],
    tell: Callable[[int], None],
) -> list[Trial]:
    """The best trial of each place, the best place first.

    few: with shared values, x among them; full: every place with its own value, every(x) among them, linear in x.
    tell: which place comes next.
    """
    r, reach = few.residual(x), MOST * np.where(x == 0.0, few.scale, np.abs(x))
    J = secants(few, x, r, reach, range(x.size)).slopes
    best: dict[int, Trial] = {}
    for i in places:
        tell(i)
        for moved in _moved(full, every(x), i):
            r = full.residual(moved)
            if not np.all(np.isfinite(r)):
                continue
            step = step_within(few, x, J, r)
            left = float(np.sum((r + J @ step) ** 2))
            if i not in best or left < best[i].left:
                there = np.clip(moved + every(x + step) - every(x), full.lower, full.upper)
                best[i] = Trial(i, there, left)
    return sorted(best.values(), key=lambda trial: trial.left)


def brought(
    few: LeastSquares,
    x: Vector,
    J: Float[np.ndarray, "n few"],
    full: LeastSquares,
    every: Callable[[Vector], Float[np.ndarray, " all"]],
    place: int,
    value: float,
) -> float:
    """How much of the sum of squares a place takes away, simulated, at the best share of the way to another value; the
    rest gives way by its slopes J, and what that brings alone does not count.
    """

    def left(share: float) -> float:
        moved = every(x)
        moved[place] += share * (value - moved[place])
        r = full.residual(np.clip(moved, full.lower, full.upper))
        if not np.all(np.isfinite(r)):
            return np.inf
        step = every(x + step_within(few, x, J, r)) - every(x)
        there = full.residual(np.clip(moved + step, full.lower, full.upper))
        return float(np.nan_to_num(min(r @ r, there @ there), nan=np.inf))

    return left(0.0) - min(left(share) for share in SHARES)


def _moved(full: LeastSquares, x: Vector, i: int) -> Iterator[Vector]:
    for size in SIZES:
        moved = x.copy()
        moved[i] = np.clip(size * (x[i] or full.scale[i]), full.lower[i], full.upper[i])
        if moved[i] != x[i]:
            yield moved
