"""The motion behind a fit: all bodies, where the fit itself kept only what was measured."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from backend.fit.prediction import begin, known_drives, with_values
from backend.model.system import system
from backend.report.evidence import Motion
from backend.simulate.rollout import rollout
from backend.simulate.run import as_run

if TYPE_CHECKING:
    from backend.fit.result import FitResult
    from backend.fit.run import Run


def fitted_motion(result: FitResult, index: int, moving: Sequence[str]) -> Motion:
    """Poses of the moving bodies in the index-th fitted experiment, at the fitted values; time as in its data."""
    run, residuals, x = result.residuals.runs[index], result.residuals, result.solution.x
    values = run.every(x[: len(residuals.parameters)])
    return motion_under(run, values, residuals.own(x, index), moving)


def drawn_motion(result: FitResult, index: int, moving: Sequence[str]) -> Motion:
    """The same with every value as it was drawn, from where the data say that it starts."""
    run, residuals = result.residuals.runs[index], result.residuals
    drawn = np.array([p.start for p in residuals.parameters])
    return motion_under(run, run.every(drawn), run.settle(drawn), moving)


def motion_under(run: Run, values: np.ndarray, own: np.ndarray, moving: Sequence[str]) -> Motion:
    """Poses of the named bodies in one experiment; values: at every free address; own: how it starts."""
    setting = run.setting
    rates = own[run.mobility : run.unknowns] if run.moving else np.zeros(run.mobility)
    model = with_values(setting.model, run.addresses, jnp.asarray(values))
    plant = system(model)
    start = begin(setting, model, plant, jnp.asarray(own[: run.mobility]), jnp.asarray(rates))
    record = known_drives(setting, model, plant, run.step_s)
    path = eqx.filter_jit(rollout)(plant, start, run.step_s, setting.steps, record)
    played = as_run(run.experiment.id, model, plant, path, run.step_s)
    kept = played.time_s <= run.duration_s
    return Motion(
        played.time_s[kept] + run.data.release_s + float(plant.held_s),
        {body: played.position_m[body][kept] for body in moving},
        {body: played.quaternion_wxyz[body][kept] for body in moving},
    )
