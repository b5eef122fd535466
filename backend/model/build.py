"""From a drawing to a model: bodies to arrays, effects to batches."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from backend.effects.catalogue import effect_of_kind
from backend.effects.effect import TURNING, AbstractEffect, Declaration
from backend.effects.shapes import (
    AbstractBedFriction,
    AbstractDrag,
    AbstractDrawnError,
    AbstractJointMotion,
    AbstractLinkContact,
    AbstractSection,
    AbstractSpringError,
    AbstractStrut,
)
from backend.joints.catalogue import catalogue, joint_of_type
from backend.mechanism.apart import at_each_place, is_mixed, suits_joint
from backend.mechanism.body import Body
from backend.mechanism.effect import Effect, ParameterValue, kind_named, order_faults
from backend.mechanism.found_contacts import contacts_declared
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.turns import begins_near
from backend.model.camera import camera
from backend.model.drawing import Drawing
from backend.model.flexible import SECTION, split, whole
from backend.model.lengthwise import Points, held_points, joint_points, length_axis
from backend.model.model import Model, world_axis
from backend.model.placed import Placed
from backend.model.scale import scale_of
from backend.model.topology import Topology, lay_out

PARALLEL = 1e-3  # sine below which joints turn about one direction


def build(mechanism: Mechanism, effects: Sequence[Effect] = ()) -> Model:
    """The model of a drawing, with further effects beside those drawn.

    Raises ValueError naming joint types or effects that cannot be simulated yet, or what one of them lacks.
    """
    near = begins_near(mechanism)  # of what is drawn: an effect that is tried must not move where a joint begins
    mechanism = contacts_declared(mechanism.model_copy(update={"effects": (*mechanism.effects, *effects)}))
    drawn = mechanism.effects
    twice = sorted({e.id for e in drawn if sum(e.id == other.id for other in drawn) > 1})
    if twice:
        raise ValueError(f"effect id '{twice[0]}' is used twice; give each effect its own id")
    for effect in drawn:
        if effect_of_kind(effect.kind) and (faults := order_faults(kind_named(effect.kind), effect.parameters)):
            raise ValueError(f"effect '{effect.id}': {faults[0]}")
    uncut, mechanism = mechanism, split(mechanism)
    moving = [b.id for b in mechanism.bodies if not b.fixed]
    fixed = [b.id for b in mechanism.bodies if b.fixed]
    if not moving:
        raise ValueError(f"nothing moves in '{mechanism.name}': every body is fixed; let at least one body move")
    for joint in mechanism.joints:
        joint_of_type(joint.type)
    struts = [e for e in mechanism.effects if issubclass(effect_of_kind(e.kind), AbstractStrut)]
    topology = lay_out(
        moving,
        fixed,
        [(j.id, j.type, j.body_a, j.body_b) for j in mechanism.joints],
        [_pair(e, fixed) for e in sorted(struts, key=lambda e: e.kind)],
        [_pair(e, fixed) for e in drawn if issubclass(effect_of_kind(e.kind), AbstractLinkContact)],
    )
    bodies = [mechanism.body(id_) if id_ else None for id_ in topology.body_ids + topology.fixed_ids]
    drawing = _drawing(mechanism, bodies, uncut, near)
    poses = np.array([_pose(b) for b in bodies])
    turning = [i for i in range(len(uncut.joints)) if topology.joint_types[i] in TURNING]
    axes_a = np.asarray(drawing.axes_a)
    axes_W = [_rotation(poses[topology.joints[i][0], 3:]) @ axes_a[i, :, 2] for i in turning]
    _check_bed(drawn, {topology.joint_ids[i]: axis for i, axis in zip(turning, axes_W, strict=True)})
    up = -np.array(mechanism.gravity_m_per_s2, dtype=float)
    axes_W = axes_W or [up if up.any() else np.array([0.0, 0.0, 1.0])]
    placed = tuple(_batches(mechanism.effects, topology, mechanism))
    _check_paths(placed, topology)
    return Model(
        topology=topology,
        drawing=drawing,
        effects=placed,
        drawn_poses=jnp.asarray(poses),
        marker_points=jnp.array(np.reshape([m.position_m for m in mechanism.markers], (-1, 3)), dtype=float),
        marker_ids=tuple(m.id for m in mechanism.markers),
        marker_bodies=tuple(topology.slot(m.body) for m in mechanism.markers),
        camera=camera(mechanism, world_axis(jnp.asarray(np.array(axes_W)))),
        scale=scale_of(uncut, [b.id for b in uncut.bodies if not b.fixed]),
    )


def _check_bed(drawn: Sequence[Effect], axes_W: Mapping[str, np.ndarray]) -> None:
    """Refuse friction on a bed where no plane lies across all joints.  axes_W: of those that turn."""
    on_bed = [e.id for e in drawn if issubclass(effect_of_kind(e.kind), AbstractBedFriction)]
    if not on_bed or not axes_W:
        return
    first, *others = axes_W
    for joint in others:
        if (sine := float(np.linalg.norm(np.cross(axes_W[first], axes_W[joint])))) > PARALLEL:
            raise ValueError(
                f"effect '{on_bed[0]}': joints '{first}' and '{joint}' turn about axes "
                f"{np.degrees(np.arcsin(min(1.0, sine))):.3g} degrees apart, so no bed lies across all joints; "
                "remove it, or draw the joints' axes parallel"
            )


def _check_paths(effects: Sequence[Placed], topology: Topology) -> None:
    """Refuse a joint that is told twice where to be; reading sees what is drawn, this also what is added to it."""
    told: dict[int, str] = {}
    for placed in (p for p in effects if isinstance(p.effect, AbstractJointMotion)):
        for row, (joint,) in zip(placed.rows, placed.places, strict=True):
            if joint in told:
                raise ValueError(
                    f"effects '{told[joint]}' and '{placed.ids[row]}' both prescribe the motion of joint "
                    f"'{topology.joint_ids[joint]}'; keep one of them"
                )
            told[joint] = placed.ids[row]


def _drawing(mechanism: Mechanism, bodies: list[Body | None], uncut: Mechanism, near: Mapping[str, float]) -> Drawing:
    inertial = [b.inertial if b else None for b in bodies]
    count = len(bodies)
    points = held_points(uncut)
    joints = mechanism.joints
    return Drawing(
        mass=jnp.array([i.mass_kg if i else 1.0 for i in inertial]),
        center_of_mass=jnp.array([i.center_of_mass_m if i else (0.0, 0.0, 0.0) for i in inertial]),
        inertia=jnp.array([i.inertia_kg_m2.matrix() if i else np.eye(3) for i in inertial]),
        stretch=jnp.array(np.tile(np.eye(3), (count, 1, 1))),
        length_axis=jnp.array([_length_axis(points, b) if b else (1.0, 0, 0) for b in bodies]),
        point_a=jnp.array(np.reshape([j.frame_a.position_m for j in joints], (-1, 3)), dtype=float),
        point_b=jnp.array(np.reshape([j.frame_b.position_m for j in joints], (-1, 3)), dtype=float),
        axes_a=jnp.array(np.reshape([_rotation(j.frame_a.quaternion_wxyz) for j in joints], (-1, 3, 3))),
        axes_b=jnp.array(np.reshape([_rotation(j.frame_b.quaternion_wxyz) for j in joints], (-1, 3, 3))),
        pin_radius=jnp.array([_pin_radius(j) for j in joints]),
        begins_near=jnp.array([near.get(j.id, 0.0) for j in joints], dtype=float),
        gravity=jnp.array(mechanism.gravity_m_per_s2, dtype=float),
    )


def _length_axis(points: dict[str, Points], body: Body) -> np.ndarray:
    """Halves of a link that bends are stretched along the whole link."""
    return length_axis(points[body.id if body.id in points else whole(body.id)])


def _batches(drawn: Sequence[Effect], topology: Topology, mechanism: Mechanism) -> Iterable[Placed]:
    """All drawn effects, one batch per kind and structure, kinds in alphabetical order."""
    apart = [one for e in drawn for one in (at_each_place(mechanism, e) if is_mixed(mechanism, e) else [e])]
    members = [one for e in apart for one in _with_drawn_values(e, mechanism)]
    batches: dict[tuple, list[Effect]] = {}
    for member in members:
        structure = effect_of_kind(member.kind).structure(member.parameters)
        batches.setdefault((member.kind, tuple(structure.items())), []).append(member)
    ordered = sorted(batches.items())
    where = {e.id: (batch, row) for batch, (_, alike) in enumerate(ordered) for row, e in enumerate(alike)}
    for (kind, structure), alike in ordered:
        yield _place(kind, dict(structure), alike, topology, mechanism, where)


def _with_drawn_values(member: Effect, mechanism: Mechanism) -> list[Effect]:
    """The effect itself, or one per joint where the joints' fits give what it leaves out."""
    effect = effect_of_kind(member.kind)
    missing = {n: d.drawn for n, d in effect.declarations().items() if d.drawn and n not in member.parameters}
    if not missing:
        return [member]
    if effect.acts_on == "bodies":
        return [_with_capsules(member, missing, mechanism)]
    joints = _joints_of(member, effect, mechanism)
    single = len(joints) == 1
    made = []
    for id_ in joints:
        fit, values = mechanism.joint(id_).fit, dict(member.parameters)
        for name, method in missing.items():
            value = getattr(fit, method)() if fit else None
            if value is None:
                raise ValueError(
                    f"effect '{member.id}' ({member.kind}) lacks '{name}', and the fit of joint '{id_}' does not tell "
                    "it; give it, or draw the joint with fit.radial_clearance_m"
                )
            values[name] = value
        id_of_one = member.id if single else f"{member.id}@{id_}"
        made.append(member.model_copy(update={"id": id_of_one, "on": (id_,), "parameters": values}))
    return made


