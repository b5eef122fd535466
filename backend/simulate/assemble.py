"""Close the joints of a mechanism whose parts stand only about right, and find the ways it can move."""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from backend.frames import quaternion
from backend.frames.quaternion import turning_map
from backend.model.state import Pose, Start
from backend.model.system import System
from backend.simulate import forces, kinematics, linear
from backend.simulate.momentum import BodyRows, instantaneous
from backend.simulate.push import pushed
from backend.simulate.redundancy import null_space
from backend.simulate.small import apply

MAX_ITERATIONS = 30
CLOSED = 1e-12  # rows of a closed joint, in mechanism lengths: 100 times rounding


class Gap(NamedTuple):
    """How far the joints are from closed, and which of them is the worst."""

    joint: str
    offset_m: float
    tilt_rad: float


class Correction(NamedTuple):
    """Increment from the reference pose, and the impulses that close the joints."""

    xi: BodyRows
    push: Float[Array, "joints 6"]


Cancel = Callable[[Correction], Correction]


def closed(system: System, reference: Pose, moved: BodyRows | None = None) -> Pose:
    """The closed pose nearest to a reference moved by ξ = `moved`.

    The correction acts along the joints' rows at the reference, weighed by mass: M (ξ - moved) = Jᵀ μ, y(ξ) = 0.
    Where the drawing's loops do not quite fit, the rows are met in the least-squares sense.  Differentiable in the
    system and in `moved`; the reference is taken as given.
    """
    reference = lax.stop_gradient(reference)
    wanted = jnp.zeros((reference.position.shape[0], 6)) if moved is None else moved
    return reference.advance(_close(system.centred(), reference, wanted).xi)


@jax.custom_jvp
def _close(system: System, reference: Pose, wanted: BodyRows) -> Correction:
    here = kinematics.rows(system, kinematics.bodies(system, reference)).jacobian

    def unfinished(carry: tuple) -> Array:
        _, error, before, iterations = carry
        return (error > CLOSED) & (iterations < MAX_ITERATIONS) & (error < 0.9 * before)

    def correct(carry: tuple) -> tuple:
        now, error, _, iterations = carry
        change = _towards(system, reference, here, now)(_residual(system, reference, wanted, now))
        now = Correction(_bounded(now.xi, change.xi), now.push + change.push)
        return now, _error(system, reference, now), error, iterations + 1

    now = Correction(wanted, jnp.zeros(here.shape[:2]))
    return lax.while_loop(unfinished, correct, (now, _error(system, reference, now), jnp.inf, 0))[0]


@_close.defjvp
def _close_jvp(primals: tuple, tangents: tuple) -> tuple[Correction, Correction]:
    system, reference, wanted = primals
    now = _close(system, reference, wanted)
    _, change = jax.jvp(lambda s, w: _residual(s, reference, w, now), (system, wanted), (tangents[0], tangents[2]))
    here = kinematics.rows(system, kinematics.bodies(system, reference)).jacobian
    return now, _refined(
        change,
        _towards(system, reference, here, now),
        lambda by: jax.jvp(lambda n: _residual(system, reference, wanted, n), (now,), (by,))[1],
    )


def _residual(system: System, reference: Pose, wanted: BodyRows, now: Correction) -> Correction:
    here = kinematics.rows(system, kinematics.bodies(system, reference)).jacobian
    rows = kinematics.rows(system, kinematics.bodies(system, reference.advance(now.xi)))
    return _balance(system, here, now.xi - wanted, rows.value, now.push)


def _towards(system: System, reference: Pose, here: Array, now: Correction) -> Cancel:
    """Change of increment and impulses that cancels a residual; linear in it."""
    rows = kinematics.rows(system, kinematics.bodies(system, reference.advance(now.xi)))
    turn = jnp.concatenate([turning_map(now.xi[:, 3:]), jnp.eye(3)[None]])[
        np.minimum(system.pairs, system.topology.slots)
    ]
    there = jnp.concatenate(
        [
            rows.jacobian[:, :, 0:3],
            jnp.einsum("jri,jik->jrk", rows.jacobian[:, :, 3:6], turn[:, 0]),
            rows.jacobian[:, :, 6:9],
            jnp.einsum("jri,jik->jrk", rows.jacobian[:, :, 9:12], turn[:, 1]),
        ],
        -1,
    )
    return _cancelling(system, here, there)


