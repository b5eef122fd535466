"""From a drawing with its effects to the twin: every number that acts, in the pose in which a simulation starts."""

from collections.abc import Callable, Iterator

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from backend.effects.shapes import (
    AbstractBodyForce,
    AbstractJointEffort,
    AbstractJointMotion,
    AbstractJointStop,
    AbstractRateFriction,
)
from backend.export.left_out import NO_STOP, left_out, unsimulated_limits
from backend.export.twin import Effort, Push, Spring, Twin, TwinBody, TwinJoint
from backend.mechanism.mechanism import Mechanism
from backend.model.as_made import amended, redraw
from backend.model.build import build
from backend.model.drawing import Drawing
from backend.model.model import Model, Shape
from backend.model.state import Pose, drawn_pose
from backend.model.system import System, system
from backend.simulate import kinematics
from backend.simulate.run import assembled

CLOSED = 1e-10  # of the mechanism's length: an assembly would move nothing that another simulator could see
LINEAR = 1e-9  # relative: a law that is as straight as this is written as a straight one
FAST = 1e6  # rad/s or m/s at which friction that falls with speed has reached its sliding level


def gather(mechanism: Mechanism) -> Twin:
    """The twin in the pose in which a simulation starts.  Raises ValueError where loops cannot be closed."""
    model = amended(build(mechanism))
    plant, real, pose, rows = _drawn(model)
    held = plant.held_rows & ~plant.coordinate_rows
    unit = np.array([1.0 / float(plant.scale.length_m)] * 3 + [1.0] * 3)
    if np.abs(np.where(held, np.asarray(rows) * unit, 0.0)).max(initial=0.0) > CLOSED:
        pose = assembled(model, plant)
    placed, q = _placed(plant, pose)
    names = _names(model)
    joints, efforts = _joints(model, plant, np.asarray(q))
    springs, bent = _springs(plant)
    pushes, odd = _pushes(model, real)
    center, points = np.asarray(plant.center_of_mass), np.asarray(plant.markers)
    return Twin(
        name=mechanism.name,
        gravity=np.asarray(real.gravity),
        bodies=_bodies(model, plant, placed),
        joints=joints,
        springs=springs,
        efforts=efforts,
        pushes=pushes,
        markers=tuple(
            (id_, names[slot], point + center[slot])
            for id_, slot, point in zip(model.marker_ids, model.marker_bodies, points, strict=True)
        ),
        left_out=(*left_out(model), *bent, *odd, *unsimulated_limits(mechanism)),
    )


@eqx.filter_jit
def _drawn(model: Model) -> tuple[System, Drawing, Pose, Array]:
    """The model in numbers, the parts as they really are, the drawn pose, and how far its joints are open."""
    plant = system(model)
    pose = drawn_pose(model, plant)
    return plant, redraw(model), pose, kinematics.rows(plant, kinematics.bodies(plant, pose)).value


@eqx.filter_jit
def _placed(plant: System, pose: Pose) -> tuple[kinematics.Bodies, Array]:
    placed = kinematics.bodies(plant, pose)
    return placed, kinematics.coordinates(plant, placed)


def _names(model: Model) -> list[str]:
    return [str(id_) for id_ in model.topology.body_ids + model.topology.fixed_ids]


def _bodies(model: Model, plant: System, placed: kinematics.Bodies) -> tuple[TwinBody, ...]:
    position, rotation, center = (np.asarray(x) for x in (placed.position, placed.rotation, plant.center_of_mass))
    mass, inertia, slots = np.asarray(plant.mass), np.asarray(plant.inertia), model.topology.slots
    made = []
    for i, id_ in enumerate(model.topology.body_ids + model.topology.fixed_ids):
        if id_ is None:
            continue
        origin = position[i] - rotation[i] @ center[i]
        if i < slots:
            made.append(TwinBody(id_, False, origin, rotation[i], float(mass[i]), center[i], inertia[i]))
        else:
            made.append(TwinBody(id_, True, origin, rotation[i]))
    return tuple(made)


