"""Robust losses: how much a whitened residual is allowed to pull.

With z = (r/c)^2 each loss gives rho(z), and the objective is c^2/2 sum rho. Near zero rho(z) = z, so a robust
fit of clean data is the least-squares fit. `weight` is rho'(z), the factor of iteratively reweighted least
squares (Triggs et al. 2000, "Bundle adjustment", section 4.3, first-order part).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float

LossName = Literal["linear", "soft_l1", "huber", "student"]

STUDENT_DEGREES = 4.0  # Lange, Little and Taylor (1989): four degrees of freedom suit unknown outlier rates
TUNING = {
    "linear": 1.0,
    "soft_l1": 1.0,
    "huber": 1.345,
    "student": 1.0,
}  # c, in sigmas; Huber: 95% efficiency

_RHO: dict[str, Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]] = {
    "linear": lambda z: (z, np.ones_like(z)),
    "soft_l1": lambda z: (2.0 * (np.sqrt(1.0 + z) - 1.0), 1.0 / np.sqrt(1.0 + z)),
    "huber": lambda z: (
        np.where(z <= 1.0, z, 2.0 * np.sqrt(z) - 1.0),
        1.0 / np.sqrt(np.maximum(z, 1.0)),
    ),
    "student": lambda z: (STUDENT_DEGREES * np.log1p(z / STUDENT_DEGREES), 1.0 / (1.0 + z / STUDENT_DEGREES)),
}


def evaluate_loss(
    name: LossName, residual: Float[np.ndarray, " n"], spread: float = 1.0
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Cost (c^2 rho, so that linear is r^2) and weight of each residual.

    spread: the width of the bulk in sigmas; 1 when the model fits to the noise, larger when misfit is wide,
    so that a robust loss rejects outliers from the bulk and not the bulk itself.
    """
    if name not in get_args(LossName):
        raise ValueError(f"Unknown loss {name!r}. Use one of {', '.join(get_args(LossName))}.")
    c = TUNING[name] * max(spread, 1.0)
    rho, weight = _RHO[name]((residual / c) ** 2)
    return c**2 * rho, weight


def bulk_spread(residual: Float[np.ndarray, " n"]) -> float:
    """Median absolute residual as a Gaussian sigma (1.4826 MAD), blind to a minority of outliers."""
    return float(1.4826 * np.median(np.abs(residual))) if residual.size else 1.0
