"""Contacts outside joints during a step: links that touch, and bodies on the bed.

Gaps and slidings change with the step's increments ξ through their rows at q_k: to first order within a step, and
measured anew at every node.  Friction on the bed is regularised Coulomb's with a steady load,
f = -w D u / √(|u|² + (h ε_v)²), u the sliding of a pad in the bed's plane.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from backend.model.incidence import added, picked
from backend.model.system import STICK_RATE, System
from backend.simulate import contact, forces, kinematics, touch
from backend.simulate.contact import Push, Reach
from backend.simulate.kinematics import Bodies
from backend.simulate.law import Impulses
from backend.simulate.momentum import BodyRows
from backend.simulate.piece import WHOLE, Piece
from backend.simulate.small import apply_transposed


class Meeting(NamedTuple):
    """What a step keeps fixed: the places' rows and reach; the pads' rows, grip and sliding below which they hold."""

    rows: Float[Array, "places 2 12"]
    reach: Reach
    pads: Float[Array, "pads 2 6"]
    grip: Float[Array, "pads"]
    stick: Array


class Slope(NamedTuple):
    """Slopes of the laws, and the blocks that they add to the linear system."""

    walls: contact.Slope | None
    rows: Float[Array, "places 2 12"]
    ahead: Float[Array, "places 2 12"]
    """Rows in the turn of the advanced bodies."""
    pads: Float[Array, "pads 2 6"]
    pads_ahead: Float[Array, "pads 2 6"]
    drag: Float[Array, "pads 2 2"]
    on_bodies: Array
    between: Float[Array, "touches 12 12"]


def meet(
    system: System,
    bodies: Bodies,
    parting: Float[Array, "places"],
    pushed: Float[Array, "places"],
    step_s: float | Array,
    weight: Array,
    most: Float[Array, "places"],
    piece: Piece = WHOLE,
) -> Meeting:
    """Look at the bodies at q_k.

    parting, pushed: rate of the gaps and what the places carried in the step before; most: gaps that they may ask for.
    """
    step, scale = jnp.asarray(step_s), system.scale
    stick = step * piece.blur * STICK_RATE * scale.length_m
    near = touch.near(system, bodies)
    none = jnp.zeros((near.gap.shape[0], 3))
    fall = jnp.sqrt(scale.gravity_m_per_s2 * scale.length_m)
    back = near.gap - step * parting
    sticks = stick * jnp.ones_like(near.gap)
    walls = touch.walls(system)
    e = jnp.where(piece.cut, 0.0, walls.restitution)
    give = walls.give / jnp.maximum(weight, 1e-300)
    ease = step * kinematics.ease(system, near.rows[:, :1], _places(system)) + give
    reach = Reach(
        room=near.gap,
        here=none,
        back=back,
        deep=jnp.maximum(jnp.where(piece.cut, piece.left_in(near.gap, give * pushed), e * back), -most),
        step_s=step,
        span_s=2 * step,
        weight_s=weight,
        stick=sticks,
        creep=contact.CREEP * fall,
        ease=ease,
        stride=jnp.zeros(()),
        restitution=e,
        load=pushed,
        lagging=piece.lagging,
    )
    return Meeting(near.rows, reach, _pad_rows(system, bodies), weight * system.pads.grip, stick)


def partings(system: System, at: Meeting, velocity: BodyRows) -> Float[Array, "places"]:
    """Rates of the gaps under a velocity of the bodies."""
    return jnp.sum(at.rows[:, 0] * _of_places(system, velocity), -1)


def residual(
    system: System, at: Meeting, xi: BodyRows, impulses: Impulses, barrier: Array
) -> tuple[Impulses, BodyRows]:
    """How far the impulses are from their laws, and the impulses on the bodies."""
    walls, touches, pads = touch.walls(system), impulses.touches, impulses.pads
    pushed = jnp.zeros_like(xi)
    if system.touches.count:
        touches, carried = contact.residual(walls, at.reach, _eta(system, at.rows, xi), touches, barrier)
        pushed = pushed + _on_bodies(system, at.rows, carried)
    if system.pads.count:
        u, rounded = _sliding(system, at, xi)
        pushed = pushed + _on_pads(system, at.pads, pads)
        pads = pads + at.grip[:, None] * u / rounded
    return impulses._replace(touches=touches, pads=pads), pushed


def slope(system: System, at: Meeting, xi: BodyRows, impulses: Impulses, turn: Float[Array, "slots 3 3"]) -> Slope:
    """Slope of the laws and the blocks they add.  turn: dφ / d(turn of the advanced body)."""
    slots, walls = system.topology.slots, None
    on_bodies, ahead, between = jnp.zeros((slots, 6, 6)), at.rows, jnp.zeros((system.touches.count, 12, 12))
    if system.touches.count:
        ahead = _turned(at.rows.reshape(-1, 2, 2, 6), turn, _places(system)).reshape(at.rows.shape)
        walls = contact.slope(touch.walls(system), at.reach, _eta(system, at.rows, xi), impulses.touches)
        blocks = jnp.einsum("pri,prs,psj->pij", at.rows, walls.stiffness[:, :2, :2], ahead)
        between = jnp.sum(blocks.reshape(-1, touch.PLACES, 12, 12), 1)
    pads_ahead, drag = at.pads, jnp.zeros((system.pads.count, 2, 2))
    if system.pads.count:
        bodies = np.array(system.pads.bodies, dtype=int)
        pads_ahead = _turned(at.pads[:, :, None], turn, bodies[:, None])[:, :, 0]
        u, rounded = _sliding(system, at, xi)
        size = jnp.sqrt(jnp.sum(impulses.pads**2, -1, keepdims=True)) / jnp.maximum(at.grip, 1e-300)[:, None]
        held = impulses.pads / jnp.maximum(1.0, size)
        # Chan, Golub and Mulet's slope, as for the friction of joints.
        drag = (at.grip[:, None, None] * jnp.eye(2) + held[:, :, None] * (u / rounded)[:, None, :]) / rounded[
            :, :, None
        ]
        blocks = jnp.einsum("pri,prs,psj->pij", at.pads, drag, pads_ahead)
        on_bodies = added(blocks, bodies, slots)
    return Slope(walls, at.rows, ahead, at.pads, pads_ahead, drag, on_bodies, between)


def offset(system: System, at: Slope, impulses: Impulses, wanted: Impulses) -> tuple[tuple[Push, Array], BodyRows]:
    """Changes at fixed ξ that cancel residuals `wanted`, and the impulses on the bodies that they are."""
    touches, pads = wanted.touches, -wanted.pads
    pushed = jnp.zeros((system.topology.slots, 6))
    if at.walls is not None:
        touches, carried = contact.offset(touch.walls(system), at.walls, impulses.touches, wanted.touches)
        pushed = pushed + _on_bodies(system, at.rows, carried)
    if system.pads.count:
        pushed = pushed + _on_pads(system, at.pads, pads)
    return (touches, pads), pushed


def respond(system: System, at: Slope, own: tuple[Push, Array], moved: BodyRows) -> tuple[Push, Array]:
    """Changes in all: their own, and what the bodies' motion brings."""
    touches, pads = own
    if at.walls is not None:
        brought = contact.respond(touch.walls(system), at.walls, _eta(system, at.ahead, moved))
        touches = Push(*(mine + theirs for mine, theirs in zip(touches, brought, strict=True)))
    if system.pads.count:
        slid = jnp.sum(at.pads_ahead * _of_pads(system, moved)[:, None], -1)
        pads = pads - jnp.sum(at.drag * slid[:, None, :], -1)
    return touches, pads


