"""What the drawing's tolerances say: Gaussian priors on parameters, as extra least-squares rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int


@dataclass(frozen=True)
class GaussianPrior:
    """Independent normal priors on some of the parameters: which, their means and standard deviations."""

    index: Int[np.ndarray, " k"]
    mean: Float[np.ndarray, " k"]
    sd: Float[np.ndarray, " k"]

    def __post_init__(self):
        if np.any(~(self.sd > 0)):
            worst = int(np.argmin(self.sd))
            raise ValueError(
                f"A tolerance has standard deviation {self.sd[worst]:g}; it must be positive. "
                "Leave the tolerance out to hold the parameter as drawn."
            )

    @classmethod
    def none(cls) -> GaussianPrior:
        """No prior at all."""
        return cls(np.zeros(0, int), np.zeros(0), np.zeros(0))

    @classmethod
    def of(cls, names: Sequence[str], tolerances: dict[str, tuple[float, float]]) -> GaussianPrior:
        """Priors by parameter name: {name: (mean, sd)}. KeyError lists the known names."""
        unknown = sorted(set(tolerances) - set(names))
        if unknown:
            raise KeyError(f"No parameter named {unknown[0]!r} to hold a tolerance; known: {', '.join(names)}.")
        chosen = [n for n in names if n in tolerances]
        return cls(
            np.array([list(names).index(n) for n in chosen], int),
            np.array([tolerances[n][0] for n in chosen], float),
            np.array([tolerances[n][1] for n in chosen], float),
        )

    def residual(self, x: Float[np.ndarray, " p"]) -> Float[np.ndarray, " k"]:
        """(x - mean) / sd."""
        return (x[self.index] - self.mean) / self.sd

    def jacobian(self, parameters: int) -> Float[np.ndarray, "k p"]:
        """Its constant derivative."""
        J = np.zeros((self.index.size, parameters))
        J[np.arange(self.index.size), self.index] = 1.0 / self.sd
        return J
