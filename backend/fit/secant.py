"""Slopes over the distance that the data can tell apart, where a simulation is rough at a finer scale.

Impacts and sticking fall into another step when a parameter changes a little, so that an exact derivative says how
one step reacts and not how the motion does: intervals drawn from it are too narrow by whatever the roughness adds.
Central differences over two standard deviations each way see past it; as the deviation follows from them in turn, both
are settled together (statistical linearisation, cf. Gelb 1974, Applied Optimal Estimation, 6.2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from jaxtyping import Float

from backend.fit.misfit import largest
from backend.fit.solve import LeastSquares, Solution, Vector, step_within
from backend.fit.starts import at_once

ROUNDS = 6
FAR = 2.0  # deviations that a difference reaches each way
WIDER = 4.0  # more at first: deviations by the exact derivative are too small if anything
SETTLED = 0.05  # relative change of the distances, or a step in deviations, that ends the rounds
SLACK = 1.0  # by how much roughness alone may raise the objective at a better point: half a chi-square is 0.5
MOST = 0.5  # of its own or its natural size: as far as a difference may reach
LEAST = 1e-3
WORTH = 0.01  # of a variance, that roughness must add to be looked at more closely
HIDDEN = 0.5  # of a slope's square: as much roughness leaves it untold
WIDENS = 4.0  # times a distance over which it is, the next
UNSEEN = 1e-6  # of a column's square, what is left of a slope that is roughness altogether
NARROWER = (1.0, 0.5, 0.5, 0.25, 0.25, 0.125)  # of that, one step after the other
SHORTER = (1.0, 0.5, 0.25)  # of a step, until one is better


@dataclass(frozen=True)
class Differences:
    """slopes: over a distance each way, in some of the unknowns. around: mean residual, whose roughness averages out.
    bends: second difference of every pair; distance: half of what lies between its ends. Both are zero where one end
    was on a bound or lost.
    """

    slopes: Float[np.ndarray, "n c"]
    around: Float[np.ndarray, " n"]
    bends: Float[np.ndarray, "n c"]
    distance: Float[np.ndarray, " c"]


@dataclass(frozen=True)
class Rest:
    """Where such steps came to rest. roughness: what it adds to the covariance; sd: with it and white noise, within
    what a difference may reach.
    """

    x: Vector
    residual: Float[np.ndarray, " n"]
    jacobian: Float[np.ndarray, "n p"]
    roughness: Float[np.ndarray, "p p"]
    sd: Vector
    evaluations: int

    @property
    def covariance(self) -> Float[np.ndarray, "p p"]:
        """Of white noise and roughness, with these deviations."""
        both = _of_noise(self.jacobian) + self.roughness
        scale = self.sd / np.sqrt(np.where(np.diag(both) > 0, np.diag(both), self.sd**2))
        return both * np.outer(scale, scale)


def smoothed(problem: LeastSquares, found: Solution, at_first: Vector | None = None) -> Solution:
    """Gauss-Newton on such slopes from where the search ended; the solution carries them as its Jacobian, and what
    roughness adds to its covariance, which is no less than what it left open before.

    at_first: deviations to begin with where these are wider than a few by the exact derivative, which sees ripples.
    """
    if not np.all(np.isfinite(found.jacobian)) or np.any(found.weights != 1.0):
        return found
    sd = deviations(problem, found.x, found.jacobian, WIDER)
    sd = sd if at_first is None else np.maximum(sd, at_first)
    if found.roughness is not None:
        sd = np.hypot(sd, np.sqrt(np.diag(found.roughness)))
    rest = settle(problem, found.x, found.residual, sd)
    roughness = rest.roughness if found.roughness is None else largest(rest.roughness, found.roughness)
    return replace(
        found, x=rest.x, residual=rest.residual, jacobian=rest.jacobian, roughness=roughness,
        objective=0.5 * float(rest.residual @ rest.residual), evaluations=found.evaluations + rest.evaluations,
    )  # fmt: skip


def settle(
    problem: LeastSquares, x: Vector, r: Float[np.ndarray, " n"], sd: Vector, rounds: int = ROUNDS
) -> Rest:  # fmt: skip
    """Steps by differences over the deviations, and deviations by these differences, in turn until neither changes.

    sd: to begin with, wide rather than narrow: roughness is as fine as one looks.
    """
    objective, J, roughness, evaluations = 0.5 * float(r @ r), np.zeros((r.size, x.size)), np.zeros((x.size, x.size)), 0
    near, least = sd, np.zeros(x.size)
    for _ in range(rounds):
        found = secants(problem, x, r, np.minimum(FAR * near, MOST * _size(problem, x)), range(x.size))
        J, evaluations = found.slopes, evaluations + 2 * x.size
        E = found.bends / np.sqrt(6.0)
        if np.any(np.diag(_of_roughness(found, E)) > WORTH * np.diag(_of_noise(J))):
            E = _scatter(problem, x, r, found)
            evaluations += 2 * int(np.sum(found.distance > 0))
        roughness = _of_roughness(found, E)
        step, before, moved = step_within(problem, x, J, found.around), near, False
        # Roughness has no end towards small distances: what hides a slope there is seen past farther out.
        least = np.where(_steeper(found, E) > HIDDEN, np.maximum(least, WIDENS * near), least)
        sd = np.hypot(deviations(problem, x, J), np.sqrt(np.diag(roughness)))
        near = _within(problem, x, J, np.maximum(np.minimum(sd, WIDENS * near), least))
        sd = _within(problem, x, J, sd)
        for part in SHORTER:
            trial = np.clip(x + part * step, problem.lower, problem.upper)
            at = problem.residual(trial)
            evaluations += 1
            if np.all(np.isfinite(at)) and 0.5 * float(at @ at) < objective + SLACK * (part == 1.0):
                moved = bool(np.any(np.abs(trial - x) >= SETTLED * sd))
                x, r, objective = trial, at, 0.5 * float(at @ at)
                break
        if not moved and np.all(np.abs(near - before) < SETTLED * before):
            break
    return Rest(x, r, J, roughness, sd, evaluations)


def narrowed(problem: LeastSquares, found: Solution) -> Solution:
    """Gauss-Newton by differences over half of each value first, then over less: through roughness that differences as
    narrow as the data tell apart would rest in. Residual and Jacobian are still those of where it began.
    """
    if not np.all(np.isfinite(found.residual)) or np.any(found.weights != 1.0):
        return found
    x, r, objective = found.x, found.residual, 0.5 * float(found.residual @ found.residual)
    for share in NARROWER:
        J = secants(problem, x, r, share * MOST * np.where(x == 0.0, problem.scale, np.abs(x)), range(x.size)).slopes
        step = step_within(problem, x, J, r)
        for part in SHORTER:
            trial = np.clip(x + part * step, problem.lower, problem.upper)
            at = problem.residual(trial)
            if np.all(np.isfinite(at)) and 0.5 * float(at @ at) < objective:
                x, r, objective = trial, at, 0.5 * float(at @ at)
                break
    return replace(found, x=x, objective=objective)


def secants(
    problem: LeastSquares, x: Vector, r: Float[np.ndarray, " n"], reach: Vector, columns: Sequence[int]
) -> Differences:  # fmt: skip
    """Differences over a reach each way; on one side where a bound is nearer or a motion is lost."""
    J, bends, distance = np.zeros((r.size, len(columns))), np.zeros((r.size, len(columns))), np.zeros(len(columns))
    around = r.copy()

    def moved(j: int, side: float) -> tuple[float, Vector]:
        trial = x.copy()
        trial[j] = np.clip(x[j] + side * reach[j], problem.lower[j], problem.upper[j])
        at = problem.residual(trial)
        return (float(trial[j]), at) if np.all(np.isfinite(at)) else (float(x[j]), r)

    ends = at_once([partial(moved, j, side) for j in columns for side in (1.0, -1.0)])
    for k, (j, (high, above), (low, below)) in enumerate(zip(columns, ends[::2], ends[1::2], strict=True)):
        if high > low:
            J[:, k] = (above - below) / (high - low)
        if np.isclose(high - x[j], x[j] - low, rtol=1e-6):
            around = around + above + below
            bends[:, k], distance[k] = above + below - 2.0 * r, 0.5 * (high - low)
    return Differences(J, around / (1 + 2 * int(np.sum(distance > 0))), bends, distance)


def _scatter(problem: LeastSquares, x: Vector, r: Float[np.ndarray, " n"], found: Differences):
    """(n, p): what second differences over the distances and over half of them disagree on, in deviations of one
    simulation's roughness: alone, each is a smooth curve's as well.
    """
    E, columns = np.zeros_like(found.bends), np.flatnonzero(found.distance).tolist()
    half = secants(problem, x, r, 0.5 * found.distance, columns)
    E[:, columns] = np.where(half.distance > 0, found.bends[:, columns] - 4.0 * half.bends, 0.0) / np.sqrt(70.0)
    return E


def _of_noise(J: Float[np.ndarray, "n p"]) -> Float[np.ndarray, "p p"]:
    columns = np.linalg.norm(J, axis=0)
    D = np.where(columns > 0, columns, 1.0)
    return np.linalg.pinv((J / D).T @ (J / D), hermitian=True) / np.outer(D, D)


def _of_roughness(found: Differences, E: Float[np.ndarray, "n p"]) -> Float[np.ndarray, "p p"]:
    """What roughness, of which these are draws, adds to the covariance: it moves the estimate, and it makes slopes look
    steeper than the motion's. Where no draw differs, the motion is as smooth as it gets.
    """
    J, power = found.slopes, np.sum(E**2, axis=0)
    if not np.any(power > 0):
        return np.zeros((J.shape[1], J.shape[1]))
    columns = np.linalg.norm(J, axis=0)
    D = np.where(columns > 0, columns, 1.0)
    information = (J / D).T @ (J / D)
    w, V = np.linalg.eigh(information - np.diag(_steeper(found, E)))
    noise = np.linalg.pinv(information, hermitian=True)
    more, U = np.linalg.eigh(largest((V / np.maximum(w, UNSEEN)) @ V.T, noise) - noise)
    of_slopes = (U * np.maximum(more, 0.0)) @ U.T
    shifts = noise @ (J / D).T @ E
    moved = shifts @ shifts.T / (power.sum() ** 2 / np.sum(power**2))
    return (moved + of_slopes) / np.outer(D, D)


def _steeper(found: Differences, E: Float[np.ndarray, "n p"]) -> Vector:
    """How much of each column's square is roughness: two draws over twice the distance."""
    squares = np.sum(found.slopes**2, axis=0) * found.distance**2
    return np.where(squares > 0, np.sum(E**2, axis=0) / (2.0 * np.where(squares > 0, squares, 1.0)), 0.0)


def deviations(problem: LeastSquares, x: Vector, J: Float[np.ndarray, "n p"], wider: float = 1.0) -> Vector:
    """Standard deviations of white noise, or a multiple of them, within what a difference may reach."""
    return _within(problem, x, J, wider * np.sqrt(np.maximum(np.diag(_of_noise(J)), 0.0)))


def _within(problem: LeastSquares, x: Vector, J: Float[np.ndarray, "n p"], sd: Vector) -> Vector:
    size = _size(problem, x)
    sd = np.where(np.any(J != 0.0, axis=0), sd, MOST * size)
    return np.clip(sd, np.minimum(LEAST * np.abs(x) + 1e-9 * size, MOST * size), MOST * size)


def _size(problem: LeastSquares, x: Vector) -> Vector:
    return np.maximum(np.abs(x), problem.scale)