def gaps(at: Meeting, system: System, xi: BodyRows) -> Float[Array, "places"]:
    """Gaps between links one step ahead."""
    return at.reach.room + jnp.sum(at.rows[:, 0] * _of_places(system, xi), -1)


def _pad_rows(system: System, bodies: Bodies) -> Float[Array, "pads 2 6"]:
    """Slope of a pad's shift in the bed's plane."""
    pads = system.pads
    if not pads.count:
        return jnp.zeros((0, 2, 6))
    which = np.array(pads.bodies, dtype=int)
    n = pads.normal
    seed = jnp.where(jnp.abs(n[0]) < 0.9, jnp.array([1.0, 0.0, 0.0]), jnp.array([0.0, 1.0, 0.0]))
    first = seed - n * (n @ seed)
    first = first / jnp.sqrt(first @ first)
    rows = []
    for u_W in (first, jnp.cross(n, first)):
        u_B = apply_transposed(picked(bodies.rotation, which), jnp.broadcast_to(u_W, (len(which), 3)))
        shift = jnp.broadcast_to(u_W, (len(which), 3))
        rows.append(jnp.concatenate([shift, jnp.cross(pads.point, u_B)], -1))
    return jnp.stack(rows, 1)


def _sliding(system: System, at: Meeting, xi: BodyRows) -> tuple[Float[Array, "pads 2"], Float[Array, "pads 1"]]:
    u = jnp.sum(at.pads * _of_pads(system, xi)[:, None], -1)
    return u, jnp.sqrt(jnp.sum(u * u, -1, keepdims=True) + at.stick**2)


def _places(system: System) -> np.ndarray:
    """(places, 2) bodies of every place."""
    return np.array(system.topology.touches, dtype=int).reshape(-1, 2).repeat(touch.PLACES, 0)


def _of_places(system: System, moved: BodyRows) -> Float[Array, "places 12"]:
    index = np.minimum(_places(system).ravel(), system.topology.slots)
    return picked(moved, index).reshape(-1, 12)


def _eta(system: System, rows: Float[Array, "places 2 12"], moved: BodyRows) -> Float[Array, "places 3"]:
    along = jnp.sum(rows * _of_places(system, moved)[:, None, :], -1)
    return jnp.concatenate([along, jnp.zeros_like(along[:, :1])], -1)


def _on_bodies(system: System, rows: Array, carried: Float[Array, "places 3"]) -> BodyRows:
    table = system.topology.sides_of(_places(system))
    return forces.collect(table, jnp.sum(rows * carried[:, :2, None], 1))


def _on_pads(system: System, rows: Float[Array, "pads 2 6"], carried: Float[Array, "pads 2"]) -> BodyRows:
    bodies = np.array(system.pads.bodies, dtype=int)
    return added(jnp.sum(rows * carried[:, :, None], 1), bodies, system.topology.slots)


def _of_pads(system: System, moved: BodyRows) -> Float[Array, "pads 6"]:
    return picked(moved, np.array(system.pads.bodies, dtype=int))


def _turned(rows: Float[Array, "n 2 k 6"], turn: Array, bodies: np.ndarray) -> Float[Array, "n 2 k 6"]:
    """Rows in φ -> rows in the turn of the advanced bodies; bodies: (n, k)."""
    both = jnp.concatenate([turn, jnp.eye(3)[None]])[np.minimum(bodies, turn.shape[0])]
    turned = jnp.einsum("nrki,nkij->nrkj", rows[..., 3:], both)
    return jnp.concatenate([rows[..., :3], turned], -1)