def _with_capsules(member: Effect, missing: Iterable[str], mechanism: Mechanism) -> Effect:
    """A contact between links whose capsules reach from the first to the last joint of each body."""
    values, fixed = dict(member.parameters), [b.id for b in mechanism.bodies if b.fixed]
    points = joint_points(mechanism)
    for letter, body in zip("ab", _pair(member, fixed), strict=True):
        ends = points[body]
        along = length_axis(ends)
        places = sorted((p for p, _ in ends), key=lambda p: float(p @ along))
        for name, place in ((f"start_{letter}_m", 0), (f"end_{letter}_m", -1)):
            if name not in missing:
                continue
            if len(places) < 2:
                raise ValueError(
                    f"effect '{member.id}': body '{body}' has fewer than two joints, so its capsule is unknown; "
                    f"give start_{letter}_m and end_{letter}_m"
                )
            values[name] = tuple(map(float, places[place]))
    return member.model_copy(update={"parameters": values})


def _place(
    kind: str,
    structure: dict[str, Any],
    members: list[Effect],
    topology: Topology,
    mechanism: Mechanism,
    where: dict[str, tuple[int, int]],
) -> Placed:
    """One batch of effects alike in kind and structure; where: batch and row of every effect."""
    effect = effect_of_kind(kind)
    rows, places = [], []
    for row, member in enumerate(members):
        found = _amended(member, effect, mechanism, where) if issubclass(effect, AbstractSpringError) else None
        for place in found or _places(member, effect, topology, mechanism):
            rows.append(row)
            places.append(place)
    leaves = {name: jnp.array([_value(m, name, d) for m in members]) for name, d in effect.declarations().items()}
    shares = tuple(_share(topology, place) for place in places) if issubclass(effect, AbstractDrag) else ()
    return Placed(effect(**leaves, **structure), tuple(m.id for m in members), tuple(rows), tuple(places), shares)