@jax.custom_jvp
def _along(system: System, pose: Pose, wanted: BodyRows) -> Correction:
    """The velocity nearest to a wanted one that the held rows allow: M (v - wanted) = Jᵀ μ, J v = 0."""
    rows = kinematics.rows(system, kinematics.bodies(system, pose)).jacobian
    cancel = _cancelling(system, rows, rows)

    def corrected(_: int, now: Correction) -> Correction:
        return jax.tree.map(jnp.add, now, cancel(_drift(system, pose, wanted, now)))

    return lax.fori_loop(0, 2, corrected, Correction(wanted, jnp.zeros(rows.shape[:2])))


@_along.defjvp
def _along_jvp(primals: tuple, tangents: tuple) -> tuple[Correction, Correction]:
    system, pose, wanted = primals
    now = _along(system, pose, wanted)
    _, change = jax.jvp(lambda s, p, w: _drift(s, p, w, now), primals, tangents)
    rows = kinematics.rows(system, kinematics.bodies(system, pose)).jacobian
    return now, _refined(
        change,
        _cancelling(system, rows, rows),
        lambda by: jax.jvp(lambda n: _drift(system, pose, wanted, n), (now,), (by,))[1],
    )


def _drift(system: System, pose: Pose, wanted: BodyRows, now: Correction) -> Correction:
    rows = kinematics.rows(system, kinematics.bodies(system, pose)).jacobian
    rate = jnp.sum(rows * _pairs(system, now.xi)[:, None, :], -1)
    return _balance(system, rows, now.xi - wanted, rate, now.push)


def _balance(system: System, here: Array, moved: BodyRows, rows: Array, push: Array) -> Correction:
    pushed = forces.collect(system.topology.joint_sides, jnp.sum(here * push[:, :, None], 1))
    give = jnp.where(system.held_rows, rows + system.compliance * push, push)
    return Correction(instantaneous(system, moved) - pushed, give)


def _cancelling(system: System, here: Array, there: Array) -> Cancel:
    """Of a residual r the solution of M δξ - hereᵀ δμ = -r₁, there δξ + ε δμ = -r₂ over the body graph.

    Rows that are far open are 1e8 times what moves a body, which rounding leaves in error by more than itself: what
    the first answer leaves of r₁ is solved for once more, without them.
    """
    weight = jnp.where(system.held_rows, 1.0 / system.compliance, 0.0)
    others = jnp.zeros((len(system.topology.struts) + len(system.topology.touches), 12, 12))
    mass = system.mass[:, None, None] * jnp.eye(3)
    zero = jnp.zeros_like(mass)
    top, bottom = jnp.concatenate([mass, zero], -1), jnp.concatenate([zero, system.inertia], -1)
    own = jnp.concatenate([top, bottom], -2)
    factored = linear.factor(system.topology, own, here, weight, there, others)

    def pulled(push: Array) -> BodyRows:
        return forces.collect(system.topology.joint_sides, jnp.sum(here * push[:, :, None], 1))

    def given(xi: BodyRows) -> Array:
        return weight * jnp.sum(there * _pairs(system, xi)[:, None, :], -1)

    def cancel(residual: Correction) -> Correction:
        offset = -jnp.where(system.held_rows, weight, 1.0) * residual.push
        xi = linear.solve(factored, pulled(offset) - residual.xi)
        push = offset - given(xi)
        more = linear.solve(factored, pulled(push) - residual.xi - instantaneous(system, xi))
        return Correction(xi + more, push - given(more))

    return cancel


def _refined(change: Correction, cancel: Cancel, slope: Callable[[Correction], Correction]) -> Correction:
    """Answer to a change of the residual, refined twice.

    Rounding leaves the rows open by 1e-7 of the answer, and a step of h seconds turns an opening into a velocity of
    opening / h.
    """

    def refined(_: int, answer: Correction) -> Correction:
        return jax.tree.map(jnp.add, answer, cancel(jax.tree.map(jnp.add, change, slope(answer))))

    return lax.fori_loop(0, 2, refined, cancel(change))


