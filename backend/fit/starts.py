"""Several starts: the same search from scattered starting values, the best one wins and the others are told."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from backend.fit.solve import Solution


def best_of(
    run: Callable[[Float[np.ndarray, " p"]], Solution],
    starts: Sequence[Float[np.ndarray, " p"]],
    cost: Callable[[Solution], float] = lambda found: found.objective,
    stop: Callable[[Solution], bool] = lambda found: False,
) -> tuple[Solution, list[Solution]]:
    """The search of lowest cost among those from several starts, and all of them in order.

    cost is asked for once, right after each search; one that says stop is the last.
    """
    found: list[Solution] = []
    costs: list[float] = []
    for start in starts:
        found.append(run(start))
        costs.append(cost(found[-1]))
        if stop(found[-1]):
            break
    return found[int(np.argmin(costs))], found


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