def _joints(
    model: Model, plant: System, q: Float[np.ndarray, "joints"]
) -> tuple[tuple[TwinJoint, ...], tuple[Effort, ...]]:
    topology, names = model.topology, _names(model)
    center, p_A, p_B, R_AF, R_BF, damping, rotor = (
        np.asarray(x)
        for x in (
            plant.center_of_mass, plant.point_a, plant.point_b, plant.axes_a, plant.axes_b, plant.damping, plant.rotor
        )
    )  # fmt: skip
    count = len(topology.joint_ids)
    stiffness, preload = np.array(plant.stiffness), np.zeros(count)
    lower, upper = np.full(count, -np.inf), np.full(count, np.inf)
    dry, driven, efforts = np.array(plant.dry_limit), dict[int, float](), []
    for id_, joint, effect in _rows(model, AbstractJointEffort):
        at_zero, slope = _straight(lambda x, e=effect: float(e.effort(jnp.asarray(x))))
        if any(d.drive for d in effect.declarations().values()):
            efforts.append(Effort(id_, topology.joint_ids[joint], at_zero))
        else:
            stiffness[joint] -= slope
            preload[joint] += at_zero
    for _, joint, effect in _rows(model, AbstractJointStop):
        low, high = map(float, effect.ends())
        lower[joint], upper[joint] = max(lower[joint], low), min(upper[joint], high)
    for _, joint, effect in _rows(model, AbstractRateFriction):
        dry[joint] += float(effect.limit(jnp.asarray(FAST)))
    for _, joint, effect in _rows(model, AbstractJointMotion):
        driven[joint] = float(effect.target())
    joints = []
    for i, (id_, type_) in enumerate(zip(topology.joint_ids, topology.joint_types, strict=True)):
        a, b = topology.joints[i]
        joints.append(
            TwinJoint(
                id_, type_, names[a], names[b],
                p_A=p_A[i] + center[a], R_AF=R_AF[i], p_B=p_B[i] + center[b], R_BF=R_BF[i],
                q=float(q[i]), damping=float(damping[i]), dry=float(dry[i]), rotor=float(rotor[i]),
                stiffness=float(stiffness[i]), preload=float(preload[i]),
                lower=_open(lower[i]), upper=_open(upper[i]), driven=driven.get(i),
            )
        )  # fmt: skip
    return tuple(joints), tuple(efforts)


def _open(end: float) -> float:
    return float(np.sign(end) * np.inf) if abs(end) > NO_STOP else float(end)


def _straight(law: Callable[[float], float]) -> tuple[float, float]:
    """Value at zero and slope of a law; ValueError where it is not a straight line."""
    below, at_zero, above = (law(x) for x in (-1.0, 0.0, 1.0))
    if abs(above + below - 2 * at_zero) > LINEAR * max(abs(above), abs(below), abs(at_zero)):
        raise ValueError("the law is not a straight line")
    return at_zero, 0.5 * (above - below)


def _rows(model: Model, shape: type[Shape]) -> Iterator[tuple[str, int, Shape]]:
    """Each joint at which an effect of a shape acts: the effect's id, the joint, the effect itself."""
    for placed in model.of(shape):
        for row, (joint, *_) in zip(placed.rows, placed.places, strict=True):
            effect = jax.tree.map(lambda leaf, r=row: leaf[r], placed.effect)
            if isinstance(effect, shape):
                yield placed.ids[row], joint, effect


def _springs(plant: System) -> tuple[tuple[Spring, ...], list[str]]:
    names = [str(id_) for id_ in plant.topology.body_ids + plant.topology.fixed_ids]
    center, springs, odd, at = np.asarray(plant.center_of_mass), [], [], 0
    for placed in plant.struts:
        for row in placed.rows:
            law = jax.tree.map(lambda leaf, r=row: leaf[r], placed.effect)
            a, b = plant.topology.struts[at]
            at_zero, stiffness = _straight(lambda x, e=law: float(e.tension(jnp.asarray(x + 1.0))))
            free = 1.0 - at_zero / stiffness if stiffness else 0.0
            if free < 0.0 or (not stiffness and at_zero):
                odd.append(f"effect '{placed.ids[row]}': a spring that pulls at every length has no counterpart")
            else:
                ends = (np.asarray(plant.strut_a[at]) + center[a], np.asarray(plant.strut_b[at]) + center[b])
                springs.append(
                    Spring(placed.ids[row], names[a], names[b], *ends, stiffness, free, float(plant.strut_damping[at]))
                )
            at += 1
    return tuple(springs), odd


def _pushes(model: Model, real: Drawing) -> tuple[tuple[Push, ...], list[str]]:
    """Applied forces and torques; any other force on bodies is left out by name."""
    names, stretch, made, odd = _names(model), np.asarray(real.stretch), [], []
    for placed in model.of(AbstractBodyForce):
        for row, (a, b) in zip(placed.rows, placed.places, strict=True):
            values = {n: np.asarray(getattr(placed.effect, n)[row]) for n in placed.effect.declarations()}
            along = values.get("direction", values.get("axis"))
            size = values.get("force_n", values.get("torque_n_m"))
            if along is None or size is None:
                odd.append(f"effect '{placed.ids[row]}': {placed.effect.kind} has no counterpart")
                continue
            point = stretch[a] @ values.get("point_m", np.zeros(3))
            unit, torque = along / np.linalg.norm(along), "axis" in values
            made.append(Push(placed.ids[row], names[a], names[b], point, unit, float(size), torque))
    return tuple(made), odd