def _share(topology: Topology, place: tuple[int, ...]) -> float:
    """Each half of a link that bends feels half of its drag."""
    bodies = topology.body_ids + topology.fixed_ids
    return 0.5 if whole(str(bodies[place[0]])) + SECTION in topology.joint_ids else 1.0


def _places(
    member: Effect, effect: type[AbstractEffect], topology: Topology, mechanism: Mechanism
) -> Iterable[tuple[int, ...]]:
    if member.on == (effect.acts_on,) and effect.acts_on in ("world", "camera"):
        return [(topology.slots,)] if issubclass(effect, AbstractDrawnError) else [()]
    if effect.acts_on in ("marker", "camera"):
        markers = [m.id for m in mechanism.markers]
        return [(markers.index(id_),) for id_ in (markers if member.on == "all" else member.on)]
    if issubclass(effect, AbstractSection):
        return [(topology.joint_ids.index(id_ + SECTION),) for id_ in member.on]
    if effect.acts_on in ("joint", "world"):
        return [(topology.joint_ids.index(id_),) for id_ in _joints_of(member, effect, mechanism)]
    if member.on == "all":
        return [(topology.slot(b.id),) for b in mechanism.bodies if not b.fixed]
    if effect.acts_on == "bodies":
        return [tuple(topology.slot(id_) for id_ in _pair(member, topology.fixed_ids))]
    return [(topology.slot(id_),) for id_ in member.on]