def start(
    system: System,
    reference: Pose,
    motions: Float[np.ndarray, "slots 6 mobility"],
    coordinates: Float[Array, "mobility"],
    rates: Float[Array, "mobility"],
    shift: Float[Array, "slots 3"] | None = None,
) -> Start:
    """A start on the closed mechanism, `coordinates` away from a reference pose along its free motions.

    motions: from `free_motions` at the reference.  shift: of each centre of mass since the reference was found, in body
    axes [m]: parts keep their place when only their centre of mass moves.  A hand's push adds to the rates.
    Differentiable in everything but the reference.
    """
    moved = jnp.einsum("bim,m->bi", motions, coordinates)
    if shift is not None:
        moved = moved.at[:, :3].add(apply(quaternion.rotation(reference.quaternion), shift))
    pose = closed(system, reference, moved)
    ideal = system.centred()
    wanted = jnp.einsum("bim,m->bi", motions, rates)[None]
    if not system.pushes:
        return Start(pose, _along(ideal, pose, wanted[0]).xi)
    each = jnp.concatenate([wanted, jnp.moveaxis(jnp.asarray(motions), -1, 0)])
    velocity, *free = jax.vmap(lambda one: _along(ideal, pose, one).xi)(each)
    return Start(pose, velocity + pushed(system, pose, jnp.stack(free)))


def let_go(system: System, pose: Pose) -> Start:
    """The start from a closed pose: at rest, unless a hand pushes."""
    if not system.pushes:
        return Start(pose, jnp.zeros((system.topology.slots, 6)))
    motions = free_motions(system, pose)
    none = jnp.zeros(motions.shape[-1])
    return eqx.filter_jit(start)(system, pose, motions, none, none)


def free_motions(system: System, pose: Pose) -> Float[np.ndarray, "slots 6 mobility"]:
    """Ways the closed mechanism can move at a pose: one ξ rate each, largest entry 1 (mechanism lengths or rad).

    Loose pins stay in the middle of their holes, links that bend stay straight.  The rank is decided by the largest gap
    in the spectrum of the held rows (numpy, once per start).
    """
    return null_space(system.centred(), pose)


@eqx.filter_jit
def _values(system: System, pose: Pose) -> Float[Array, "joints 6"]:
    return kinematics.rows(system, kinematics.bodies(system, pose)).value


def worst_gap(system: System, pose: Pose) -> Gap:
    """The joint that is furthest from closed at a pose."""
    value = np.where(
        system.held_rows & ~system.coordinate_rows,
        np.asarray(_values(system, pose)),
        0.0,
    )
    if value.size == 0:
        return Gap("", 0.0, 0.0)
    offset, tilt = np.linalg.norm(value[:, :3], axis=-1), np.linalg.norm(value[:, 3:], axis=-1)
    worst = int(np.argmax(offset / system.scale.length_m + tilt))
    return Gap(system.topology.joint_ids[worst], float(offset[worst]), float(tilt[worst]))


def _error(system: System, reference: Pose, now: Correction) -> Float[Array, ""]:
    value = kinematics.rows(system, kinematics.bodies(system, reference.advance(now.xi))).value
    unit = jnp.array([1 / system.scale.length_m] * 3 + [1.0] * 3)
    return jnp.max(jnp.where(system.held_rows, jnp.abs(value) * unit, 0.0), initial=0.0)


def _pairs(system: System, moved: BodyRows) -> Float[Array, "joints 12"]:
    slots = system.topology.slots
    return jnp.concatenate([moved, jnp.zeros((1, 6))])[np.minimum(system.pairs, slots)].reshape(-1, 12)


def _bounded(xi: BodyRows, change: BodyRows) -> BodyRows:
    """At most half a radian in one correction: further the rows' slope says little."""
    largest = jnp.max(jnp.abs(change[:, 3:]), initial=1e-30)
    return xi + change * jnp.minimum(1.0, 0.5 / largest)
