"""Several starts: the same search from scattered starting values, one on each core."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from jaxtyping import Float

from backend.fit.solve import Solution


def at_once(searches: Sequence[Callable[[], Solution]]) -> list[Solution]:
    """Where several searches end, in their order."""
    with ThreadPoolExecutor(max_workers=os.cpu_count() or 1) as pool:
        return list(pool.map(lambda search: search(), searches))


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
