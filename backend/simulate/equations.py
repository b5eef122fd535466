"""The equations of one time step, and their slope over the body graph.

Constraint and friction impulses act along the joints' rows at q_k; the rows are met at q_{k+1} (a variational
integrator in the manner of SHAKE, second order).  The unknowns are one increment ξ per body and the impulses; the
laws of the joints are condensed, so that the linear system has one 6 x 6 block per body.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from backend.frames.quaternion import tangent_map
from backend.joints.joint import SLIDE, TURN
from backend.model.incidence import picked
from backend.model.state import Pose
from backend.model.system import STICK_RATE, System
from backend.simulate import contact, forces, kinematics, law, linear, meeting, rubbing
from backend.simulate.contact import Reach
from backend.simulate.giving import Bounds
from backend.simulate.law import Drive, Impulses
from backend.simulate.momentum import BodyRows, momentum, momentum_slope
from backend.simulate.piece import WHOLE, Piece
from backend.simulate.slopes import known
from backend.simulate.small import apply, apply_transposed


class Motion(eqx.Module):
    """All that the next step needs to know."""

    pose: Pose
    bodies: kinematics.Bodies
    """At the pose, as the step before left them; its joints' rows likewise."""
    rows: kinematics.Rows
    time_s: Array
    """Since the stated release."""
    momentum: BodyRows
    """P⁻ of the step before: what each body brings to q_k."""
    before_s: Array
    """Length of the step before; 0 where the motion begins."""
    velocity: BodyRows
    """Increment of the step before, per second."""
    acceleration: BodyRows
    """Change of the velocity per second that Newton's method expects."""
    q: Float[Array, "joints"]
    rate: Float[Array, "joints"]
    """Of the joints' coordinates in the step before."""
    quickening: Float[Array, "joints"]
    """Change of the rate per second, from the step before that one."""
    borne: Float[Array, "joints"]
    """Share of its limit that dry friction bears, against the coordinate, in the middle of the step before: -1 to 1."""
    opening: Float[Array, "walls"]
    """Rate of the gaps at the walls in the step before."""
    parting: Float[Array, "places"]
    """Rate of the gaps between links in the step before."""
    impulses: Impulses
    taken: Bounds
    """What walls have taken by now [J]."""


class Unknowns(NamedTuple):
    """What a step solves for."""

    xi: BodyRows
    impulses: Impulses


class Frame(NamedTuple):
    """Everything at q_k that the step's equations keep fixed."""

    step_s: float | Array
    weight_s: Array
    """Time that the impulses at q_k stand for: half of the steps before and after."""
    pose: Pose
    bodies: kinematics.Bodies
    jacobian: Float[Array, "joints 6 12"]
    offset: Float[Array, "joints"]
    """Value at q_k of the row along which a joint slides."""
    strut_slope: Float[Array, "struts 12"]
    given: BodyRows
    """Momentum brought in, and impulse of the forces."""
    before: BodyRows
    """Velocity in the step before."""
    drive: Drive
    meeting: meeting.Meeting
    """Links that touch, and bodies on the bed."""


class There(NamedTuple):
    """The mechanism at q_{k+1}."""

    bodies: kinematics.Bodies
    rows: kinematics.Rows
    moved: Float[Array, "joints 6"]
    """Values of the rows; a coordinate's is its displacement in the step."""


class Linearised(NamedTuple):
    """The equations' slope at one point, factored."""

    factor: linear.Factor
    bodies: Float[Array, "slots 6 6"]
    """What the matrix has on every body beside what its links bring."""
    others: Float[Array, "others 12 12"]
    """Blocks of links that are not joints."""
    here: Float[Array, "joints 6 12"]
    there: Float[Array, "joints 6 12"]
    slope: law.Slope
    touch: meeting.Slope
    impulses: Impulses
    turn: Float[Array, "slots 3 3"]


