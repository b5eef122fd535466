"""Several starts: the same search from scattered starting values; what goes at the same time, one on each core."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import numpy as np
from jaxtyping import Float

Made = TypeVar("Made")


def at_once(makers: Sequence[Callable[[], Made]]) -> list[Made]:
    """What several searches or simulations make, in their order."""
    with ThreadPoolExecutor(max_workers=os.cpu_count() or 1) as pool:
        return list(pool.map(lambda make: make(), makers))


def scattered(
    start: Float[np.ndarray, " p"],
    scale: Float[np.ndarray, " p"],
    lower: Float[np.ndarray, " p"],
    upper: Float[np.ndarray, " p"],
    count: int,
    moved: Sequence[bool],
    seed: int = 0,
) -> list[Float[np.ndarray, " p"]]:
    """The start itself, then `count` others scattered by one natural scale where `moved`, in the bounds."""
    rng = np.random.default_rng(seed)
    kick = rng.standard_normal((count, start.size)) * scale * np.asarray(moved)
    return [start, *np.clip(start + kick, lower, upper)]
