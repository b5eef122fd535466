"""A way into whole records where motions fork: from a part at their beginning, a little more at a time, by differences.

Parts that strike each other fork so often in a long record that exact slopes end in the first trough that they meet,
and differences as narrow as the whole record tells apart end in another one. Over a part the motion has forked less;
what that part leaves open is as far as differences over the next one reach.

Whether a way leads through is luck in part. Where one is lost, it goes on from the part followed last in shorter
steps, and once more; if neither leads through, it goes on all the same, and nothing is said to be known better
than where it was followed last.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from jaxtyping import Float

from backend.fit.residual import Rows
from backend.fit.secant import ROUNDS, WIDER, deviations, settle
from backend.fit.solve import LeastSquares

ASTRAY = 1.1  # times the square of what a part is missed by: beyond it, and what few samples leave to chance, is chaos
CHANCE = 3.0  # deviations of that square by white noise
LONGER = (1.2, 1.1, 1.2)  # times a part, the next; at first, where that was lost, and from there on whatever comes
ON_THE_WAY = 4  # rounds over each part
RETRACED = "Converged as far as the simulation is smooth: whole records were reached by parts that grew."


class Records(Protocol):
    """What is fitted, as far as this way asks (see `residual.Residuals`)."""

    def misfit(self, x: np.ndarray, fraction: float = 1.0) -> float:
        """Rms of the samples in sigmas."""
        ...

    def learn_spread(self, x: np.ndarray, fraction: float = 1.0) -> float:
        """Weigh the samples by the misfit at x."""
        ...

    def rows(self, fraction: float = 1.0) -> Rows:
        """How many samples there are."""
        ...


@dataclass(frozen=True)
class Part:
    """Where the fit of the first fraction of every record ended. open: covariance of what it leaves open, of which
    roughness is a part; None where no differences were taken.
    """

    fraction: float
    x: Float[np.ndarray, " x"]
    open: Float[np.ndarray, "x x"] | None = None
    roughness: Float[np.ndarray, "x x"] | None = None


def astray(residuals: Records, part: Part, missed: float) -> bool:
    """Whether whole records, missed by that many sigmas rms, are missed by more than this part of them."""
    return missed**2 > _followed(residuals, [part])[1]


def retrace(
    residuals: Records,
    problem: Callable[[float], LeastSquares],
    first: Part,
    tell: Callable[[float], None],
) -> Sequence[Part]:
    """From the end of a part to whole records, the last of those returned; empty where no motion is found.

    problem: over the first fraction, as often as it is asked. tell: which part comes next. The residuals' weights
    change.
    """
    kept, allowed = _followed(residuals, [first])
    for attempt, longer in enumerate(LONGER, 1):
        way = kept
        for part in _grown(residuals, problem, way[-1], longer, tell):
            way = [*way, part]
            if attempt < len(LONGER) and residuals.misfit(part.x, part.fraction) ** 2 > allowed:
                break
        kept, allowed = _followed(residuals, way)
        if kept[-1].fraction == 1.0:
            return kept
        if way[-1].fraction == 1.0 and attempt == len(LONGER):
            return [*way[:-1], replace(way[-1], roughness=kept[-1].open)]
    return []


def way_ahead(fraction: float) -> float:
    """Length of all parts that usually follow from one, in whole records."""
    length = fraction
    while fraction < 1.0:
        fraction = _longer(fraction, LONGER[0])
        length += fraction
    return length


def _longer(fraction: float, times: float) -> float:
    return times * fraction if times**1.5 * fraction < 1.0 else 1.0


def _followed(residuals: Records, parts: Sequence[Part]) -> tuple[list[Part], float]:
    """The parts up to one that is missed by more than those before, and the mean square that the next may have."""
    allowed, kept = np.inf, list[Part]()
    for part in parts:
        square = residuals.misfit(part.x, part.fraction) ** 2
        if square > allowed:
            break
        chance = CHANCE * np.sqrt(2.0 / max(residuals.rows(part.fraction).motion, 1))
        allowed = min(allowed, ASTRAY * max(square, 1.0) * (1.0 + chance))
        kept.append(part)
    return kept, allowed


def _grown(
    residuals: Records,
    problem: Callable[[float], LeastSquares],
    part: Part,
    longer: float,
    tell: Callable[[float], None],
) -> Iterator[Part]:
    """One part after the other, to whole records; fewer where no motion is found."""
    x, fraction, sd = part.x, part.fraction, None if part.open is None else np.sqrt(np.diag(part.open))
    while True:
        if sd is not None:  # these records are fitted already, by differences
            fraction = _longer(fraction, longer)
        tell(fraction)
        residuals.learn_spread(x, fraction)
        records = problem(fraction)
        if sd is None:
            J = records.linearise(x)[1]
            if not np.all(np.isfinite(J)):
                return
            sd = deviations(records, x, J, WIDER)
        r = records.residual(x)
        if not np.all(np.isfinite(r)):
            return
        rest = settle(records, x, r, sd, ROUNDS if fraction == 1.0 else ON_THE_WAY)
        x, sd = rest.x, rest.sd
        yield Part(fraction, x, rest.covariance, rest.roughness)
        if fraction == 1.0:
            return