def frame(
    system: System,
    motion: Motion,
    step_s: float | Array,
    target: Float[Array, "joints"],
    most: Bounds,
    piece: Piece = WHOLE,
) -> Frame:
    """Evaluate forces and directions at q_k.

    target: q that driven joints must reach.  most: largest gaps that walls may ask for one step ahead [m].
    piece: whether the step is a piece of another, see there.
    """
    bodies, rows = motion.bodies, motion.rows
    lines = forces.strut_lines(system, bodies)
    weight = 0.5 * (motion.before_s + step_s)
    force = forces.body_forces(system, bodies, motion.velocity, lines)
    rate = _expected_rate(system, motion, rows.jacobian)
    presliding, onset = forces.giving(system, rate)
    hold = piece.blur * system.stick_rate
    limit = forces.dry_limits(system, rate)
    before = motion.borne, motion.rate, motion.quickening
    rub = rubbing.foretell(limit, presliding, hold, onset, *before, step_s, weight)
    drive = Drive(
        step_s,
        weight,
        rub,
        weight * forces.joint_efforts(system, motion.q),
        motion.rate,
        motion.q,
        jnp.where(system.is_driven, target - motion.q, 0.0),
        _reach(system, motion, rows, step_s, weight, most.walls, piece),
    )
    return Frame(
        step_s,
        weight,
        motion.pose,
        bodies,
        rows.jacobian,
        _offset(system, rows.value),
        lines.slope,
        motion.momentum + weight * force,
        motion.velocity,
        drive,
        meeting.meet(
            system, bodies, motion.parting, motion.impulses.touches.normal, step_s, weight, most.touches, piece
        ),
    )


def _offset(system: System, value: Float[Array, "joints 6"]) -> Float[Array, "joints"]:
    """What a joint slid by now; where none slides, there is nothing to differentiate."""
    slides = system.coordinate_rows[:, SLIDE]
    return jnp.where(slides, value[:, SLIDE], 0.0) if slides.any() else jnp.zeros(len(slides))


def refreshed(system: System, motion: Motion) -> Motion:
    """The same motion, where what depends on the pose alone takes its slopes from there: a step hands on no others."""
    bodies = known(kinematics.bodies, motion.bodies, system, motion.pose)
    rows = known(kinematics.rows, motion.rows, system, bodies)
    q = known(kinematics.coordinates_near, motion.q, system, bodies, motion.q)
    return eqx.tree_at(lambda m: (m.bodies, m.rows, m.q), motion, (bodies, rows, q))


def _expected_rate(system: System, motion: Motion, jacobian: Array) -> Float[Array, "joints"]:
    """Rates of the coordinates at q_k, from the two steps before.

    Solving for them instead would let a limit that falls with the rate have several answers, between which Newton's
    method circles once the fall outweighs the inertia within a step.
    """
    if not system.rate_frictions:
        return motion.rate
    velocity = motion.velocity + 0.5 * motion.before_s * motion.acceleration
    rates = apply(jacobian, _of_pairs(system, system.topology.joints, velocity))
    return law.displacement(system, rates)


def _reach(
    system: System,
    motion: Motion,
    rows: kinematics.Rows,
    step_s: float | Array,
    weight: Array,
    most: Float[Array, "walls"],
    piece: Piece,
) -> Reach:
    """What the walls see of q_k; an end of travel counts from where the coordinate is."""
    contacts, step = system.contacts, jnp.asarray(step_s)
    here = law.at_walls(system, jnp.where(system.coordinate_rows, 0.0, rows.value))
    travelled = contacts.normal[:, 0] * picked(motion.q, contacts.at)
    room = jnp.where(np.array(contacts.travels, dtype=bool), contacts.room - travelled, contacts.room)
    gap = contact.gap(contacts, room, here)
    back = gap - step * motion.opening
    cut = piece.cut
    e = jnp.where(cut, 0.0, contacts.restitution)
    # Within a hole a gap is at most the room, however far a part would have flown in the step before.
    soft = (1.0 + e * e) / jnp.maximum(e * e, 1e-6)  # of the give on the way out, twice over
    pressed = soft * contacts.give / weight * motion.impulses.walls.normal
    back = jnp.where(contacts.is_round, jnp.clip(back, -jnp.where(cut, 0.0, 0.5 * room) - pressed, room), back)
    scale = system.scale
    fall = jnp.sqrt(scale.gravity_m_per_s2 * scale.length_m)
    # A pin's surface moves slower than the bar's end by radius over length: what creeps there shows at the end.
    radius = contacts.selection[:, 2, TURN]
    stick = step * piece.blur * STICK_RATE * jnp.where(radius > 0.0, radius, scale.length_m)
    load = motion.impulses.walls.normal
    stride = jnp.where(cut, 0.0, contact.STRIDE)
    walled = jnp.einsum("cri,cik->crk", contacts.selection[:, :2], picked(rows.jacobian, contacts.at))
    ease = step * kinematics.ease(system, walled, system.pairs[contacts.at]) + contacts.give / weight
    return Reach(
        room=room,
        here=here,
        back=back,
        deep=jnp.maximum(jnp.where(cut, piece.left_in(gap, contacts.give / weight * load), e * back), -most),
        step_s=step,
        span_s=2 * step,
        weight_s=weight,
        stick=stick,
        creep=contact.CREEP * fall,
        ease=ease,
        stride=stride,
        restitution=e,
        load=load,
        lagging=piece.lagging,
    )


