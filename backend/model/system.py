"""The numbers of one motion: the drawing as it really is, and what the effects add up to at each joint.

Computed once before a motion starts; everything that stays the same from step to step is summed here.
"""

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from backend.effects.shapes import (
    AbstractBaseMotion,
    AbstractBodyForce,
    AbstractDrag,
    AbstractDryFriction,
    AbstractHold,
    AbstractJointClearance,
    AbstractJointDamping,
    AbstractJointEffort,
    AbstractJointInertia,
    AbstractJointMotion,
    AbstractJointStop,
    AbstractPush,
    AbstractRateFriction,
    AbstractSection,
    AbstractStrut,
    Capsule,
)
from backend.frames import quaternion
from backend.joints.catalogue import joint_of_type
from backend.joints.joint import TURN
from backend.model.as_made import amended, marker_points, redraw, weight
from backend.model.contacts import JointContacts, joint_contacts
from backend.model.drawing import Drawing
from backend.model.model import Model
from backend.model.placed import Placed
from backend.model.scale import Scale
from backend.model.topology import Topology
from backend.model.touches import Pads, Touches, bed_friction, pads, touches, touching_kinds

COMPLIANCE = 5e-11  # of a joint row, times the mass it holds [1]: 1e-14 brings self-stress, 1e-7 gives way
STICK_RATE = 5e-6  # below this rate [rad/s, or mechanism lengths/s] dry friction holds: 0.2 m creep under 1 µm/s
TOLERANCE = 1e-10  # error of a step's displacement, in mechanism lengths
BARRIER = 1e-8  # energy [mechanism weight x length] that a stop spends to stay open; less where it holds lighter bodies


