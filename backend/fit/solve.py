"""Bounded, scaled nonlinear least squares on whitened residuals.

Minimises  1/2 sum_i rho(r_i(x)^2)  subject to  lower <= x <= upper.

Each Levenberg-Marquardt step solves its linear model inside the box *exactly* (bounded-variable least
squares, Stark and Parker 1995): a parameter resting on a bound costs nothing and leaves it when the data ask.
Damping is scaled by the largest column norms seen (Moré 1978), which makes the path independent of units.
A residual that is not finite (a simulation that ran away) rejects the step; it never ends the fit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from jaxtyping import Float
from scipy.optimize import lsq_linear, minimize

from backend.fit.loss import LossName, bulk_spread, evaluate_loss

Vector = Float[np.ndarray, " p"]
TraceBack = Callable[[Vector, Float[np.ndarray, " n"]], Vector]
Status = Literal["converged", "rough", "iteration_limit", "disagree", "not_finite_at_start", "cancelled"]
Optimiser = Literal["lm", "lbfgsb"]

# Sticking and impacts make a simulated residual rough at a fine scale: each reversal falls into another step.
# There the exact derivative is not the slope that counts, and steps go on gaining next to nothing.
STRIDE = 2.0  # of its own or its natural size: what a parameter may change by in one iteration
PATIENCE = 3  # accepted steps that together must gain
ROUGH = 2e-4  # this share of the objective; the sd of a parameter moves it by 1/n for n samples
FORETOLD = 0.5  # by how much a gain may differ from what kept slopes promise: their next error is half the last
UNSEEN = 1e-12  # of the widest singular value: what kept slopes see less of is left alone
STILL_IMPROVING = "Stopped after {} iterations, still improving. Allow more iterations or free fewer parameters."
NO_STEP_ROUGH = "Converged as far as the simulation is smooth: no step lowers the objective further."
NO_STEP = (
    "No step lowers the objective, though its slope promises {:.1e} of it: derivative and simulation disagree. "
    "Use a smaller step or another start."
)


@dataclass(frozen=True)
class LeastSquares:
    """Whitened residuals of p parameters, with their bounds and natural scales.

    residual: x -> r (n); may be non-finite where the simulation fails.
    linearise: x -> (r, J), J (n, p) = dr/dx.
    data_rows: how many leading rows are data; the rest are priors, which a robust loss leaves alone.
    trace_back: (x, w) -> J'w, where that and the residual alone cost much less than J.
    """

    names: Sequence[str]
    residual: Callable[[Vector], Float[np.ndarray, " n"]]
    linearise: Callable[[Vector], tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n p"]]]
    lower: Vector
    upper: Vector
    scale: Vector
    data_rows: int | None = None
    trace_back: TraceBack | None = None

    def __post_init__(self):
        for name, lower, upper, scale in zip(self.names, self.lower, self.upper, self.scale, strict=True):
            if not lower < upper:
                raise ValueError(f"{name}: lower bound {lower:g} is not below upper bound {upper:g}. Fix the bounds.")
            if not (np.isfinite(scale) and scale > 0):
                raise ValueError(f"{name}: natural scale {scale:g} must be positive. Give its typical size.")


@dataclass(frozen=True)
class Iteration:
    """One accepted step: the objective is 1/2 sum rho; gradient_norm is max |scale * dObjective/dx| free."""

    iteration: int
    objective: float
    gradient_norm: float
    parameters: Vector


@dataclass(frozen=True)
class Solution:
    """Where the search ended, and how: r and J are whitened and unweighted, weights are the robust ones.

    roughness: covariance that the simulation itself adds where it is rough at a finer scale than data tell apart, None
    where no one looked.
    """

    x: Vector
    residual: Float[np.ndarray, " n"]
    jacobian: Float[np.ndarray, "n p"]
    weights: Float[np.ndarray, " n"]
    objective: float
    status: Status
    message: str
    at_bound: tuple[bool, ...]
    history: tuple[Iteration, ...] = field(repr=False)
    evaluations: int = 0
    roughness: Float[np.ndarray, "p p"] | None = None

    @property
    def converged(self) -> bool:
        """True also for `rough`: the objective is not smooth enough to go on, and the rest is below noise."""
        return self.status in ("converged", "rough")


@dataclass
class _Cost:
    """The robust objective, with the width of the loss fixed while one search runs."""

    problem: LeastSquares
    loss: LossName
    spread: float = 1.0

    def __call__(self, r: np.ndarray) -> tuple[float, np.ndarray]:
        if not np.all(np.isfinite(r)):
            return np.inf, np.ones_like(r)
        n = r.size if self.problem.data_rows is None else self.problem.data_rows
        cost, weight = evaluate_loss(self.loss, r[:n], self.spread)
        return 0.5 * float(cost.sum() + r[n:] @ r[n:]), np.concatenate([weight, np.ones(r.size - n)])


def robust_weights(loss: LossName, r: Float[np.ndarray, " n"], data_rows: int) -> Float[np.ndarray, " n"]:
    """Weights of a robust loss as wide as the bulk of these residuals; 1 for priors, and where r is not finite."""
    weights = np.ones_like(r)
    if loss != "linear" and np.all(np.isfinite(r)):
        weights[:data_rows] = evaluate_loss(loss, r[:data_rows], max(bulk_spread(r[:data_rows]), 1.0))[1]
    return weights


def solve(
    problem: LeastSquares,
    start: Vector,
    *,
    optimiser: Optimiser = "lm",
    loss: LossName = "linear",
    max_iterations: int = 60,
    ftol: float = 1e-9,
    gtol: float = 1e-9,
    refusals: int = 12,
    progress: Callable[[Iteration], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
    slopes: Float[np.ndarray, "n p"] | None = None,
) -> Solution:
    """Minimise from `start` (clipped into the box).

    ftol: stop when neither the model nor the objective can gain this fraction. gtol: stop when every free
    column is this orthogonal to the residual (cosine). refusals: trial steps refused in a row that end the search.
    slopes: J of a place nearby, kept as long as it serves; the problem can trace back, and an end that its gradient
    foresees does without its own J.
    Failures come back as a status with a sentence.
    """
    x = np.clip(np.asarray(start, float), problem.lower, problem.upper)
    r, J = problem.linearise(x) if slopes is None else (problem.residual(x), slopes)
    cost = _Cost(problem, loss)
    if not (np.all(np.isfinite(r)) and np.all(np.isfinite(J))):
        bad = int(np.sum(~np.isfinite(r)))
        return Solution(
            x, r, J, np.ones_like(r), np.inf, "not_finite_at_start",
            f"The simulation is not finite at the starting values ({bad} of {r.size} residuals). "
            "Start from other values, shorten the horizon, or use a smaller step.",
            _at_bound(problem, x), (), 1,
        )  # fmt: skip
    search = _levenberg_marquardt if optimiser == "lm" else _lbfgsb
    rest = (max_iterations, ftol, gtol, refusals, progress, cancelled, slopes is not None)
    if loss == "linear":
        return search(problem, cost, x, r, J, *rest)
    # The loss is as wide as the bulk of the residuals, which is known only once they fit: a few rounds settle it.
    history: tuple[Iteration, ...] = ()
    while True:
        cost.spread = max(bulk_spread(r[: problem.data_rows]), 1.0)
        found = search(problem, cost, x, r, J, *rest)
        history += tuple(replace(i, iteration=len(history) + k) for k, i in enumerate(found.history))
        found, x, r, J = replace(found, history=history), found.x, found.residual, found.jacobian
        after = max(bulk_spread(r[: problem.data_rows]), 1.0)
        if not found.converged or len(history) > max_iterations or after > 0.95 * cost.spread:
            return found


def _at_bound(problem: LeastSquares, x: Vector) -> tuple[bool, ...]:
    slack = 1e-9 * problem.scale
    return tuple(bool(b) for b in (x <= problem.lower + slack) | (x >= problem.upper - slack))


def _free(problem: LeastSquares, x: Vector, gradient: Vector) -> np.ndarray:
    """Parameters that the gradient does not press against a bound."""
    slack = 1e-12 * problem.scale
    return ~(((x <= problem.lower + slack) & (gradient > 0)) | ((x >= problem.upper - slack) & (gradient < 0)))


@dataclass(frozen=True)
class _Quadratic:
    """The objective around a point: gradient @ s + 1/2 |R s|^2, with R' Qr the gradient and R's column norms.

    kept: whether R is that of an earlier point.
    """

    gradient: Vector
    R: Float[np.ndarray, "p p"]
    Qr: Vector
    columns: Vector
    kept: bool = False

    @classmethod
    def of(cls, J: Float[np.ndarray, "n p"], r: Float[np.ndarray, " n"]) -> _Quadratic:
        Q, R = np.linalg.qr(J)
        # Slopes of a lost motion reach 1e200, whose square is no number; powers of two leave every digit.
        size = np.exp2(np.frexp(np.max(np.abs(R), axis=0))[1])
        return cls(R.T @ (Q.T @ r), R, Q.T @ r, size * np.linalg.norm(R / size, axis=0))

    def with_gradient(self, gradient: Vector) -> _Quadratic | None:
        """The same curvature where the gradient is another, None where there is none; what R hardly sees is left to
        slopes of that place.
        """
        if not np.all(np.isfinite(gradient)):
            return None
        D = np.where(self.columns > 0, self.columns, 1.0)
        Qr, *_ = np.linalg.lstsq((self.R / D).T, gradient / D, rcond=UNSEEN)
        return replace(self, gradient=gradient, Qr=Qr, kept=True)

    def change(self, step: Vector) -> float:
        return float(self.gradient @ step + 0.5 * np.sum((self.R @ step) ** 2))


def _levenberg_marquardt(
    problem, cost, x, r, J, max_iterations, ftol, gtol, refusals, progress, cancelled, elsewhere
) -> Solution:
    """elsewhere: J is that of a place nearby, and an end that a gradient or the caller tells does without its own."""
    objective, weight = cost(r)
    damping, growth, evaluations = 1e-3, 2.0, 1
    widest = np.zeros_like(x)
    history: list[Iteration] = []

    def end(status: Status, message: str) -> Solution:
        return Solution(x, r, J, weight, objective, status, message, _at_bound(problem, x), tuple(history), evaluations)

    model = _Quadratic.of(np.sqrt(weight)[:, None] * J, np.sqrt(weight) * r)
    if elsewhere:
        model = model.with_gradient(problem.trace_back(x, weight * r)) or model
    while True:
        widest = np.maximum(widest, model.columns)
        free = _free(problem, x, model.gradient)
        if not history or history[-1].parameters is not x:
            norm = float(np.max(np.abs(problem.scale * model.gradient)[free], initial=0.0))
            history.append(Iteration(len(history), objective, norm, x))
            if progress is not None:
                progress(history[-1])
        ending = _at_rest(history, model, free, np.sqrt(weight) * r, damping, max_iterations, ftol, gtol)
        refused, gain, told = 0, 0.0, False
        while ending is None:  # until a step is accepted
            if cancelled is not None and cancelled():
                ending = "cancelled", f"Cancelled after {len(history) - 1} iterations."
                told = True
                break
            step = _step_in_box(problem, x, model.R, model.Qr, damping, widest)
            predicted = -model.change(step)
            if predicted <= ftol * objective and damping < 1.0:
                ending = "converged", f"Converged: no step can gain more than {ftol:g} of the objective."
                told = True
                break
            trial = np.clip(x + step, problem.lower, problem.upper)
            ahead = problem.residual(trial)
            evaluations += 1
            gain = (objective - cost(ahead)[0]) / max(predicted, 1e-300)
            if gain > 1e-4:
                x, r = trial, ahead
                damping = max(damping * max(1.0 / 3.0, 1.0 - (2.0 * gain - 1.0) ** 3), 1e-12)  # Nielsen (1999)
                growth = 2.0
                break
            # Well-behaved steps have let the damping fall far: a refusal brings it back at once.
            damping, growth = max(damping * growth, 1e-3), 2.0 * growth
            refused += 1
            if model.kept or damping > 1e5 or refused >= refusals:
                best = _step_in_box(problem, x, model.R, model.Qr, 1e-12, widest)
                share = -float(model.gradient @ best) / 2.0 / max(objective, 1e-300)
                ending = ("rough", NO_STEP_ROUGH) if share < 1e-3 else ("disagree", NO_STEP.format(share))
        if ending is not None and (not model.kept or (elsewhere and told)):
            return end(*ending)
        if ending is None and problem.trace_back is not None and abs(gain - 1.0) < FORETOLD:
            objective, weight = cost(r)
            if (kept := model.with_gradient(problem.trace_back(x, weight * r))) is not None:
                model = kept
                continue
        r, J = problem.linearise(x)  # also where kept slopes see no way on: only slopes of its own end a search
        objective, weight = cost(r)
        if not np.all(np.isfinite(J)):
            return end("disagree", "The derivative of the simulation is not finite here. Use a smaller step.")
        model = _Quadratic.of(np.sqrt(weight)[:, None] * J, np.sqrt(weight) * r)


def _at_rest(
    history: Sequence[Iteration], model: _Quadratic, free: np.ndarray, r: np.ndarray, damping: float,
    max_iterations: int, ftol: float, gtol: float,
) -> tuple[Status, str] | None:  # fmt: skip
    """Why the search ends with its last step, if it does; r in robust weights."""
    objective = history[-1].objective
    cosine = np.abs(model.gradient) / np.maximum(model.columns * np.linalg.norm(r), 1e-300)
    if np.max(cosine[free], initial=0.0) <= gtol:
        return "converged", "Converged: the residual is orthogonal to every free parameter."
    if len(history) > PATIENCE and history[-1 - PATIENCE].objective - objective < ROUGH * objective:
        return "rough", f"Converged as far as the simulation is smooth: {PATIENCE} steps gained little."
    if len(history) > 1 and damping < 1.0 and history[-2].objective - objective <= ftol * objective:
        return "converged", f"Converged: the last step gained no more than {ftol:g} of the objective."
    if len(history) > max_iterations:
        return "iteration_limit", STILL_IMPROVING.format(max_iterations)
    return None


def _step_in_box(problem, x, R, Qr, damping, widest) -> Vector:
    """argmin |R p + Q'r|^2 + damping |D p|^2 inside the box and within a stride, D the widest columns seen.

    What the data hardly see would otherwise be sent wherever rounding points.
    """
    D = np.where(widest > 0, widest, 1.0 / problem.scale)
    A = np.vstack([R / D, np.sqrt(damping) * np.eye(x.size)])
    b = np.concatenate([-Qr, np.zeros(x.size)])
    stride = STRIDE * np.maximum(np.abs(x), problem.scale)
    low, high = D * np.maximum(problem.lower - x, -stride), D * np.minimum(problem.upper - x, stride)
    free = np.linalg.lstsq(A, b, rcond=None)[0]
    if np.all((free >= low) & (free <= high)):
        return free / D
    return lsq_linear(A, b, (np.minimum(low, 0.0), np.maximum(high, 0.0)), method="bvls").x / D


def step_within(problem: LeastSquares, x: Vector, J: Float[np.ndarray, "n p"], r: Float[np.ndarray, " n"]) -> Vector:
    """The Gauss-Newton step inside the box and within a stride."""
    Q, R = np.linalg.qr(J)
    return _step_in_box(problem, x, R, Q.T @ r, 1e-12, np.linalg.norm(R, axis=0))


def _lbfgsb(
    problem, cost, x, r, J, max_iterations, ftol, gtol, refusals, progress, cancelled, elsewhere
) -> Solution:  # fmt: skip
    """Quasi-Newton on the same objective in scaled variables; for comparison, it does not see J'J."""
    history: list[Iteration] = []
    last: dict[str, np.ndarray] = {}
    state = {"objective": cost(r)[0], "evaluations": 0}

    class _Cancelled(Exception):
        pass

    traced_back = problem.trace_back or (lambda at, w: problem.linearise(at)[1].T @ w)

    def value(z):
        at = np.clip(z * problem.scale, problem.lower, problem.upper)
        rr = problem.residual(at)
        state["evaluations"] += 1
        f, w = cost(rr)
        g = problem.scale * traced_back(at, w * rr) if np.isfinite(f) else np.full_like(z, np.nan)
        if not np.all(np.isfinite(g)):
            return 1e6 * (1.0 + abs(state["objective"])), np.zeros_like(z)  # a wall: the line search backs off
        last.update(z=z.copy(), g=g, f=np.array(f))
        return f, g

    def record(z):
        at = np.clip(z * problem.scale, problem.lower, problem.upper)
        g = last["g"]
        free = _free(problem, at, g)
        history.append(Iteration(len(history), float(last["f"]), float(np.max(np.abs(g[free]), initial=0.0)), at))
        if progress is not None:
            progress(history[-1])
        if cancelled is not None and cancelled():
            raise _Cancelled

    bounds = list(zip(problem.lower / problem.scale, problem.upper / problem.scale, strict=True))
    status: Status
    try:
        value(x / problem.scale)
        record(x / problem.scale)
        found = minimize(
            value, x / problem.scale, jac=True, method="L-BFGS-B", bounds=bounds, callback=record,
            options={"maxiter": max_iterations, "ftol": ftol * 1e-2, "gtol": gtol},
        )  # fmt: skip
        x = np.clip(found.x * problem.scale, problem.lower, problem.upper)
        status = "converged" if found.status == 0 else "iteration_limit"
        message = f"L-BFGS-B: {found.message}"
    except _Cancelled:
        x, status, message = history[-1].parameters, "cancelled", "Cancelled."
    r, J = problem.linearise(x)
    objective, weight = cost(r)
    return Solution(
        x, r, J, weight, objective, status, message, _at_bound(problem, x), tuple(history),
        state["evaluations"],
    )  # fmt: skip