def softened(at: Frame, factor: float | Array) -> Frame:
    """The same step with friction that holds only below a higher rate."""
    reach, meet = at.drive.reach, at.meeting
    rub = rubbing.softened(at.drive.rubbing, factor)
    drive = at.drive._replace(rubbing=rub, reach=reach._replace(stick=reach.stick * factor))
    meet = meet._replace(stick=meet.stick * factor, reach=meet.reach._replace(stick=meet.reach.stick * factor))
    return at._replace(drive=drive, meeting=meet)


def equations(system: System, at: Frame, unknowns: Unknowns, barrier: Bounds) -> tuple[Unknowns, There]:
    """Residuals of momentum and of the joints' laws, and the mechanism at q_{k+1}."""
    xi, impulses = unknowns
    there = ahead(system, at, xi)
    pulled = kinematics.pulled(system, at.bodies, at.jacobian, impulses.rows)
    carried = forces.collect(system.topology.joint_sides, pulled)
    balance = momentum(system, xi, at.step_s, 1.0) - at.given - carried
    if system.drags:
        balance = balance - at.weight_s * forces.drag(system, at.bodies, _mean_velocity(at, xi))
    if system.topology.struts:
        pull = -at.weight_s * system.strut_damping * _lengthening(system, at.strut_slope, _mean_velocity(at, xi))
        table = system.topology.strut_sides
        balance = balance - forces.collect(table, pull[:, None] * at.strut_slope)
    asked = law.residual(system, at.drive, there.moved, impulses, barrier.walls)
    if system.touches.count or system.pads.count:
        asked, pushed = meeting.residual(system, at.meeting, xi, asked, barrier.touches)
        balance = balance - pushed
    return Unknowns(balance, asked), there


def ahead(system: System, at: Frame, xi: BodyRows) -> There:
    """Where an increment leads."""
    bodies = kinematics.bodies(system, at.pose.advance(xi))
    rows = kinematics.rows(system, bodies)
    turned = kinematics.turned(system, xi)
    turning = system.coordinate_rows.copy()
    turning[:, :5] = False
    moved = jnp.where(turning, turned[:, None], rows.value - at.offset[:, None])
    return There(bodies, rows, jnp.where(system.coordinate_rows, moved, rows.value))


def _lengthening(system: System, strut_slope: Float[Array, "struts 12"], velocity: BodyRows) -> Float[Array, "struts"]:
    """Rate at which each strut lengthens under a velocity of the bodies."""
    return jnp.sum(strut_slope * _of_pairs(system, system.topology.struts, velocity), -1)


def linearise(system: System, at: Frame, unknowns: Unknowns, led: There) -> Linearised:
    """Slope of the equations, assembled over the body graph and factored."""
    xi, impulses = unknowns
    turn = tangent_map(xi[:, 3:])
    there = _along_increments(system, led.rows.jacobian, turn)
    slope = law.slope(system, at.drive, led.moved, impulses)
    own = momentum_slope(system, xi, at.step_s)
    if system.drags:
        drag = forces.drag_slope(system, at.bodies, _mean_velocity(at, xi))
        own = own - 0.5 * at.weight_s / at.step_s * _turn_columns(drag, turn)
    share = 0.5 * at.weight_s / at.step_s
    strut = share * system.strut_damping[:, None] * _strut_there(system, at.strut_slope, turn)
    others = at.strut_slope[:, :, None] * strut[:, None, :]
    touch = meeting.slope(system, at.meeting, xi, impulses, turn)
    own = own + touch.on_bodies
    others = jnp.concatenate([others, touch.between])
    factor = linear.factor(system.topology, own, at.jacobian, slope.stiffness, there, others)
    return Linearised(factor, own, others, at.jacobian, there, slope, touch, impulses, turn)