class System(eqx.Module):
    """Arrays of a mechanism in motion; body points are relative to the centre of mass, in body axes."""

    topology: Topology = eqx.field(static=True)
    scale: Scale
    held: tuple[tuple[bool, ...], ...] = eqx.field(static=True)
    """Rows of each joint that its kind holds."""
    coordinate: tuple[int | None, ...] = eqx.field(static=True)
    """The row of each joint that is its coordinate."""
    touches: Touches
    """Links that may meet."""
    pads: Pads
    """Bodies on the bed."""
    contacts: JointContacts
    """Walls inside joints: loose holes and ends of travel."""
    load_dependent: bool = eqx.field(static=True)
    """Whether any dry friction grows with the load."""
    driven: tuple[int, ...] = eqx.field(static=True)
    """Joints whose coordinate is prescribed."""
    sections: tuple[int, ...] = eqx.field(static=True)
    """Hinges inside links that bend."""

    mass: Float[Array, "slots"]
    joint_mass: Float[Array, "joints"]
    """What a joint holds: the geometric mean of its moving bodies, but no more than the mechanism's typical mass [kg].

    Heavy neighbours must not decide what is little for a light body.
    """
    touch_mass: Float[Array, "touches"]
    """The same of links that may meet."""
    inertia: Float[Array, "slots 3 3"]
    center_of_mass: Float[Array, "bodies 3"]
    stretch: Float[Array, "bodies 3 3"]
    length_axis: Float[Array, "bodies 3"]
    fixed_position: Float[Array, "fixed 3"]
    fixed_quaternion: Float[Array, "fixed 4"]
    point_a: Float[Array, "joints 3"]
    point_b: Float[Array, "joints 3"]
    axes_a: Float[Array, "joints 3 3"]
    axes_b: Float[Array, "joints 3 3"]
    begins_near: Float[Array, "joints"]
    """Angle that a turning joint's q begins within half a turn of [rad]."""
    compliance: Float[Array, "joints 6"]
    damping: Float[Array, "joints"]
    dry_limit: Float[Array, "joints"]
    dry_per_load: Float[Array, "joints"]
    bend: Float[Array, "joints"]
    """Limit of dry friction where a joint carries the mechanism's weight, times how far it gives before it slides."""
    creep: Float[Array, "joints"]
    """The same limit, times the rate of its onset."""
    rotor: Float[Array, "joints"]
    stiffness: Float[Array, "joints"]
    """Of springs that act through the step, along the coordinates [N m/rad or N/m]."""
    rest: Float[Array, "joints"]
    """Coordinate where such a spring is slack."""
    stick_rate: Float[Array, "joints"]
    barrier: Float[Array, ""]
    tolerance: float = eqx.field(static=True)
    strut_a: Float[Array, "struts 3"]
    strut_b: Float[Array, "struts 3"]
    strut_damping: Float[Array, "struts"]
    forces: tuple[Placed, ...]
    drags: tuple[Placed, ...]
    efforts: tuple[Placed, ...]
    rate_frictions: tuple[Placed, ...]
    motions: tuple[Placed, ...]
    struts: tuple[Placed, ...]
    markers: Float[Array, "markers 3"]
    held_s: Float[Array, ""]
    """Time from the stated release to the true one."""
    bases: tuple[Placed, ...]
    pushes: tuple[Placed, ...]

    @property
    def pairs(self) -> np.ndarray:
        """(joints, 2) slots of body A and body B."""
        return np.array(self.topology.joints, dtype=int).reshape(-1, 2)

    @property
    def held_rows(self) -> np.ndarray:
        """(joints, 6) rows held by the kind of joint."""
        return np.array(self.held, dtype=bool).reshape(-1, 6)

    @property
    def loose_rows(self) -> np.ndarray:
        """(joints, 6) rows that play frees."""
        rows = [[row in loose for row in range(6)] for loose in self.contacts.loose]
        return np.array(rows, dtype=bool).reshape(-1, 6)

    @property
    def rigid_rows(self) -> np.ndarray:
        """(joints, 6) rows held by the kind of joint, without those that play frees."""
        return self.held_rows & ~self.loose_rows

    @property
    def coordinate_rows(self) -> np.ndarray:
        """(joints, 6) one-hot row of the coordinate; all false where a joint has none."""
        rows = [c if c is not None else -1 for c in self.coordinate]
        return np.array(rows, dtype=int).reshape(-1, 1) == np.arange(6)

    @property
    def is_driven(self) -> np.ndarray:
        """(joints,) whether the coordinate is prescribed."""
        return np.isin(np.arange(len(self.coordinate)), self.driven)

    def centred(self) -> "System":
        """The same with loose pins in the middle of their holes and links straight: how a start is described."""
        rigid = dataclasses.replace(self.contacts, loose=tuple(() for _ in self.contacts.loose))
        held = tuple((True,) * 6 if j in self.sections else rows for j, rows in enumerate(self.held))
        return dataclasses.replace(self, contacts=rigid, held=held)

    def point(self, body: np.ndarray, p_BP: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
        """Drawn points of bodies (slots) -> from the centre of mass of the real part, in body axes."""
        if not len(body):
            return p_BP
        return jnp.einsum("nij,nj->ni", self.stretch[body], p_BP) - self.center_of_mass[body]


@eqx.filter_jit  # one by one its operations would take ten times as long to compile
def system(model: Model, tolerance: float = TOLERANCE) -> System:
    """Apply the errors of the drawing, then add up what acts at each joint.

    tolerance: error of a step's displacement, in mechanism lengths, at which Newton's method stops.
    """
    model = amended(model)
    topology, drawing = model.topology, redraw(model)
    joints = len(topology.joint_ids)
    motions = model.of(AbstractJointMotion)
    driven = tuple(sorted({int(j) for placed in motions for j in placed.at()}))
    types = [joint_of_type(t) for t in topology.joint_types]
    limits, yields = _dry_limits(model, drawing)
    coordinate = [t.coordinate for t in types]
    struts, sections = model.of(AbstractStrut), model.of(AbstractSection)
    anchors = [jax.vmap(lambda e: e.anchors())(placed.here) for placed in struts]
    slots, scale = topology.slots, model.scale
    center = jnp.einsum("bij,bj->bi", drawing.stretch, drawing.center_of_mass)
    sliding = jnp.array([t.coordinate != TURN for t in types], dtype=bool)
    made = System(
        topology=topology,
        scale=scale,
        held=tuple(t.held for t in types),
        coordinate=tuple(coordinate),
        touches=touches(touching_kinds(list(model.effects))),
        pads=pads(
            bed_friction(list(model.effects)), drawing, model.view_axis, quaternion.rotation(model.drawn_poses[:, 3:])
        ),
        contacts=joint_contacts(
            model.of(AbstractJointClearance), model.of(AbstractJointStop), coordinate, driven, drawing.pin_radius
        ),
        load_dependent=any(_depends_on_load(placed) for placed in model.of(AbstractDryFriction)),
        driven=driven,
        sections=tuple(sorted(int(j) for placed in sections for j in placed.at())),
        mass=drawing.mass[:slots],
        joint_mass=jnp.zeros(joints),
        touch_mass=jnp.zeros(len(topology.touches)),
        inertia=drawing.inertia[:slots],
        center_of_mass=center.at[slots:].set(0.0),
        stretch=drawing.stretch,
        length_axis=drawing.length_axis,
        fixed_position=model.drawn_poses[slots:, :3],
        fixed_quaternion=model.drawn_poses[slots:, 3:],
        point_a=jnp.zeros((joints, 3)),
        point_b=jnp.zeros((joints, 3)),
        axes_a=drawing.axes_a,
        axes_b=drawing.axes_b,
        begins_near=_begins_near(drawing, motions),
        compliance=jnp.zeros((joints, 6)),
        damping=_total(joints, [*model.of(AbstractJointDamping), *sections], lambda e: e.damping()),
        dry_limit=limits[0],
        dry_per_load=limits[1],
        bend=yields[0],
        creep=yields[1],
        rotor=_total(joints, model.of(AbstractJointInertia), lambda e: e.inertia()),
        stiffness=_total(joints, sections, lambda e: e.stiffness()),
        rest=jnp.zeros(joints),
        stick_rate=STICK_RATE * jnp.where(sliding, scale.length_m, 1.0),
        barrier=BARRIER * scale.mass_kg * scale.gravity_m_per_s2 * scale.length_m,
        tolerance=tolerance,
        strut_a=jnp.zeros((len(topology.struts), 3)),
        strut_b=jnp.zeros((len(topology.struts), 3)),
        strut_damping=_joined([jax.vmap(lambda e: e.damping())(p.here) for p in struts], (0,)),
        forces=(*weight(drawing, topology), *model.of(AbstractBodyForce)),
        drags=tuple(model.of(AbstractDrag)),
        efforts=tuple(model.of(AbstractJointEffort)),
        rate_frictions=tuple(model.of(AbstractRateFriction)),
        motions=tuple(motions),
        struts=tuple(struts),
        markers=model.marker_points,
        held_s=sum((jnp.sum(jax.vmap(lambda e: e.delay())(p.here)) for p in model.of(AbstractHold)), jnp.zeros(())),
        bases=tuple(model.of(AbstractBaseMotion)),
        pushes=tuple(model.of(AbstractPush)),
    )
    pairs = made.pairs
    ends = np.array(topology.struts, dtype=int).reshape(-1, 2)
    met = np.array(topology.touches, dtype=int).reshape(-1, 2)
    point_a, point_b = made.point(pairs[:, 0], drawing.point_a), made.point(pairs[:, 1], drawing.point_b)
    return eqx.tree_at(
        lambda s: (
            s.point_a,
            s.point_b,
            s.compliance,
            s.joint_mass,
            s.touch_mass,
            s.strut_a,
            s.strut_b,
            s.markers,
            s.touches.first,
            s.touches.second,
        ),
        made,
        (
            point_a,
            point_b,
            _compliance(made, pairs, point_a, point_b),
            *(jnp.minimum(jnp.exp(_mean_mass(made, held)), scale.mass_kg) for held in (pairs, met)),
            made.point(ends[:, 0], _joined([a for a, _ in anchors], (0, 3))),
            made.point(ends[:, 1], _joined([b for _, b in anchors], (0, 3))),
            made.point(np.array(model.marker_bodies, dtype=int), marker_points(model)),
            *(_from_center(made, met[:, side], c) for side, c in enumerate((made.touches.first, made.touches.second))),
        ),
    )


def _begins_near(drawing: Drawing, motions: Sequence[Placed]) -> Array:
    """As drawn; where a joint's path is prescribed, as that now begins."""
    near = drawing.begins_near
    for placed in motions:
        near = near.at[placed.at()].set(jax.vmap(lambda e: e.target())(placed.here))
    return lax.stop_gradient(near)


def _from_center(made: System, body: np.ndarray, capsule: Capsule) -> Capsule:
    return Capsule(made.point(body, capsule.start), made.point(body, capsule.end), capsule.radius)


def _compliance(made: System, pairs: np.ndarray, point_a: Array, point_b: Array) -> Array:
    """ε per row: COMPLIANCE over the mass (translations) or the inertia (turns) that the row holds.

    The mass is the geometric mean of the two bodies', so that neither a heavy base nor a light coupler
    loses its momentum in rounding.
    """
    slots = made.topology.slots
    gyration_square = jnp.trace(made.inertia, axis1=1, axis2=2) / (3 * made.mass)
    square = jnp.append(gyration_square, 1.0)[np.minimum(pairs, slots)]
    square = square + jnp.stack([jnp.sum(point_a**2, -1), jnp.sum(point_b**2, -1)], -1)
    mean_square = _mean_where(pairs < slots, square)
    linear = COMPLIANCE / jnp.exp(_mean_mass(made, pairs))
    return jnp.concatenate([jnp.tile(linear[:, None], 3), jnp.tile((linear / mean_square)[:, None], 3)], -1)


def _mean_mass(made: System, pairs: np.ndarray) -> Array:
    """Mean logarithm of the masses on the moving sides."""
    slots = made.topology.slots
    return _mean_where(pairs < slots, jnp.log(jnp.append(made.mass, 1.0)[np.minimum(pairs, slots)]))


def _mean_where(mask: np.ndarray, values: Array) -> Array:
    """Mean over the moving sides of a joint; 1 between two fixed bodies, where nothing moves."""
    total = jnp.sum(jnp.where(mask, values, 0.0), -1)
    return jnp.where(mask.any(-1), total / np.maximum(mask.sum(-1), 1), 1.0)


def _dry_limits(model: Model, drawing: Drawing) -> tuple[Array, Array]:
    """Constant part of the limits and their slope in the load (2, joints) (the shape is linear in it); and, under the
    mechanism's weight, the limits times how far each gives and times the rate of its onset (2, joints).
    """
    joints, heavy = drawing.pin_radius.shape[0], model.scale.mass_kg * model.scale.gravity_m_per_s2
    limits, yields = jnp.zeros((2, joints)), jnp.zeros((2, joints))
    for placed in model.of(AbstractDryFriction):
        radius, gives = drawing.pin_radius[placed.at()], jax.vmap(lambda e: jnp.stack([e.presliding(), e.onset()]))
        unloaded = jax.vmap(lambda e, r: e.limit(jnp.zeros(()), r))(placed.here, radius)
        loaded = jax.vmap(lambda e, r: e.limit(jnp.ones(()), r))(placed.here, radius)
        own = (unloaded, loaded - unloaded)
        limits = limits + jnp.stack([placed.summed(joints, part) for part in own])
        by = gives(placed.here) * (own[0] + heavy * own[1])[:, None]
        yields = yields + jnp.stack([placed.summed(joints, part) for part in by.T])
    return limits, yields


def _depends_on_load(placed: Placed) -> bool:
    """Asked of the effect's law itself, with every parameter one."""
    ones = jax.tree.map(lambda leaf: np.ones(np.shape(leaf)[1:]), placed.effect)
    return float(ones.limit(1.0, 1.0)) != float(ones.limit(0.0, 1.0))


def _total(joints: int, placed: list[Placed], value) -> Array:
    return sum((p.summed(joints, jax.vmap(value)(p.here)) for p in placed), jnp.zeros(joints))


def _joined(parts: list[Array], empty: tuple[int, ...]) -> Array:
    return jnp.concatenate(parts) if parts else jnp.zeros(empty)
