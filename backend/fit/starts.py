"""Several starts: the same search from scattered starting values, the best one wins and the others are told."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from backend.fit.solve import Solution


def best_of(
    run: Callable[[Float[np.ndarray, " p"]], Solution], starts: Sequence[Float[np.ndarray, " p"]]
) -> tuple[Solution, list[Solution]]:
    """The lowest objective among searches from several starts, and all of them in order."""
    found = [run(s) for s in starts]
    return min(found, key=lambda s: s.objective), found


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