def _amended(
    member: Effect, effect: type[AbstractSpringError], mechanism: Mechanism, where: dict[str, tuple[int, int]]
) -> list[tuple[int, int]]:
    """Batch and row of the effects that another one corrects."""
    able = [e.id for e in mechanism.effects if e.kind in effect.amends]
    on = able if member.on == "all" else list(member.on)
    if wrong := [id_ for id_ in on if id_ not in able] or ([] if on else ["all"]):
        raise ValueError(
            f"effect '{member.id}': {member.kind} cannot act on '{wrong[0]}': it needs an effect of kind "
            f"{' or '.join(effect.amends)}; there is {', '.join(able) or 'none'}"
        )
    return [where[id_] for id_ in on]


def _joints_of(member: Effect, effect: type[AbstractEffect], mechanism: Mechanism) -> list[str]:
    """Joints an effect acts at; each must have a coordinate, and what the effect needs there."""
    moving = tuple(type_ for type_, kind in catalogue().items() if kind.coordinate is not None)
    able = {t for d in effect.declarations().values() for t in (d.joint_types or moving)}
    on = list(member.on)
    if member.on == "all":
        kind = kind_named(member.kind)
        on = [j.id for j in mechanism.joints if j.type in able and suits_joint(kind, member, j.type)]
    for id_ in on:
        joint = mechanism.joint(id_)
        if joint.type not in able:
            lacks = "" if joint.type in moving else ", which has no coordinate to act along"
            raise ValueError(
                f"effect '{member.id}': {member.kind} cannot act at {joint.type} joint '{id_}'{lacks}; "
                f"it acts at {', '.join(sorted(able))} joints"
            )
        if member.kind == "pin_friction" and _pin_radius(joint) == 0.0:
            raise ValueError(
                f"effect '{member.id}': pin friction at joint '{id_}' needs the pin's size; "
                "draw the joint with fit.pin_diameter_m"
            )
    return on


def _pair(member: Effect, fixed: Sequence[str]) -> tuple[str, str]:
    """First body and the one that takes the reaction; the ground where only one is named."""
    first, *rest = member.on
    return first, rest[0] if rest else fixed[0]


def _value(member: Effect, name: str, declared: Declaration) -> ParameterValue | list[float]:
    if name in member.parameters:
        return member.parameters[name]
    if declared.default is None:
        raise ValueError(f"effect '{member.id}' ({member.kind}) lacks '{name}' [{declared.unit}]: {declared.doc}")
    return declared.default if declared.size == 1 else [declared.default] * declared.size


def _pin_radius(joint) -> float:
    diameter = joint.fit.pin_diameter_m if joint.fit else None
    return 0.5 * diameter if diameter else 0.0


def _pose(body: Body | None) -> list[float]:
    if body is None:
        return [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    return [*body.pose.position_m, *body.pose.quaternion_wxyz]


def _rotation(quaternion_wxyz: Sequence[float] | np.ndarray) -> Float[np.ndarray, "3 3"]:
    w, x, y, z = np.asarray(quaternion_wxyz, float) / np.linalg.norm(quaternion_wxyz)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
