"""What the data can and cannot tell: information, covariance, weak directions, profile likelihoods."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int
from scipy.stats import chi2, norm

from backend.fit.misfit import misfit_covariance
from backend.fit.solve import LeastSquares, Solution, solve
from backend.mechanism.ratios import times

Z95 = float(norm.ppf(0.975))
CHI2_95 = float(chi2.ppf(0.95, 1))
UNIDENTIFIED = 1e-6  # singular values of the column-scaled Jacobian below this share of the largest
CORRELATED = 0.95


@dataclass(frozen=True)
class Uncertainty:
    """Everything local that the Jacobian and the residuals say, per parameter (p).

    information: curvature of the objective along each parameter alone, others fixed. covariance: inflated for
    misfit (see `misfit`) and roughness (see `secant`); noise_sd: what white noise of `spread` sigmas would leave.
    chi_square_per_point: 1 when the model fits to the noise.
    """

    names: tuple[str, ...]
    information: Float[np.ndarray, " p"]
    covariance: Float[np.ndarray, "p p"]
    noise_sd: Float[np.ndarray, " p"]
    chi_square_per_point: float
    spread: float
    unidentified: tuple[bool, ...]
    weakest: dict[str, float]
    warnings: tuple[str, ...]

    @property
    def sd(self) -> Float[np.ndarray, " p"]:
        """Standard deviations; infinite for a parameter the data say nothing about."""
        return np.where(self.unidentified, np.inf, np.sqrt(np.diag(self.covariance)))

    @property
    def correlation(self) -> Float[np.ndarray, "p p"]:
        """Correlation matrix of the estimates, noise-only shape kept by the inflation."""
        d = np.sqrt(np.diag(self.covariance))
        d = np.where(d > 0, d, 1.0)
        return np.clip(self.covariance / np.outer(d, d), -1.0, 1.0)


def assess(
    names: Sequence[str],
    solution: Solution,
    scale: Float[np.ndarray, " p"],
    run: Int[np.ndarray, " n"],
    instant: Int[np.ndarray, " n"],
    reported: Sequence[bool] | None = None,
    spread: float = 1.0,
) -> Uncertainty:
    """Local uncertainty at a solution; run and instant say which experiment and when (see `misfit`).

    reported: parameters to warn about; nuisances (initial states) are left out of the sentences.
    spread: misfit in sigmas by which the residuals were already divided (see `residual`).
    """
    reported = [True] * len(names) if reported is None else list(reported)
    root = np.sqrt(solution.weights)
    J, r = root[:, None] * solution.jacobian, root * solution.residual
    columns = np.linalg.norm(J, axis=0)
    D = np.where(columns > 0, columns, 1.0)
    _, s, Vt = np.linalg.svd(J / D, full_matrices=False)
    weak = s < UNIDENTIFIED * s[0] if s[0] > 0 else np.ones_like(s, bool)
    # A parameter is unidentified when a direction the data do not see moves it.
    touched = np.sqrt(np.sum(Vt[weak] ** 2, axis=0)) > 1e-3
    unidentified = touched | (columns == 0)
    inverse = np.where(weak, 0.0, 1.0 / np.where(weak, 1.0, s))
    noise_only = (Vt.T * inverse**2) @ Vt / np.outer(D, D)
    covariance = misfit_covariance(J, r, run, instant, noise_only)
    if solution.roughness is not None:
        covariance = covariance + solution.roughness
    data = run >= 0
    degrees = max(int(data.sum()) - len(names), 1)
    chi = spread**2 * float(r[data] @ r[data]) / degrees
    # The weakest direction is judged in natural scales: sd per scale, not per column norm.
    sub = np.flatnonzero(reported)
    _, W = np.linalg.eigh((covariance / np.outer(scale, scale))[np.ix_(sub, sub)])
    if np.any(unidentified[sub]):
        direction = np.zeros(len(names))
        direction[:] = np.where(columns == 0, 1.0, 0.0) if np.any(columns == 0) else Vt[-1] / D
        direction = direction[sub] / scale[sub]
    else:
        direction = W[:, -1]
    size = np.linalg.norm(direction)
    direction = direction / size if size > 0 else direction
    weakest = {names[i]: float(d) for i, d in zip(sub.tolist(), direction, strict=True) if abs(d) > 0.05}
    result = Uncertainty(
        tuple(names), columns**2, covariance, np.sqrt(np.diag(noise_only)), chi, spread,
        tuple(bool(u) for u in unidentified), weakest, (),
    )  # fmt: skip
    return replace(result, warnings=tuple(_sentences(result, solution, scale, reported)))


def _sentences(u: Uncertainty, solution: Solution, scale: np.ndarray, reported: Sequence[bool]):
    sd, rho = u.sd, u.correlation
    shown = [i for i, keep in enumerate(reported) if keep]
    for i in shown:
        name = u.names[i]
        if u.unidentified[i]:
            yield (
                f"{name} cannot be told from these data: the motion does not depend on it, or only with "
                "others. Fix it, or measure something it moves."
            )
        elif solution.at_bound[i]:
            yield f"{name} rests on its bound {solution.x[i]:.4g}; its interval is one-sided."
        elif sd[i] > max(abs(solution.x[i]), 1e-300):
            yield f"{name} = {solution.x[i]:.3g} +- {sd[i]:.2g} is not significantly different from zero."
    for a, i in enumerate(shown):
        for j in shown[a + 1 :]:
            if abs(rho[i, j]) > CORRELATED and not (u.unidentified[i] or u.unidentified[j]):
                kind = "trade against" if rho[i, j] < 0 else "rise and fall with"
                yield (
                    f"{u.names[i]} and {u.names[j]} {kind} each other (correlation {rho[i, j]:+.3f}): "
                    "trust their combination, not each alone."
                )
    if u.chi_square_per_point > 2.0:
        inflated = [u.spread * sd[i] / u.noise_sd[i] for i in shown if u.noise_sd[i] > 0 and np.isfinite(sd[i])]
        yield (
            f"The model misses the data by {times(u.chi_square_per_point**0.5)} noise sigmas rms: something is "
            f"missing from it, or some samples are wild (`--loss huber` takes those for less). Intervals are widened "
            f"up to {times(max(inflated, default=1.0))} times for it, but a wrong law biases beyond any interval."
        )


@dataclass(frozen=True)
class Profile:
    """Deviance against one parameter, all others re-optimised; ends are None where the bound comes first."""

    name: str
    lower: float | None
    upper: float | None
    points: tuple[tuple[float, float], ...]

    @property
    def bounded(self) -> bool:
        """Both ends found before a bound."""
        return self.lower is not None and self.upper is not None


def profile_interval(
    problem: LeastSquares,
    solution: Solution,
    j: int,
    covariance: Float[np.ndarray, "p p"],
    noise_sd: float,
    *,
    max_points: int = 8,
    max_iterations: int = 8,
    cancelled: Callable[[], bool] | None = None,
) -> Profile:
    """95% profile-likelihood interval of parameter j (Venzon and Moolgavkar 1988), warm-started.

    The deviance is divided by the misfit inflation (sd / noise_sd)^2, so that interval and sd speak of
    the same scatter, and the profile adds what sd cannot: skewness, bounds and valleys.
    """
    sd = float(np.sqrt(covariance[j, j]))
    if not (np.isfinite(sd) and sd > 0 and noise_sd > 0):
        return Profile(problem.names[j], None, None, ((float(solution.x[j]), 0.0),))
    inflation = max(sd / noise_sd, 1.0) ** 2
    others = np.array([i for i in range(solution.x.size) if i != j], int)
    weights, trace_back = np.sqrt(solution.weights), problem.trace_back
    slopes = weights[:, None] * solution.jacobian[:, others] if trace_back else None
    points = [(float(solution.x[j]), 0.0)]
    enough = min(0.02 * CHI2_95 * inflation / max(2.0 * solution.objective, 1e-300), 1e-2)  # 1% of the end's root

    def deviance(value: float, guess: np.ndarray) -> tuple[float, np.ndarray]:
        """2 (objective - best) / inflation at x_j = value, and the others' optimum there."""

        def full(y):
            x = np.empty_like(solution.x)
            x[j], x[others] = value, y
            return x

        held = LeastSquares(
            [problem.names[int(i)] for i in others],
            lambda y: weights * problem.residual(full(y)),
            lambda y: _drop(problem.linearise(full(y)), weights, others),
            problem.lower[others], problem.upper[others], problem.scale[others],
            trace_back=trace_back and (lambda y, w, back=trace_back: back(full(y), weights * w)[others]),
        )  # fmt: skip
        if others.size == 0:
            r = weights * problem.residual(full(np.zeros(0)))
            objective, best = 0.5 * float(r @ r), np.zeros(0)
        else:
            found = solve(
                held, guess, max_iterations=max_iterations, ftol=enough, refusals=2, cancelled=cancelled, slopes=slopes
            )
            objective, best = found.objective, found.x
        base = 0.5 * float(np.sum((weights * solution.residual) ** 2))
        return 2.0 * (objective - base) / inflation, best

    def end(sign: float, bound: float) -> float | None:
        """Where the root of the deviance, straight for a quadratic, reaches 1.96; None if the bound is nearer."""
        reach = abs(bound - solution.x[j])
        inner, outer = (0.0, 0.0), None  # (step, root deviance) this side of the end, and beyond it
        step = min(Z95 * sd, reach)
        guess = np.clip(solution.x[others] + sign * step * slope, problem.lower[others], problem.upper[others])
        for _ in range(max_points):
            if cancelled is not None and cancelled():
                break
            value = float(solution.x[j] + sign * step)
            d, guess = deviance(value, guess)
            points.append((value, d))
            root = np.sqrt(max(d, 0.0))
            if root < Z95:
                if step >= reach:
                    return None
                inner = (step, root)
            else:
                outer = (step, root)
            step = _aim(inner, outer, reach)
            if abs(root - Z95) < 0.03 * Z95:
                break
        return float(solution.x[j] + sign * step)

    slope = covariance[others, j] / covariance[j, j]
    lower, upper = end(-1.0, problem.lower[j]), end(1.0, problem.upper[j])
    return Profile(problem.names[j], lower, upper, tuple(sorted(points)))


def _aim(inner: tuple[float, float], outer: tuple[float, float] | None, reach: float) -> float:
    """The step at which the root deviance should be 1.96: between two known steps, or on from the last."""
    (near, low) = inner
    if outer is not None:
        far, high = outer
        return near + (far - near) * (Z95 - low) / (high - low)
    return min(near * min(Z95 / max(low, 1e-3), 4.0), reach)


def _drop(linearised, weights, others):
    r, J = linearised
    return weights * r, weights[:, None] * J[:, others]
