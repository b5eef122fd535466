"""Soft one-sided contact by Hunt and Crossley's law: force = k d^1.5 (1 + c ḋ), never a pull.

K. H. Hunt, F. R. E. Crossley, J. Appl. Mech. 42 (1975) 440.
"""

from __future__ import annotations

import numpy as np

STATIC_DEPTH = 0.15  # of the play: how far weight alone presses a pin into its hole
LOSS_S_PER_M = 20.0  # c of metals and plastics at walking-pace blows: most of the energy of a slow blow is kept back
STOP_LOSS_S_PER_RAD = 5.0


def hunt_crossley(depth: np.ndarray, speed: np.ndarray, stiffness: np.ndarray | float, loss: float) -> np.ndarray:
    """The push for a depth [m or rad] that grows at `speed`; zero where there is no touch."""
    deep = np.maximum(depth, 0.0)
    return np.maximum(stiffness * deep**1.5 * (1 + loss * speed), 0.0) * (depth > 0)


def in_hole(offset: np.ndarray, speed: np.ndarray, play: np.ndarray, mass: np.ndarray) -> np.ndarray:
    """What a hole puts on a pin `offset` from its middle [m], complex (rows, pins) [N]; play: radial [m]."""
    away = np.abs(offset)
    normal = offset / np.where(away > 0, away, 1.0)
    outward = np.real(speed * np.conj(normal))
    stiffness = 9.80665 * mass[:, None] / np.maximum(STATIC_DEPTH * play, 1e-6) ** 1.5
    return -normal * hunt_crossley(away - play, outward, stiffness, LOSS_S_PER_M)
