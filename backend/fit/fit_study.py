"""Fit a study: from measured experiments to parameters with honest uncertainty, tested on held-out runs."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Literal

import jax
import numpy as np

from backend.effects.shapes import AbstractJointClearance, AbstractLinkContact
from backend.fit.free import free_parameters
from backend.fit.identifiability import Profile, Uncertainty, assess, profile_interval
from backend.fit.loss import LossName
from backend.fit.prediction import addresses_of
from backend.fit.residual import Residuals
from backend.fit.result import FitResult, Overlay, make_report, overlays_of
from backend.fit.run import Run
from backend.fit.secant import smoothed
from backend.fit.solve import Iteration, Optimiser, Solution, solve
from backend.fit.starts import best_of, scattered
from backend.mechanism.study import Study
from backend.model.build import build
from backend.model.model import Model

Progress = Callable[[float, str], None]
STEPS_PER_TIME = 50.0  # of sqrt(length / gravity): a pendulum's phase is then off by 2e-5 of what it turned
POSE_MISS = 0.02  # rad, or mechanism lengths, beyond which no pose is said to explain the first samples


def fit_study(
    study: Study,
    free: Sequence[str],
    *,
    optimiser: Optimiser = "lm",
    loss: LossName = "linear",
    noise: Literal["white", "ar1"] = "white",
    step_s: float | None = None,
    horizons: Sequence[float] = (0.1, 0.35),
    starts: int = 0,
    profiles: bool = True,
    max_iterations: int = 40,
    progress: Progress | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> FitResult:
    """Fit the free parameters of a study to its `fit` experiments, and test them on the held-out ones.

    free: `KIND:ON[.PARAMETER]` (see `free`). loss: a robust one ignores outliers. noise: "ar1" when neighbouring
    samples share their error. step_s: of the simulation, by default from the sampling and the mechanism's size.
    horizons: fractions of the records to fit first, because long swings have local minima. starts: further
    searches from scattered values. profiles: likelihood intervals. progress(fraction, words); cancelled() ends
    the search early with `converged` false.

    Raises ValueError, naming the part and the remedy, for specs or experiments that cannot be fitted.
    """
    if not jax.config.jax_enable_x64:  # type: ignore[attr-defined]
        raise ValueError("A fit needs float64. Set JAX_ENABLE_X64=1 before JAX starts.")
    began, tell = time.perf_counter(), progress or (lambda fraction, words: None)
    freedom = free_parameters(study.mechanism, free, study.tolerances)
    if not freedom.parameters:
        raise ValueError(
            f"Nothing is free to fit in {', '.join(free) or 'an empty list'}: name a kind that can be simulated and "
            "has a number to fit, as KIND:ON."
        )
    if not study.fit:
        raise ValueError('No experiment may be fitted: give at least one of them "use": "fit".')
    model = build(study.mechanism, freedom.added)
    table, addresses = model.parameters, addresses_of(freedom.parameters)
    step = step_s or default_step(study, model)
    tell(0.02, "finding where each experiment starts")
    runs = [Run.of(e, model, addresses, step) for e in study.fit]
    held_out = [Run.of(e, model, addresses, step) for e in study.held_out]
    scale = np.array([table[f.addresses[0]].natural for f in freedom.parameters])
    residuals = Residuals(freedom.parameters, scale, runs)
    search = _Search(residuals, optimiser, loss, max_iterations, tell, cancelled)
    start = residuals.start
    if starts:
        problem = residuals.problem()
        moved = np.arange(start.size) < len(scale)
        options = scattered(start, 0.1 * problem.scale, problem.lower, problem.upper, starts, list(moved))
        solution, _ = best_of(lambda x: search.through(x, horizons), options)
    else:
        solution = search.through(start, horizons)
    if noise == "ar1" and solution.converged:
        residuals.learn_memory(solution.x)
        solution = search.at_full_length(solution.x)
    p = len(scale)
    if solution.status == "disagree":
        solution = search.at_full_length(smoothed(residuals.problem(), solution).x)
    if solution.status == "rough" or model.of(AbstractJointClearance) or model.of(AbstractLinkContact):
        tell(0.68, "slopes over the distance that the data tell apart")
        solution = smoothed(residuals.problem(), solution)
    rows = residuals.rows()
    known = [True] * p + [False] * (solution.x.size - p)
    uncertainty = assess(
        residuals.names, solution, residuals.problem().scale, rows.run, rows.instant, known, residuals.spread
    )
    intervals: dict[str, Profile] = {}
    if profiles and solution.converged:
        intervals = _profiles(residuals, solution, uncertainty, p, tell, cancelled)
    tell(0.92, "simulating every experiment before and after")
    overlays = _overlays(residuals, held_out, solution)
    warnings = [*uncertainty.warnings, *_misses([*runs, *held_out])]
    if not solution.converged:
        warnings.insert(0, solution.message)
    report = make_report(
        residuals, solution, uncertainty, intervals, search.history, overlays,
        time.perf_counter() - began, warnings,
    )  # fmt: skip
    tell(1.0, "done")
    values = {f.name: float(v) for f, v in zip(freedom.parameters, solution.x[:p], strict=True)}
    return FitResult(report, tuple(overlays), values, residuals, solution, uncertainty, residuals.spread)


def default_step(study: Study, model: Model) -> float:
    """The sampling interval, or a fiftieth of sqrt(length / gravity), whichever is shorter [s]."""
    gaps = [model.scale.time_s / STEPS_PER_TIME]
    for e in study.experiments:
        for table, key in ((e.joint_positions, "joint"), (e.tracks, "marker"), (e.joint_efforts, "joint")):
            if table is not None:
                gaps += [
                    float(np.median(np.diff(g["time_s"].to_numpy(float)))) for _, g in table.groupby(key) if len(g) > 1
                ]
    return min(g for g in gaps if g > 0)


class _Search:
    """The stages of one fit, with one history."""

    def __init__(self, residuals: Residuals, optimiser: Optimiser, loss: LossName, most: int, tell, cancelled):
        self.residuals, self.most = residuals, most
        self.optimiser: Optimiser = optimiser
        self.loss: LossName = loss
        self.tell, self.cancelled = tell, cancelled
        self.history: list[Iteration] = []

    def through(self, x: np.ndarray, horizons: Sequence[float]) -> Solution:
        """Fit the first part of every record, then longer ones, then all."""
        for stage, fraction in enumerate(horizons):
            words = f"fitting the first {100 * fraction:.0f}%"
            found = self._solve(x, fraction, 0.1 + 0.15 * stage / len(horizons), words, 12, 1e-3, anchor=x)
            if found.status == "cancelled":
                return self._reweighted(found)
            x = found.x if np.isfinite(found.objective) else x
        return self.at_full_length(x)

    def at_full_length(self, x: np.ndarray) -> Solution:
        """Fit whole records until the misfit that weighs them stops changing."""
        found = None
        for ftol in (1e-3, 1e-6, 1e-6, 1e-6):
            found = self._solve(x, 1.0, 0.3, "fitting whole records", self.most, ftol)
            x = found.x
            if found.status in ("cancelled", "not_finite_at_start"):
                break
            weighed = self.residuals.spread
            if abs(self.residuals.learn_spread(x) - weighed) < 0.02 * weighed and ftol < 1e-3:
                break
        return self._reweighted(found)

    def _reweighted(self, found: Solution | None) -> Solution:
        """The solution in the final weights, which differ by a few percent from those of its search."""
        if found is None:
            raise RuntimeError("no stage of the fit was run")
        r, J = self.residuals.evaluate(found.x)
        weights = found.weights if found.weights.size == r.size else np.ones_like(r)  # cancelled on a short horizon
        return replace(found, residual=r, jacobian=J, weights=weights)

    def _solve(
        self, x: np.ndarray, fraction: float, done: float, words: str, most: int, ftol: float,
        anchor: np.ndarray | None = None,
    ) -> Solution:  # fmt: skip
        self.residuals.learn_spread(x, fraction)

        def advance(iteration: Iteration):
            self.history.append(iteration)
            self.tell(min(done + 0.02 * iteration.iteration, 0.7), f"{words}, iteration {iteration.iteration}")

        return solve(
            self.residuals.problem(fraction, anchor), x, optimiser=self.optimiser, loss=self.loss, max_iterations=most,
            ftol=ftol, progress=advance, cancelled=self.cancelled,
        )  # fmt: skip


def _profiles(residuals: Residuals, solution: Solution, u: Uncertainty, p: int, tell, cancelled) -> dict[str, Profile]:
    problem = residuals.problem()
    found = {}
    for j in range(p):
        name = residuals.names[j]
        tell(0.7 + 0.2 * j / p, f"profile of {name}")
        if np.isfinite(u.sd[j]):
            found[name] = profile_interval(
                problem, solution, j, u.covariance, float(u.noise_sd[j]), max_points=3, max_iterations=2,
                cancelled=cancelled,
            )  # fmt: skip
    return found


def _overlays(residuals: Residuals, held_out: Sequence[Run], solution: Solution) -> list[Overlay]:
    p, fitted = len(residuals.parameters), len(residuals.runs)
    drawn = np.array([f.start for f in residuals.parameters])
    runs = [*residuals.runs, *held_out]

    def both(i: int) -> list[Overlay]:
        run = runs[i]
        before = run.predict(drawn, run.settle(drawn))[0]
        own = residuals.own(solution.x, i) if i < fitted else run.settle(solution.x[:p])
        return overlays_of(run, before, run.predict(solution.x[:p], own)[0])

    with ThreadPoolExecutor(max_workers=os.cpu_count() or 1) as pool:
        return [overlay for made in pool.map(both, range(len(runs))) for overlay in made]


def _misses(runs: Sequence[Run]):
    for run in runs:
        if run.found.rms > POSE_MISS:
            yield (
                f"Experiment '{run.experiment.id}': no pose of the drawing explains its first samples "
                f"(off by {run.found.rms:.2g} rad or mechanism lengths). Check lengths, marker names and axes."
            )
