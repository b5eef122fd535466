"""Run a drawing: the motion that follows from what was drawn, as plain arrays by name."""

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple, get_args

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from backend.frames import quaternion
from backend.mechanism.mechanism import Mechanism
from backend.model.build import build
from backend.model.model import Model
from backend.model.state import Pose, Start, drawn_pose
from backend.model.system import TOLERANCE, System, system
from backend.simulate import invariants, kinematics, points
from backend.simulate.assemble import closed, let_go, worst_gap
from backend.simulate.equations import Motion
from backend.simulate.record import Record, Series, beginning, on_steps
from backend.simulate.reduced import STRETCH, Kept, march_reduced
from backend.simulate.redundancy import Redundancy, redundancy
from backend.simulate.rollout import Seen, Trajectory, depart, march, trajectory
from backend.simulate.standing import check_drives, check_ends

CHUNK = 250  # steps between two reports of progress
MOST_STEPS = 2e6  # ten minutes for a pendulum, 2 GB for a four-bar
OPEN_JOINT = 1e-6  # mechanism lengths (and rad) that assembly may leave open: ten times what STEP files round to

MOST_ROWS = 2000  # held rows up to which redundancy is looked for by itself: 5 s of singular values

Progress = Callable[[int, int], None]
Solve = Literal["compliance", "reduced"]


_march = eqx.filter_jit(march)
HALVINGS = 10  # times a step may be cut in two before the motion is lost
_depart = eqx.filter_jit(depart)
_closed = eqx.filter_jit(closed)


@dataclasses.dataclass(frozen=True)
class Run:
    """A simulated motion, SI, world axes unless said otherwise; first axis is time (nodes)."""

    mechanism: str
    step_s: float
    time_s: np.ndarray
    position_m: dict[str, np.ndarray]
    """Body -> origin (nodes, 3)."""
    quaternion_wxyz: dict[str, np.ndarray]
    velocity_m_per_s: dict[str, np.ndarray]
    """Body -> velocity of its origin (nodes, 3)."""
    angular_velocity_rad_per_s: dict[str, np.ndarray]
    """Body -> turn rate in body axes (nodes, 3)."""
    q: dict[str, np.ndarray]
    """Joint -> coordinate [rad or m]; joints without one are left out."""
    reaction_force_n: dict[str, np.ndarray]
    """Joint -> force on body B at the joint (nodes, 3)."""
    reaction_torque_n_m: dict[str, np.ndarray]
    markers_m: dict[str, np.ndarray]
    kinetic_j: np.ndarray
    potential_j: np.ndarray
    constraint_error_m: np.ndarray
    iterations: np.ndarray
    standing: dict[str, np.ndarray]
    """Body that stands still -> its pose: origin [m], then quaternion wxyz (7)."""
    result: str
    """'done', or a sentence that says where and why the motion could not be followed further."""
    solve: Solve = "compliance"
    redundancy: Redundancy | None = None
    """At the start; None where held rows were too many to look.  kept: which rows were let go, and when."""
    kept: Kept | None = None
    cut: int = 0
    """Steps that had to be cut to be solved."""

    @property
    def done(self) -> bool:
        """Whether the whole duration was simulated."""
        return self.result == "done"