def direction(system: System, at: Linearised, residual: Unknowns, refined: bool = False) -> tuple[Unknowns, Array]:
    """The change of the unknowns that cancels a residual, and the rows' change that it brings; linear in the residual.

    refined: solve once more for what the first solution leaves.  Stiff rows (1/ε) leave it 1e-8 of itself in rounding,
    which Newton's next iteration removes, but a derivative would keep.
    """
    offset, walls = law.offset(system, at.slope, at.impulses, residual.impulses)
    change, pushed = meeting.offset(system, at.touch, at.impulses, residual.impulses)
    wanted = _on_bodies(system, at.here, offset) + pushed - residual.xi
    moved = linear.solve(at.factor, wanted)
    if refined:
        moved = moved + linear.solve(at.factor, wanted - _answered(system, at, moved))
    dy = apply(at.there, _of_pairs(system, system.topology.joints, moved))
    xi = jnp.concatenate([moved[:, :3], apply(at.turn, moved[:, 3:])], -1)
    rows = offset - law.react(system, at.slope, dy)
    touches, pads = meeting.respond(system, at.touch, change, moved)
    return Unknowns(xi, Impulses(rows, law.walls_respond(system, at.slope, walls, dy), touches, pads)), dy


def _answered(system: System, at: Linearised, moved: BodyRows) -> BodyRows:
    """The condensed matrix times a motion of the bodies, link by link: stiffness meets what joints give way by."""
    topology = system.topology
    dy = apply(at.there, _of_pairs(system, topology.joints, moved))
    answered = jnp.einsum("bij,bj->bi", at.bodies, moved) + _on_bodies(system, at.here, law.react(system, at.slope, dy))
    others = topology.struts + topology.touches
    if others:
        carried = jnp.einsum("oij,oj->oi", at.others, _of_pairs(system, others, moved))
        answered = answered + forces.collect(topology.sides_of(np.array(others, dtype=int)), carried)
    return answered


def _mean_velocity(at: Frame, xi: BodyRows) -> BodyRows:
    """Velocity around q_k, from the steps before and after it."""
    return 0.5 * (at.before + xi / at.step_s)


def _of_pairs(system: System, pairs: tuple[tuple[int, int], ...], moved: BodyRows) -> Float[Array, "pairs 12"]:
    """Rows of both bodies of each pair side by side; fixed bodies do not move."""
    slots = system.topology.slots
    index = np.minimum(np.array(pairs, dtype=int).reshape(-1), slots)
    return picked(moved, index).reshape(-1, 12)


def _on_bodies(system: System, jacobian: Float[Array, "joints 6 12"], rows: Float[Array, "joints 6"]) -> BodyRows:
    """Jᵀ λ, gathered on the bodies."""
    return forces.collect(system.topology.joint_sides, apply_transposed(jacobian, rows))


def _along_increments(system: System, jacobian: Array, turn: Array) -> Array:
    """The rows' slope in the turn of the advanced bodies; a free turn is measured in φ, so dφ/dθ enters."""
    turning = system.coordinate_rows[:, TURN]
    if not turning.any():
        return jacobian
    slots = system.topology.slots
    both = jnp.concatenate([turn, jnp.eye(3)[None]])[np.minimum(system.pairs, slots)]
    a = jnp.sum(jacobian[:, TURN, 3:6, None] * both[:, 0], 1)
    b = jnp.sum(jacobian[:, TURN, 9:12, None] * both[:, 1], 1)
    zero = jnp.zeros_like(a)
    pin = jnp.concatenate([zero, a, zero, b], -1)
    return jacobian.at[:, TURN].set(jnp.where(turning[:, None], pin, jacobian[:, TURN]))


def _turn_columns(block: Float[Array, "slots 6 6"], turn: Array) -> Float[Array, "slots 6 6"]:
    """Columns in dφ -> columns in the turn of the advanced body."""
    return jnp.concatenate([block[:, :, :3], jnp.einsum("bij,bjk->bik", block[:, :, 3:], turn)], -1)


def _strut_there(system: System, strut_slope: Array, turn: Array) -> Array:
    if not system.topology.struts:
        return strut_slope
    slots = system.topology.slots
    index = np.minimum(np.array(system.topology.struts, dtype=int).reshape(-1, 2), slots)
    both = jnp.concatenate([turn, jnp.eye(3)[None]])[index]
    a = jnp.einsum("si,sij->sj", strut_slope[:, 3:6], both[:, 0])
    b = jnp.einsum("si,sij->sj", strut_slope[:, 9:12], both[:, 1])
    return jnp.concatenate([strut_slope[:, :3], a, strut_slope[:, 6:9], b], -1)
