"""Does it jam: follow a mechanism, see whether it comes to rest, and ask why."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from backend.fit.measured import measured
from backend.fit.pose import find_start
from backend.jam.cause import Finding, find_balance, find_cause
from backend.jam.cone import shortage
from backend.jam.follow import Progress, follow
from backend.jam.mobility import Mobility, mobility_along
from backend.jam.scene import Scene
from backend.jam.stuck import AT_REST, at_rest, creep_ratio
from backend.jam.verdict import sentence
from backend.mechanism.jam_report import ConeAlong, FrictionCone, JamReport, JointReaction, Margin
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.study import Experiment, Study
from backend.model.build import build
from backend.model.flexible import split
from backend.model.model import Model
from backend.model.state import Start
from backend.model.system import System, system
from backend.simulate.assemble import let_go
from backend.simulate.assemble import start as closed_start
from backend.simulate.record import Record, beginning, on_steps, series_of
from backend.simulate.rollout import Trajectory
from backend.simulate.run import Run, as_run, assembled, check_closed
from backend.simulate.spectrum import real
from backend.simulate.standing import check_drives, check_ends

MOST_STEPS = 1e5
MOST_NUMBERS = 2_000_000  # of a report's series: beyond, only every so many steps are written
MOST_WORK = 1e9  # multiplications for all spectra: beyond, likewise; some ten seconds
DIGITS = 7
CONES = 60  # nodes at which the friction-cone programme is asked
LOST_LEVER = 0.2  # of its greatest: a prescribed motion lost below this had run into a dead centre

_start = eqx.filter_jit(closed_start)


@dataclasses.dataclass(frozen=True)
class Jam:
    """A report, the motion that it is about, and the drawing with bending links cut in two."""

    report: JamReport
    run: Run
    mechanism: Mechanism


def jam(
    mechanism: Mechanism, duration_s: float = 1.0, step_s: float = 1e-3, *, progress: Progress | None = None
) -> Jam:
    """Whether, when, where, why and by what margin a drawing jams, let go in its drawn pose: from rest, unless a hand
    pushes it (`release_velocity`).

    Raises ValueError for a duration or step that is not positive, and where loops cannot be closed.
    """
    steps = steps_of(duration_s, step_s)
    model = build(mechanism)
    plant = system(model)
    check_drives(model, plant)
    check_ends(model, plant)
    start = let_go(plant, assembled(model, plant))
    return _jam(mechanism, None, model, start, None, steps, step_s, progress)


def jam_study(
    study: Study, duration_s: float | None = None, step_s: float = 1e-3, *, progress: Progress | None = None
) -> dict[str, Jam]:
    """The same from the start of every experiment, under its drives: experiment -> what came of it.

    duration_s: from each release; by default to the experiment's last sample.
    """
    model, found = build(study.mechanism), {}
    for experiment in study.experiments:
        own = model.with_parameters(model.overridden(experiment.overrides))
        own = beginning(own, series_of(experiment))
        data = measured(experiment, own)
        steps = steps_of(duration_s or float(data.time_s.max() - data.release_s), step_s)
        plant = system(own)
        try:
            begin = find_start(own, data, experiment.release)
            check_closed(plant, begin.reference)
        except ValueError as error:
            raise ValueError(f"experiment '{experiment.id}': {error}") from None
        rates = jnp.zeros(begin.motions.shape[-1]) if experiment.release.at_rest else jnp.asarray(begin.rates)
        start = _start(plant, begin.reference, begin.motions, jnp.zeros(begin.motions.shape[-1]), rates)
        record = _record(experiment, own, step_s, steps, data.release_s + float(plant.held_s))
        found[experiment.id] = _jam(study.mechanism, experiment.id, own, start, record, steps, step_s, progress)
    return found


def _record(experiment: Experiment, model: Model, step_s: float, steps: int, start_s: float) -> Record | None:
    series = series_of(experiment)
    return on_steps(model, series, step_s, steps, start_s) if series else None


def _jam(
    mechanism: Mechanism,
    experiment: str | None,
    model: Model,
    start: Start,
    record: Record | None,
    steps: int,
    step_s: float,
    progress: Progress | None,
) -> Jam:
    plant, path = follow(model, start, step_s, steps, record, progress)
    run = as_run(mechanism.name, model, plant, path, step_s)
    creep = creep_ratio(plant, path)
    last = max(path.q.shape[0] - 1, 0)
    gravity_drives = Scene.at(model, path, last, record, step_s).gravity_drives
    every = _every(plant, last + 1)
    mobility = mobility_along(plant, path, record, gravity_drives, every)
    lost = np.flatnonzero(np.asarray(path.lost))
    finding, onset = None, None
    if lost.size:
        finding, onset = _lost(plant.is_driven, model, mobility, int(lost[0]), every, step_s)
    elif creep[0] < AT_REST and (balanced := find_balance(Scene.at(model, path, 0, record, step_s))):
        # Rounding alone would leave it, in a time that says nothing of the mechanism.
        finding, onset = balanced, 0.0
    elif rest := at_rest(creep, step_s):
        # The end of the rest is the settled pose; its beginning may still creep.
        finding, onset = find_cause(Scene.at(model, path, last, record, step_s)), rest.onset_s
    along = _cone_along(model, path, record, step_s)
    report = _report(mechanism.name, experiment, model, run, creep, mobility, every, along, finding, onset)
    return Jam(report, run, split(mechanism))


def _every(plant: System, nodes: int) -> int:
    """Steps between two entries of the report's series: one, unless the mechanism is large."""
    rows, freedoms = int(plant.rigid_rows.sum()), 6 * int(real(plant).sum())
    width = min(rows, freedoms) + 12 * plant.rigid_rows.shape[0]
    return max(1, math.ceil(nodes * width / MOST_NUMBERS), math.ceil(nodes * rows * freedoms**2 / MOST_WORK))