def simulate(
    mechanism: Mechanism,
    duration_s: float,
    step_s: float = 1e-3,
    *,
    inputs: Sequence[Series] = (),
    progress: Progress | None = None,
    solve: Solve = "compliance",
    threshold: float | None = None,
    tolerance: float = TOLERANCE,
) -> Run:
    """Let a drawing go at its drawn pose, from rest unless a hand pushes it, under the effects it lists.

    Time counts from the true release; bodies are seen from the base, should it shake.

    inputs: recorded drives as ((effect id, parameter), times [s], values).  progress(done, total) counts steps.
    solve: `compliance` lets every held row give way, `reduced` lets redundant rows go (docs/redundancy.md).  threshold:
    relative singular value of a redundant row; by default the spectrum's gap decides.  tolerance: as for `system`.
    Raises ValueError for a duration or step that is not positive, where loops cannot be closed, and where the drawing
    stands elsewhere than a prescribed path begins, or beyond an end of travel.
    """
    if solve not in get_args(Solve):
        raise ValueError(f"solve is '{solve}'; choose one of {', '.join(get_args(Solve))}")
    for name, value in (("duration", duration_s), ("step", step_s)):
        if not (math.isfinite(value) and value > 0):
            raise ValueError(f"{name} is {value:g} s; give a positive number of seconds")
    if not step_s <= duration_s <= step_s * MOST_STEPS:
        raise ValueError(
            f"a duration of {duration_s:g} s in steps of {step_s:g} s is {duration_s / step_s:.3g} steps; "
            f"choose them so that 1 to {MOST_STEPS:g} steps follow"
        )
    model = beginning(build(mechanism), inputs)
    plant = system(model, tolerance)
    steps = round(duration_s / step_s)
    check_drives(model, plant, inputs)
    check_ends(model, plant)
    start = let_go(plant, assembled(model, plant))
    record = on_steps(model, inputs, step_s, steps + CHUNK, float(plant.held_s)) if inputs else None
    found = None
    if solve == "reduced" or threshold is not None or plant.rigid_rows.sum() <= MOST_ROWS:
        found = redundancy(plant, start.pose, threshold)
    if solve == "reduced":
        path, kept = _followed_reduced(plant, start, step_s, steps, record, progress, threshold)
    else:
        path, kept = _followed(plant, start, step_s, steps, record, progress), None
    run = as_run(mechanism.name, model, plant, path, step_s)
    return dataclasses.replace(run, solve=solve, redundancy=found, kept=kept)


def assembled(model: Model, plant: System) -> Pose:
    """The closed pose near the drawn one.  Raises ValueError naming the joint that stays open."""
    pose = _closed(plant, drawn_pose(model, plant))
    check_closed(plant, pose)
    return pose


def check_closed(plant: System, pose: Pose) -> None:
    """ValueError naming the joint that stays open at a pose that should close all of them."""
    gap = worst_gap(plant, pose)
    length = plant.scale.length_m
    if not (gap.offset_m < OPEN_JOINT * length and gap.tilt_rad < OPEN_JOINT):
        raise ValueError(
            f"joint '{gap.joint}' cannot be closed: {gap.offset_m * 1e3:.4g} mm and "
            f"{math.degrees(gap.tilt_rad):.4g} degrees remain after moving every part; "
            "check the pin positions of the bodies in its loop"
        )


def _followed(
    plant: System, start: Start, step_s: float, steps: int, record: Record | None, progress: Progress | None
) -> Trajectory:
    """The rollout in chunks, so that progress can be shown and one program serves any duration."""
    chunk, step = min(CHUNK, steps + 1), jnp.asarray(step_s)
    motion = _depart(plant, start)
    carry, parts = (motion, jnp.zeros((), dtype=bool)), []
    for first in range(0, steps + 1, chunk):
        carry, seen = _march(plant, carry, step, chunk, _part(record, first, chunk), HALVINGS)
        parts.append(seen)
        if progress:
            progress(min(first + chunk, steps), steps)
    seen: Seen = jax.tree.map(lambda *leaves: jnp.concatenate(leaves)[: steps + 1], *parts)
    return trajectory(seen, step_s)


def _followed_reduced(
    plant: System,
    start: Start,
    step_s: float,
    steps: int,
    record: Record | None,
    progress: Progress | None,
    threshold: float | None,
) -> tuple[Trajectory, Kept]:
    """The rollout without redundant rows."""
    step = jnp.asarray(step_s)
    motion = _depart(plant, start)

    def march(system: System, carry: tuple[Motion, Array], first: int) -> tuple[tuple[Motion, Array], Seen]:
        if progress:
            progress(min(first, steps), steps)
        return _march(system, carry, step, STRETCH, _part(record, first, STRETCH), HALVINGS)

    parts, kept = march_reduced(plant, (motion, jnp.zeros((), dtype=bool)), steps + 1, march, threshold)
    seen: Seen = jax.tree.map(lambda *leaves: jnp.concatenate(leaves)[: steps + 1], *parts)
    return trajectory(seen, step_s), kept


def _part(record: Record | None, first: int, count: int) -> Record | None:
    """A stretch of a record; its last values hold on."""
    if record is None:
        return None
    rows = np.minimum(np.arange(first, first + count), record.values.shape[0] - 1)
    return Record(record.values[rows], record.addresses)


