"""Slopes over the distance that the data can tell apart, where a simulation is rough at a finer scale.

Impacts and sticking fall into another step when a parameter changes a little, so that an exact derivative says how
one step reacts and not how the motion does: intervals drawn from it are too narrow by whatever the roughness adds.
Central differences over two standard deviations each way see past it; as the deviation follows from them in turn, both
are settled together (statistical linearisation, cf. Gelb 1974, Applied Optimal Estimation, 6.2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from backend.fit.solve import LeastSquares, Solution, Vector, step_within

ROUNDS = 6
FAR = 2.0  # deviations that a difference reaches each way
WIDER = 4.0  # more at first: deviations by the exact derivative are too small if anything
SETTLED = 0.1  # relative change of the deviations that ends the rounds
SLACK = 1.0  # by how much roughness alone may raise the objective at a better point: half a chi-square is 0.5
MOST = 0.5  # of its own or its natural size: as far as a difference may reach
LEAST = 1e-3
NARROWER = (1.0, 0.5, 0.5, 0.25, 0.25, 0.125)  # of that, one step after the other
SHORTER = (1.0, 0.5, 0.25)  # of a step, until one is better


def smoothed(problem: LeastSquares, found: Solution) -> Solution:
    """Gauss-Newton on such slopes from where the search ended; the solution carries them as its Jacobian."""
    if not np.all(np.isfinite(found.jacobian)) or np.any(found.weights != 1.0):
        return found
    x, r, J, objective = found.x, found.residual, found.jacobian, 0.5 * float(found.residual @ found.residual)
    sd, evaluations = _deviations(problem, x, J, WIDER), found.evaluations
    for _ in range(ROUNDS):
        J, around = secants(problem, x, r, FAR * sd, range(x.size))
        evaluations += 2 * x.size
        trial = np.clip(x + step_within(problem, x, J, around), problem.lower, problem.upper)
        at = problem.residual(trial)
        evaluations += 1
        better = np.all(np.isfinite(at)) and 0.5 * float(at @ at) < objective + SLACK
        before, sd = sd, _deviations(problem, x, J)
        settled = bool(np.all(np.abs(sd - before) < SETTLED * before))
        if better:
            settled &= bool(np.all(np.abs(trial - x) < SETTLED * sd))
            x, r, objective = trial, at, 0.5 * float(at @ at)
        if settled:
            break
    return replace(found, x=x, residual=r, jacobian=J, objective=objective, evaluations=evaluations)


def narrowed(problem: LeastSquares, found: Solution) -> Solution:
    """Gauss-Newton by differences over half of each value first, then over less: through roughness that differences as
    narrow as the data tell apart would rest in. Residual and Jacobian are still those of where it began.
    """
    if not np.all(np.isfinite(found.residual)) or np.any(found.weights != 1.0):
        return found
    x, r, objective = found.x, found.residual, 0.5 * float(found.residual @ found.residual)
    for share in NARROWER:
        J, _ = secants(problem, x, r, share * MOST * np.where(x == 0.0, problem.scale, np.abs(x)), range(x.size))
        step = step_within(problem, x, J, r)
        for part in SHORTER:
            trial = np.clip(x + part * step, problem.lower, problem.upper)
            at = problem.residual(trial)
            if np.all(np.isfinite(at)) and 0.5 * float(at @ at) < objective:
                x, r, objective = trial, at, 0.5 * float(at @ at)
                break
    return replace(found, x=x, objective=objective)


def _deviations(problem: LeastSquares, x: Vector, J: Float[np.ndarray, "n p"], wider: float = 1.0) -> Vector:
    """Standard deviations of white noise, or a multiple of them, within what a difference may reach."""
    columns = np.linalg.norm(J, axis=0)
    scaled = J / np.where(columns > 0, columns, 1.0)
    reach = np.maximum(np.abs(x), problem.scale)
    spread = wider * np.sqrt(np.maximum(np.diag(np.linalg.pinv(scaled.T @ scaled, hermitian=True)), 0.0))
    sd = np.where(columns > 0, spread / np.where(columns > 0, columns, 1.0), MOST * reach)
    return np.clip(sd, np.minimum(LEAST * np.abs(x) + 1e-9 * reach, MOST * reach), MOST * reach)


def secants(
    problem: LeastSquares, x: Vector, r: Float[np.ndarray, " n"], reach: Vector, columns: Sequence[int]
) -> tuple[Float[np.ndarray, "n c"], Float[np.ndarray, " n"]]:
    """Differences over a reach each way, and the mean residual around x, whose roughness is averaged out.

    On one side where a bound is nearer or a motion is lost; such a pair stays out of the mean.
    """
    J, around, points = np.zeros((r.size, len(columns))), r.copy(), 1
    for k, j in enumerate(columns):
        ends = []
        for side in (1.0, -1.0):
            moved = x.copy()
            moved[j] = np.clip(x[j] + side * reach[j], problem.lower[j], problem.upper[j])
            at = problem.residual(moved)
            ends.append((moved[j], at) if np.all(np.isfinite(at)) else (x[j], r))
        (high, above), (low, below) = ends
        if high > low:
            J[:, k] = (above - below) / (high - low)
        if np.isclose(high - x[j], x[j] - low, rtol=1e-6):
            around, points = around + above + below, points + 2
    return J, around / points
