"""Fit a study: from measured experiments to parameters with honest uncertainty, tested on held-out runs."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Literal

import jax
import numpy as np

from backend.effects.shapes import AbstractJointClearance, AbstractLinkContact
from backend.fit.alike import alike
from backend.fit.checkpoint import Checkpoint, digest
from backend.fit.contradiction import contradictions
from backend.fit.filmed_run import run_of, seen_by
from backend.fit.fitted_cameras import fitted_cameras
from backend.fit.free import free_parameters
from backend.fit.guess import guesses, told
from backend.fit.half_step import HalfStep
from backend.fit.identifiability import Profile, Uncertainty, assess, profile_interval
from backend.fit.loss import LossName
from backend.fit.pace import Pace, Progress
from backend.fit.prediction import addresses_of
from backend.fit.price import Way, account
from backend.fit.remedy import left_open, remedies, sentences
from backend.fit.residual import Residuals
from backend.fit.result import FitResult, Overlay, make_report, overlays_of
from backend.fit.run import Run
from backend.fit.search import DISTANCE, PART, WHOLE, Cancelled, Search
from backend.fit.solve import Optimiser, Solution
from backend.fit.sparse import Sparse
from backend.fit.starts import scattered
from backend.fit.unstated import Allowed, unstated, with_give
from backend.mechanism.apart import set_apart
from backend.mechanism.study import Study, driven_effects
from backend.mechanism.study_findings import study_findings
from backend.model.build import build
from backend.model.model import Model

STRIKING_S = 5e-4  # as long as a step may be where parts strike: a blow falls somewhere inside one
STEPS_PER_TIME = 50.0  # of sqrt(length / gravity): a pendulum's phase is then off by 2e-5 of what it turned
START, PROFILE, OVERLAYS = 1.0, 12.0, 2.0  # what these usually cost, in iterations of the search
MOST_STEPS = 1e6  # of one experiment: 8 MB for every number that a node holds
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
    sparse: bool = False,
    profiles: bool = True,
    max_iterations: int = 40,
    derivatives: Way | None = None,
    checkpoint: Path | None = None,
    resume: bool = False,
    progress: Progress | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> FitResult:
    """Fit the free parameters of a study to its `fit` experiments, and test them on the held-out ones.

    free: `KIND:ON[.PARAMETER]` (see `free`). loss: a robust one ignores outliers. noise: "ar1" when neighbouring
    samples share their error. step_s: of the simulation, by default from the sampling and the mechanism's size.
    horizons: fractions of the records to fit first, because long swings have local minima. starts: further
    searches from scattered values. sparse: values of one kind, freed at three places or more, are one shared value
    but for the places that stand out of the noise, which are named. profiles: likelihood intervals. derivatives: how
    they are taken (see `price`), by default as costs least.

    checkpoint: a file that keeps the search after every accepted step and goes when the fit is done; resume: go on
    from it. progress(fraction, words); cancelled() ends the search early with `converged` false, and leaves the
    checkpoint.

    Raises ValueError, naming the part and the remedy, for specs or experiments that cannot be fitted.
    """
    if not jax.config.jax_enable_x64:  # type: ignore[attr-defined]
        raise ValueError("A fit needs float64. Set JAX_ENABLE_X64=1 before JAX starts.")
    began = time.perf_counter()
    findings = study_findings(study)
    driven = driven_effects(study)
    study = replace(study, mechanism=set_apart(study.mechanism, driven))
    freedom = free_parameters(study.mechanism, free, study.tolerances, recorded=driven)
    if not freedom.parameters:
        raise ValueError(
            f"Nothing is free to fit in {', '.join(free) or 'an empty list'}: name a kind that can be simulated and "
            "has a number to fit, as KIND:ON."
        )
    if nothing := study.nothing_to_fit():
        raise ValueError(nothing)
    model = build(study.mechanism, freedom.added)
    table, addresses = model.parameters, addresses_of(freedom.parameters)
    step = default_step(study, model) if step_s is None else step_s
    groups = alike(study.mechanism, freedom.parameters) if sparse else []
    if sparse and not groups:
        raise ValueError(
            f"Nothing in {', '.join(free)} could be shared: a sparse fit needs values of one kind at three places or "
            "more, each its own, as KIND:*."
        )
    searches = 1 + starts + 0.5 * sparse + 0.5 * (noise == "ar1")
    seeking, few = PART * len(horizons) + WHOLE, len(freedom.parameters) - sum(len(g.members) - 1 for g in groups)
    pace = Pace(
        progress or (lambda fraction, words: None), START + searches * seeking + profiles * few * PROFILE + OVERLAYS
    )
    pace.enter(START, "finding where each experiment starts")
    options = {
        "optimiser": optimiser, "loss": loss, "noise": noise, "step_s": step, "horizons": list(horizons),
        "starts": starts, "sparse": sparse, "max_iterations": max_iterations, "derivatives": derivatives,
    }  # fmt: skip
    made_of = digest(study, free, options) if checkpoint else ""
    kept = Checkpoint.resume(checkpoint, made_of) if checkpoint and resume else Checkpoint(checkpoint, made_of)
    runs = [run_of(e, model, addresses, step) for e in study.fit]
    held_out = [run_of(e, model, addresses, step) for e in study.held_out]
    for run in (*runs, *held_out):
        if not (step > 0.0 and run.duration_s <= step * MOST_STEPS):
            raise ValueError(
                f"experiment '{run.experiment.id}': {run.duration_s:g} s from the release to the last sample, in steps "
                f"of {step:g} s; choose one above 0 so that {MOST_STEPS:g} at most follow."
            )
    scale = np.array([table[f.addresses[0]].natural for f in freedom.parameters])
    residuals = Residuals(freedom.parameters, scale, runs, way=derivatives, profiles=profiles)
    shared = Sparse(residuals, groups) if groups else None
    residuals = shared.few if shared else residuals
    if residuals.strikes:
        pace.expect(DISTANCE)
    search = Search(residuals, optimiser, loss, max_iterations, kept, pace, cancelled)
    start, problem = with_give(residuals.start, residuals.parameters, model), residuals.problem()
    moved = (np.arange(start.size) < len(residuals.parameters)).tolist()
    begins = scattered(start, 0.1 * problem.scale, problem.lower, problem.upper, starts, moved)
    solution = search.from_starts(begins, horizons)
    if shared:
        solution = shared.seek(search, solution)
        residuals, held_out = shared.few, [shared.run(run) for run in held_out]
    if residuals.strikes:
        solution = search.retraced(solution)
    if noise == "ar1" and solution.converged:
        residuals.learn_memory(solution.x)
        solution = search.at_full_length(solution.x)
    if solution.status == "disagree":
        solution = search.at_full_length(search.smoothed(solution).x)
    strikes = model.of(AbstractJointClearance) or model.of(AbstractLinkContact)
    if solution.status == "rough" or (strikes and solution.converged):
        solution = search.over_distance(solution)
    if not (np.all(np.isfinite(solution.residual)) and np.all(np.isfinite(solution.jacobian))):
        raise ValueError(f"The motion is lost where the search ended, so that nothing can be said: {solution.message}")
    p, rows = len(residuals.parameters), residuals.rows()
    known = [True] * p + [False] * (solution.x.size - p)
    uncertainty = assess(
        residuals.names, solution, residuals.problem().scale, rows.run, rows.instant, known, residuals.spread
    )
    if solution.converged:
        pace.step("what nobody stated of the walls")
    held = unstated(study, model, freedom.parameters, freedom.added) if solution.converged else []
    guessed = guesses(study.mechanism, residuals.parameters, solution.x[:p])
    rough = residuals.strikes and solution.converged
    finer = HalfStep.of(residuals, solution) if rough else HalfStep.none(residuals.names[:p])
    allowed = Allowed(residuals, solution, uncertainty, held, guessed, finer)
    intervals: dict[str, Profile] = {}
    complete = solution.status != "cancelled"
    warnings = [
        *findings,
        *uncertainty.warnings,
        *allowed.sentences(),
        *told(study.mechanism, residuals.parameters),
        *contradictions(residuals, solution.x),
        *_misses([*runs, *held_out]),
    ]
    if not solution.converged:
        warnings.insert(0, solution.message)
    if shared:
        warnings += shared.sentences(solution)
    if profiles and solution.converged:
        intervals = _profiles(residuals, solution, uncertainty, p, pace, cancelled)
        complete = len(intervals) == sum(np.isfinite(uncertainty.sd[:p]))
        if not complete:
            warnings.append("Cancelled before every profile was drawn: the search itself had converged.")
        elif left_open(uncertainty, solution.x, p):
            warnings += _what_would_tell(study, search, residuals, solution, uncertainty)
    pace.enter(OVERLAYS, "simulating every experiment before and after")
    held_out = [seen_by(run, residuals.camera_numbers(solution.x)) for run in held_out]
    overlays = _overlays(residuals, held_out, solution)
    solution = replace(solution, message=solution.message + account(residuals.derivatives, solution.x.size))
    report = make_report(
        residuals, solution, uncertainty, intervals, search.history, overlays,
        time.perf_counter() - began, warnings, allowed,
        list(shared.deviations(solution, uncertainty)) if shared else (),
        fitted_cameras(residuals, solution, uncertainty),
    )  # fmt: skip
    if complete:
        kept.remove()
    if progress:
        progress(1.0, "done")
    values = {f.name: float(v) for f, v in zip(residuals.parameters, solution.x[:p], strict=True)}
    return FitResult(
        report, tuple(overlays), values, residuals, solution, uncertainty, residuals.spread, tuple(held_out)
    )


def default_step(study: Study, model: Model) -> float:
    """The sampling interval, or a fiftieth of sqrt(length / gravity), whichever is shorter [s]; half a millisecond at
    most where parts strike each other.
    """
    gaps = [model.scale.time_s / STEPS_PER_TIME]
    if model.of(AbstractJointClearance) or model.of(AbstractLinkContact):
        gaps.append(STRIKING_S)
    for e in study.experiments:
        for table, key in ((e.joint_positions, "joint"), (e.tracks, "marker"), (e.joint_efforts, "joint")):
            if table is not None:
                gaps += [
                    float(np.median(np.diff(g["time_s"].to_numpy(float)))) for _, g in table.groupby(key) if len(g) > 1
                ]
    return min(g for g in gaps if g > 0)


def _profiles(
    residuals: Residuals, solution: Solution, u: Uncertainty, p: int, pace: Pace, cancelled: Callable[[], bool] | None
) -> dict[str, Profile]:
    """Profiles of the first p unknowns that the data speak of, one on each core."""

    def profile(j: int) -> Profile:
        problem, sd = residuals.apart().problem(), float(u.noise_sd[j])
        return profile_interval(problem, solution, j, u.covariance, sd, max_points=3, cancelled=cancelled)

    found = {}
    with ThreadPoolExecutor(max_workers=os.cpu_count() or 1) as pool:
        drawn = {j: pool.submit(profile, j) for j in range(p) if np.isfinite(u.sd[j])}
        for j, made in drawn.items():
            pace.enter(PROFILE, f"profile of {residuals.names[j]}")
            ended = made.result()
            if cancelled is not None and cancelled():
                break  # its ends may not be where it stopped
            found[residuals.names[j]] = ended
    return found


def _what_would_tell(
    study: Study, search: Search, residuals: Residuals, solution: Solution, u: Uncertainty
) -> list[str]:  # fmt: skip
    def tell(words: str):
        search.heed()
        search.pace.step(f"what would tell more: {words}")

    try:
        tried = remedies(residuals, solution, u, [joint.id for joint in study.mechanism.joints], tell)
    except Cancelled:
        return ["Cancelled while records that would tell the values left open were tried."]
    return list(sentences(residuals, solution, u, tried))


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
                f"(off by {run.found.rms:.2g} rad or mechanism lengths, {run.found.worst} the farthest). Check "
                "lengths, marker names and axes."
            )