def as_run(name: str, model: Model, plant: System, path: Trajectory, step_s: float) -> Run:
    """A trajectory by the drawing's own names."""
    topology = model.topology
    slots = {body: i for i, body in enumerate(topology.body_ids) if body is not None}
    seen = jax.tree.map(np.asarray, _seen(model, plant, path))
    attitude, spin = np.asarray(path.pose.quaternion), np.asarray(path.velocity[:, :, 3:])
    joints = list(enumerate(topology.joint_ids))
    return Run(
        mechanism=name,
        step_s=step_s,
        time_s=np.asarray(path.time_s),
        position_m={b: seen.origin[:, i] for b, i in slots.items()},
        quaternion_wxyz={b: attitude[:, i] for b, i in slots.items()},
        velocity_m_per_s={b: seen.origin_speed[:, i] for b, i in slots.items()},
        angular_velocity_rad_per_s={b: spin[:, i] for b, i in slots.items()},
        q={j: np.asarray(path.q[:, i]) for i, j in joints if plant.coordinate[i] is not None},
        reaction_force_n={j: seen.force[:, i] for i, j in joints},
        reaction_torque_n_m={j: seen.torque[:, i] for i, j in joints},
        markers_m={m: seen.markers[:, i] for i, m in enumerate(model.marker_ids)},
        kinetic_j=seen.kinetic,
        potential_j=seen.potential,
        constraint_error_m=seen.constraint_error,
        iterations=np.asarray(path.iterations),
        standing=dict(zip(topology.fixed_ids, np.asarray(model.drawn_poses)[len(topology.body_ids) :], strict=True)),
        result=_result(plant, path, step_s),
        cut=int((np.asarray(path.halvings) > 0).sum()),
    )


class _Seen(NamedTuple):
    """What is computed from a whole trajectory, in one program."""

    origin: Array
    origin_speed: Array
    force: Array
    torque: Array
    markers: Array
    kinetic: Array
    potential: Array
    constraint_error: Array


@eqx.filter_jit
def _seen(model: Model, plant: System, path: Trajectory) -> _Seen:
    return _Seen(
        *origins(plant, path),
        *reactions(plant, path),
        points.marker_paths(model, plant, path),
        invariants.kinetic_energy(plant, path),
        invariants.potential_energy(plant, path),
        invariants.constraint_error(plant, path),
    )


def reactions(plant: System, path: Trajectory) -> tuple[Float[Array, "nodes joints 3"], Float[Array, "nodes joints 3"]]:
    """Force [N] and torque [N m] that each joint puts on its body B, at the joint, in W.

    In an overconstrained mechanism they are those of equally stiff joints (compliance); see docs/physics.md.
    """

    def at(pose, carried: Array) -> tuple[Array, Array]:
        placed = kinematics.bodies(plant, pose)
        a, b = plant.pairs.T
        axes_W = jnp.einsum("jab,jbc->jac", placed.rotation[a], plant.axes_a)
        turning = kinematics.rows(plant, placed).jacobian[:, 3:, 9:]
        torque_B = jnp.sum(turning * carried[:, 3:, None], 1)
        force = jnp.einsum("jab,jb->ja", axes_W, carried[:, :3])
        return force, jnp.einsum("jab,jb->ja", placed.rotation[b], torque_B)

    return jax.vmap(at)(path.pose, path.reaction)


def origins(plant: System, path: Trajectory) -> tuple[Array, Array]:
    """(nodes, bodies, 3) in W: where each body's origin is [m], and its velocity [m/s]."""
    slots = plant.topology.slots

    def at(pose, velocity: Array) -> tuple[Array, Array]:
        lever = -plant.center_of_mass[:slots]
        speed = velocity[:, :3] + jnp.einsum(
            "bij,bj->bi", quaternion.rotation(pose.quaternion), jnp.cross(velocity[:, 3:], lever)
        )
        return points.origins(plant, pose)[:slots], speed

    return jax.vmap(at)(path.pose, path.velocity)


def _result(plant: System, path: Trajectory, step_s: float) -> str:
    lost = np.flatnonzero(np.asarray(path.lost))
    if lost.size == 0:
        return "done"
    node = int(lost[0])
    pose = jax.tree.map(lambda leaf: leaf[node], path.pose)
    gap = worst_gap(plant, pose)
    return (
        f"the step at {node * step_s:.6g} s could not be solved (residual {float(path.error[node]):.2g} of the "
        f"mechanism's length, worst near joint '{gap.joint}'); the motion is frozen there. "
        f"Try a smaller step than {step_s:g} s."
    )
