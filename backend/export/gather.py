"""From a drawing with its effects to the twin: every number that acts, and a sentence for what has no counterpart."""

from collections.abc import Callable, Iterator

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from backend.effects.effect import AbstractEffect
from backend.effects.shapes import (
    AbstractBedFriction,
    AbstractBodyForce,
    AbstractClock,
    AbstractDrag,
    AbstractDrawnError,
    AbstractDryFriction,
    AbstractJointClearance,
    AbstractJointDamping,
    AbstractJointEffort,
    AbstractJointInertia,
    AbstractJointMotion,
    AbstractJointStop,
    AbstractLinkContact,
    AbstractRateFriction,
    AbstractSection,
    AbstractStrut,
    AbstractView,
)
from backend.export.twin import Effort, Push, Spring, Twin, TwinBody, TwinJoint
from backend.mechanism.joint import WITHOUT_COORDINATE
from backend.mechanism.mechanism import Mechanism
from backend.model.build import build
from backend.model.drawing import Drawing
from backend.model.model import Model
from backend.model.placed import Placed
from backend.model.state import Pose, drawn_pose
from backend.model.system import System, redraw, system
from backend.simulate import kinematics
from backend.simulate.run import assembled

CLOSED = 1e-10  # of the mechanism's length: an assembly would move nothing that another simulator could see
LINEAR = 1e-9  # relative: a law that is as straight as this is written as a straight one
FAST = 1e6  # rad/s or m/s at which friction that falls with speed has reached its sliding level
NO_STOP = 999.0  # rad or m: a stop declared on one side has its other end out here
MANY = 6  # places that a sentence names
WHOLE = (
    AbstractJointDamping, AbstractJointInertia, AbstractJointEffort, AbstractJointMotion, AbstractBodyForce,
    AbstractStrut, AbstractSection, AbstractDrawnError,
)  # fmt: skip


def gather(mechanism: Mechanism) -> Twin:
    """The twin in the pose in which a simulation starts.  Raises ValueError where loops cannot be closed."""
    model = build(mechanism)
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
    stretch, points = np.asarray(plant.stretch), np.asarray(model.marker_points)
    return Twin(
        name=mechanism.name,
        gravity=np.asarray(real.gravity),
        bodies=_bodies(model, plant, placed),
        joints=joints,
        springs=springs,
        efforts=efforts,
        pushes=pushes,
        markers=tuple(
            (id_, names[slot], stretch[slot] @ point)
            for id_, slot, point in zip(model.marker_ids, model.marker_bodies, points, strict=True)
        ),
        left_out=(*_left_out(model), *bent, *odd, *_unsimulated_limits(mechanism)),
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
        weighs = (float(mass[i]), center[i], inertia[i]) if i < slots else ()
        made.append(TwinBody(id_, i >= slots, origin, rotation[i], *weighs))
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
    for placed, row, joint, effect in _rows(model, AbstractJointEffort):
        at_zero, slope = _straight(lambda x, e=effect: float(e.effort(jnp.asarray(x))))
        if any(d.drive for d in effect.declarations().values()):
            efforts.append(Effort(placed.ids[row], topology.joint_ids[joint], at_zero))
        else:
            stiffness[joint] -= slope
            preload[joint] += at_zero
    for _, _, joint, effect in _rows(model, AbstractJointStop):
        low, high = map(float, effect.ends())
        lower[joint], upper[joint] = max(lower[joint], low), min(upper[joint], high)
    for _, _, joint, effect in _rows(model, AbstractRateFriction):
        dry[joint] += float(effect.limit(jnp.asarray(FAST)))
    for _, _, joint, effect in _rows(model, AbstractJointMotion):
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


def _rows(model: Model, shape: type) -> Iterator[tuple[Placed, int, int, AbstractEffect]]:
    """Each place where an effect of a shape acts: its batch, its row, its first place, the effect itself."""
    for placed in model.of(shape):
        for row, (place, *_) in zip(placed.rows, placed.places, strict=True):
            yield placed, row, place, jax.tree.map(lambda leaf, r=row: leaf[r], placed.effect)


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


def _absent(placed: Placed, row: int) -> bool:
    """Whether an effect does nothing: every size it has is zero."""
    declared = placed.effect.declarations().items()
    sizes = [n for n, d in declared if d.size == 1 and (d.lower == 0.0 or d.default == 0.0)]
    return all(float(getattr(placed.effect, n)[row]) == 0.0 for n in sizes)


def _left_out(model: Model) -> Iterator[str]:
    """A sentence per effect that is handed on in part or not at all."""
    for placed in model.effects:
        for row, id_ in enumerate(placed.ids):
            if _absent(placed, row):
                continue
            effect = jax.tree.map(lambda leaf, r=row: leaf[r], placed.effect)
            if sentence := _sentence(effect):
                yield f"effect '{id_}' ({effect.kind}{_where(model, placed, row)}): {sentence}"


def _where(model: Model, placed: Placed, row: int) -> str:
    """The joints or bodies at which a row acts, in words."""
    if placed.effect.acts_on not in ("joint", "body", "bodies"):
        return ""
    names = model.topology.joint_ids if placed.effect.acts_on == "joint" else _names(model)
    on = [names[i] for r, place in zip(placed.rows, placed.places, strict=True) if r == row for i in place]
    shown = on if len(on) < MANY else [*on[: MANY - 2], f"{len(on) - MANY + 2} more"]
    return f" at {', '.join(shown)}"


def _sentence(effect: AbstractEffect) -> str:
    """What of an effect stays behind; empty where nothing does."""
    if isinstance(effect, AbstractJointClearance):
        return "the pin sits tight in its hole"
    if isinstance(effect, AbstractDryFriction):
        unloaded, loaded = (float(effect.limit(jnp.asarray(load), jnp.ones(()))) for load in (0.0, 1.0))
        return "friction that grows with the load is left out" if loaded != unloaded else ""
    if isinstance(effect, AbstractRateFriction):
        return "friction keeps its sliding level at every speed, without the rise at rest"
    if isinstance(effect, AbstractJointStop):
        return "how far its ends throw a body back is left out" if float(effect.wall().restitution) > 0.0 else ""
    if isinstance(effect, AbstractDrag):
        return "drag of the air is left out"
    if isinstance(effect, AbstractBedFriction):
        return "friction on the bed is left out"
    if isinstance(effect, AbstractLinkContact):
        return "links pass through each other"
    if isinstance(effect, AbstractView | AbstractClock):
        return "it belongs to the measurement, not to the mechanism"
    return "" if isinstance(effect, WHOLE) else "it has no counterpart"


def _unsimulated_limits(mechanism: Mechanism) -> Iterator[str]:
    """Limits of the drawing bound nothing in the twin, so they bound nothing in its copies."""
    for joint in mechanism.joints:
        if joint.limits is not None and joint.type not in WITHOUT_COORDINATE:
            yield f"joint '{joint.id}': its drawn limits stop nothing, as in the twin; a joint_stop effect does"
