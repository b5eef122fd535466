"""What half the step would change: how far found values rest on the step of the simulation.

A blow, or a joint that stops, falls somewhere inside a step, so that a motion with many of them is of first order: as
much again as half the step changes is still missing at the end.  The search answers a changed residual with a changed
value; twice that is what an interval allows for.  Noise of the measurement knows nothing of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from backend.fit.nuisance import answering
from backend.fit.residual import Residuals
from backend.fit.solve import Solution

MISSING = 2.0  # times what half the step changes: of a first-order error, all of it
WORTH_SAYING = 0.5  # deviations that a value would move


@dataclass(frozen=True)
class HalfStep:
    """shift: of every value (p) when the step is halved, in its unit; NaN where no motion is found with half of it."""

    step_s: float
    names: Sequence[str]
    shift: Float[np.ndarray, " p"]

    @classmethod
    def none(cls, names: Sequence[str]) -> HalfStep:
        """Where the step tells nothing."""
        return cls(0.0, names, np.zeros(len(names)))

    @classmethod
    def of(cls, residuals: Residuals, solution: Solution) -> HalfStep:
        """Simulate every run at half its step where the search ended, and follow the residual to the values."""
        finer = replace(residuals, runs=[run.stepping(0.5 * run.step_s) for run in residuals.runs])
        names = residuals.names[: len(residuals.parameters)]
        change = finer.residual(solution.x) - residuals.residual(solution.x)
        step_s = min(run.step_s for run in residuals.runs)
        if not np.all(np.isfinite(change)):
            return cls(step_s, names, np.full(len(names), np.nan))
        root = np.sqrt(solution.weights)
        shift = -answering(root[:, None] * solution.jacobian) @ (root * change)
        return cls(step_s, names, shift[: len(names)])

    @property
    def ends(self) -> Float[np.ndarray, "p 2"]:
        """How far below and above each value the step may have kept it from, at most zero and at least zero."""
        missing = MISSING * np.nan_to_num(self.shift)
        return np.stack([np.minimum(missing, 0.0), np.maximum(missing, 0.0)], 1)

    def sentences(self, sd: Float[np.ndarray, " p"]) -> Iterator[str]:
        """What would move, by how much, and what to do about it; sd: of the values."""
        half = f"{0.5 * self.step_s:.3g} s"
        if np.any(np.isnan(self.shift)):
            yield (
                f"No motion was found at half the step ({half}), so that nobody knows how far values rest on it. "
                f"Fit with --step {half[:-2]}, or another."
            )
            return
        bounded = np.isfinite(sd) & (sd > 0)
        moved = [
            f"{name} by {shift:.2g} ({abs(shift) / own:.1f} deviations)"
            for name, shift, own in zip(self.names, self.shift, np.where(bounded, sd, np.inf), strict=True)
            if abs(shift) > WORTH_SAYING * own
        ]
        if moved:
            yield (
                f"Half the step ({half}) would move {', '.join(moved)}: intervals allow for twice that. "
                f"Fit with --step {half[:-2]}, or less."
            )
