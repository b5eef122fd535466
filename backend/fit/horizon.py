"""Long free swings have many local minima; a short one has few. Fit the start, then lengthen.

Also multi-starts: the same search from scattered starting values, the best one wins and the others are told.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from backend.fit.solve import LeastSquares, Solution, solve


def lengthen(
    problem_for: Callable[[float], LeastSquares],
    start: Float[np.ndarray, " p"],
    fractions: Sequence[float] = (0.05, 0.2, 0.5, 1.0),
    **options,
) -> Solution:
    """Solve for the first fraction of the time, and go on from there with the next.

    problem_for(fraction): the residuals of that share of every record; the last fraction must be 1. Early
    stages stop early: they only have to lead into the right valley. The history is that of all stages.
    """
    if not fractions or fractions[-1] != 1.0:
        raise ValueError(f"The last fraction of a horizon must be 1, not {list(fractions)}.")
    x, history, evaluations = np.asarray(start, float), (), 0
    solution = None
    for fraction in fractions:
        final = fraction == 1.0
        stage = options if final else options | {"max_iterations": 12, "ftol": 1e-4}
        solution = solve(problem_for(fraction), x, **stage)
        offset = len(history)
        history += tuple(replace(i, iteration=offset + i.iteration) for i in solution.history)
        evaluations += solution.evaluations
        if solution.status == "cancelled":
            break
        if solution.status != "not_finite_at_start":
            x = solution.x
    assert solution is not None  # fractions is not empty
    return replace(solution, history=history, evaluations=evaluations)


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