def _lost(
    driven: np.ndarray, model: Model, mobility: Mobility, node: int, every: int, step_s: float
) -> tuple[Finding | None, float | None]:
    """A prescribed motion that the mechanism cannot follow ends in a dead centre; any other loss is the solver's."""
    falls = mobility.driven[: node // every + 1]
    if not driven.any() or falls[-1] > LOST_LEVER * falls.max():
        return None, None
    at = tuple(f"joint:{model.topology.joint_ids[j]}" for j in np.flatnonzero(driven))
    return Finding(True, "singularity", at, Margin(), 0.0, FrictionCone(holds=False)), node * step_s


def _cone_along(model: Model, path: Trajectory, record: Record | None, step_s: float) -> ConeAlong:
    """The friction-cone programme at some nodes of the motion, the first and the last among them."""
    nodes = np.unique(np.linspace(0, path.q.shape[0] - 1, CONES).round().astype(int))
    short = []
    for node in nodes:
        scene = Scene.at(model, path, int(node), record, step_s)
        short.append(shortage(scene.statics(), scene.radial))
    known = [float(f"{value:.3e}") if math.isfinite(value) else None for value in short]
    return ConeAlong(time_s=_numbers(nodes * step_s), shortage=tuple(known))


def _report(
    name: str,
    experiment: str | None,
    model: Model,
    run: Run,
    creep: np.ndarray,
    mobility: Mobility,
    every: int,
    along: ConeAlong,
    finding: Finding | None,
    onset: float | None,
) -> JamReport:
    keep = slice(None, None, every)
    topology = model.topology
    bodies = topology.body_ids + topology.fixed_ids
    joints = zip(topology.joint_ids, topology.joints, strict=True)
    pairs = {joint: (str(bodies[a]), str(bodies[b])) for joint, (a, b) in joints}
    cause = finding.cause if finding else "none"
    jammed, margin = (finding.jammed, finding.margin) if finding else (False, Margin())
    return JamReport(
        mechanism=name,
        experiment=experiment,
        jammed=jammed,
        onset_s=onset,
        cause=cause,
        at=finding.at if finding else (),
        margin=margin,
        sentence=sentence(jammed, cause, onset, finding.at if finding else (), margin, run.result),
        lever=finding.lever if finding else None,
        friction_cone=finding.cone if finding else None,
        friction_cone_along=along,
        step_s=run.step_s,
        every=every,
        time_s=_numbers(run.time_s[keep]),
        mobility=tuple(map(int, mobility.mobility)),
        small_singular_values=tuple(map(int, mobility.published)),
        singular_values=tuple(_numbers(row) for row in mobility.singular_values),
        driven_singular_value=_numbers(mobility.driven),
        creep_ratio=_numbers(creep[keep]),
        result=run.result,
        reactions={
            joint: JointReaction(
                body_a=a,
                body_b=b,
                force_on_a_n=_vectors(-run.reaction_force_n[joint][keep]),
                torque_on_a_n_m=_vectors(-run.reaction_torque_n_m[joint][keep]),
                force_on_b_n=_vectors(run.reaction_force_n[joint][keep]),
                torque_on_b_n_m=_vectors(run.reaction_torque_n_m[joint][keep]),
            )
            for joint, (a, b) in pairs.items()
        },
    )


def _numbers(values: Sequence[float] | np.ndarray) -> tuple[float, ...]:
    plain = np.nan_to_num(np.asarray(values, float)).tolist()  # numpy's own numbers take four times as long to write
    return tuple(float(f"{value:.{DIGITS - 1}e}") for value in plain)


def _vectors(values: np.ndarray) -> tuple[tuple[float, float, float], ...]:
    flat = _numbers(values.ravel())
    return tuple(zip(flat[::3], flat[1::3], flat[2::3], strict=True))


def steps_of(duration_s: float, step_s: float) -> int:
    """How many steps a duration has.  Raises ValueError where either is not positive, and for none or too many."""
    for name, value in (("duration", duration_s), ("step", step_s)):
        if not (math.isfinite(value) and value > 0):
            raise ValueError(f"{name} is {value:g} s; give a positive number of seconds")
    if not step_s <= duration_s <= step_s * MOST_STEPS:
        raise ValueError(
            f"a duration of {duration_s:g} s in steps of {step_s:g} s is {duration_s / step_s:.3g} steps; "
            f"choose them so that 1 to {MOST_STEPS:g} steps follow"
        )
    return round(duration_s / step_s)
