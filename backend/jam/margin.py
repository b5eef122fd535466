"""By how much: the least drive and the greatest friction that free a mechanism, each found by simulating it."""

import math
from collections.abc import Callable

from backend.jam.scene import Scene

MOST_DRIVE = 100.0  # times the drive: what no drive up to this frees is locked
LADDER = (2.0, 10.0, 30.0)  # also tried: a drive can free at some strength and hold at a greater one
WITHIN = 5e-3  # relative width of the answer
BESIDE = 0.006  # relative distance of the two simulations that confirm what the friction cone says


def drive_factor(scene: Scene, hint: float) -> float | None:
    """The least factor on the drives that frees it, to 0.5%; None where none up to 100 does.  hint: a first guess."""

    def free(factor: float) -> bool:
        return scene.moves(drive=factor)

    if 1.0 < hint < MOST_DRIVE and (found := _confirmed(free, hint)):
        return found
    high = next((factor for factor in (MOST_DRIVE, *LADDER) if free(factor)), None)
    if high is None:
        return None
    low = 1.0
    while high / low > 1.0 + WITHIN:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if free(middle) else (middle, high)
    return math.sqrt(low * high)


def friction_factor(scene: Scene, hint: float) -> float | None:
    """The greatest factor on all friction that frees it, to 0.5%; None where it stays without any."""

    def stuck(factor: float) -> bool:
        return not scene.moves(friction=factor)

    if 0.0 < hint < 1.0 and (found := _confirmed(stuck, hint)):
        return found
    if stuck(0.0):
        return None
    low, high = 0.0, 1.0
    while high - low > WITHIN * max(high, 0.01):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if stuck(middle) else (middle, high)
    return 0.5 * (low + high)


def _confirmed(above: Callable[[float], bool], hint: float) -> float | None:
    """The hint, where the simulation changes its answer across it."""
    high, low = hint * (1.0 + BESIDE), hint * (1.0 - BESIDE)
    return hint if above(high) and not above(low) else None
