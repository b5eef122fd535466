"""Smooth bumps: what is unknown against time, or over what a joint passes through, is made of them."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

WIDE = 0.7  # of their spacing


def bells(at: Float[np.ndarray, " n"], middles: Float[np.ndarray, " bumps"]) -> Float[np.ndarray, "n bumps"]:
    """Bumps of height one about middles that are evenly spaced."""
    return np.exp(-0.5 * ((at[:, None] - middles) / width(middles)) ** 2)


def width(middles: Float[np.ndarray, " bumps"]) -> float:
    """Their standard deviation, in units of the middles."""
    return WIDE * float(middles[1] - middles[0])


def bumps_at(time_s: Float[np.ndarray, " n"], duration_s: float, waves: int) -> Float[np.ndarray, "n waves"]:
    """Evenly over a record, at any times since its release; the first and the last in the middle of its ends."""
    return bells(time_s, np.linspace(0.0, duration_s, waves))


def bumps(steps: int, step_s: float, duration_s: float, waves: int) -> Float[np.ndarray, "nodes waves"]:
    """The same at the nodes of a motion."""
    return bumps_at(step_s * np.arange(steps + 1), duration_s, waves)
