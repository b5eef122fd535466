"""Many steps in a row, from a start to a trajectory."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from backend.model.state import Pose, Start
from backend.model.system import System
from backend.simulate import contact, giving, kinematics, law, meeting, touch
from backend.simulate.contact import Push
from backend.simulate.equations import Motion, refreshed
from backend.simulate.giving import Bounds
from backend.simulate.law import Impulses
from backend.simulate.loop import loop
from backend.simulate.momentum import instantaneous
from backend.simulate.piece import Piece
from backend.simulate.record import Record, accelerated
from backend.simulate.slopes import varied
from backend.simulate.step import SOLUTION, Solved, step

LOST = 1e-6  # error of a step, in mechanism lengths, above which its result is not a motion
PAYMENTS = 4  # times a step is made again because a wall gave back more than it had taken
UNSOLVED = 10.0  # times the tolerance: a step that leaves more is cut in two
# Iterations a step, on average and with some steps to spare, beyond which a motion with an end is given up: two are
# usual, a hundred the hardest that moved; to hold a part that begins behind a rigid wall takes a thousand.
PATIENCE, GRACE = 300, 30


class Trajectory(eqx.Module):
    """A motion at its nodes 0..steps; everything is at the node's own time, to second order."""

    time_s: Float[Array, "nodes"]
    pose: Pose
    velocity: Float[Array, "nodes slots 6"]
    """Centre of mass in W [m/s], turn rate in body axes [rad/s]."""
    q: Float[Array, "nodes joints"]
    rate: Float[Array, "nodes joints"]
    """Of the joints' coordinates [rad/s or m/s]."""
    reaction: Float[Array, "nodes joints 6"]
    """Along the joints' rows: forces [N] and torques [N m] on body B."""
    wall: Float[Array, "nodes walls"]
    """Normal force at the walls inside joints [N; N m at an end of turning]."""
    touch: Float[Array, "nodes places"]
    """Normal force where links touch, five places a pair [N]."""
    iterations: Int[Array, "nodes"]
    error: Float[Array, "nodes"]
    """Residual of the step, in mechanism lengths."""
    lost: Bool[Array, "nodes"]
    """True from the first step that could not be solved: the motion is frozen there."""
    halvings: Int[Array, "nodes"]
    """How often the step was cut in two before it could be solved."""


def depart(system: System, start: Start) -> Motion:
    """The motion that begins at a start: no step led here, so the first one carries half a step's impulses."""
    bodies = kinematics.bodies(system, start.pose)
    rows = kinematics.rows(system, bodies)
    joints, walls, places = len(system.coordinate), system.contacts.count, touch.PLACES * system.touches.count
    rates = all_rates(system, rows.jacobian, start.velocity)
    return Motion(
        pose=start.pose,
        bodies=bodies,
        rows=rows,
        time_s=system.held_s,
        momentum=instantaneous(system, start.velocity),
        before_s=jnp.zeros(()),
        velocity=start.velocity,
        acceleration=jnp.zeros_like(start.velocity),
        q=kinematics.coordinates(system, bodies),
        rate=law.displacement(system, rates),
        quickening=jnp.zeros(joints),
        borne=jnp.zeros(joints),
        opening=_opening(system, rows.value, rates),
        parting=meeting.partings(
            system,
            meeting.meet(
                system, bodies, jnp.zeros(places), jnp.zeros(places), 0.0, jnp.zeros(()), jnp.full(places, jnp.inf)
            ),
            start.velocity,
        ),
        impulses=Impulses(jnp.zeros((joints, 6)), _idle(walls), _idle(places), jnp.zeros((system.pads.count, 2))),
        taken=Bounds(jnp.zeros(walls), jnp.zeros(places)),
    )


def _idle(count: int) -> Push:
    return Push(jnp.zeros(count), jnp.ones(count), jnp.zeros(count))


def _opening(system: System, value: Array, rates: Array) -> Array:
    """Rate of the walls' gaps when the joints' rows change at these rates."""
    contacts = system.contacts
    here = law.at_walls(system, jnp.where(system.coordinate_rows, 0.0, value))
    normal = contact.face(contacts, contacts.room, here, here).outward
    return -jnp.sum(normal * law.at_walls(system, rates)[:, :2], -1)


def all_rates(system: System, jacobian: Float[Array, "joints 6 12"], velocity: Array) -> Float[Array, "joints 6"]:
    """Rates of all rows under a velocity of the bodies."""
    pairs = jnp.concatenate([velocity, jnp.zeros_like(system.fixed_position).repeat(2, 1)])[system.pairs]
    return jnp.sum(jacobian * pairs.reshape(-1, 1, 12), -1)


class Seen(NamedTuple):
    """What is known of a node once the step from it is done; see Trajectory."""

    pose: Pose
    velocity: Float[Array, "steps slots 6"]
    q: Float[Array, "steps joints"]
    rate: Float[Array, "steps joints"]
    reaction: Float[Array, "steps joints 6"]
    wall: Float[Array, "steps walls"]
    touch: Float[Array, "steps places"]
    iterations: Int[Array, "steps"]
    error: Float[Array, "steps"]
    lost: Bool[Array, "steps"]
    halvings: Int[Array, "steps"]


def rollout(
    system: System,
    start: Start,
    step_s: float | Array,
    steps: int,
    record: Record | None = None,
    halvings: int = 0,
    until: Int[Array, ""] | None = None,
    patience: int = PATIENCE,
) -> Trajectory:
    """Move for `steps` steps of `step_s` seconds.

    record: known drives, sampled on the steps (see `record.on_steps`).  until: a node after which nobody looks: the
    motion ends there, or where it is lost; the nodes behind repeat the last, and no time is spent on them (forward
    derivatives only). A motion that takes more than `patience` iterations a step is then given up as lost, too.
    A step that cannot be solved is cut in two, up to `halvings` times (0 where derivatives backwards in time are
    wanted); after that the motion freezes and `lost` is set from there on, so that one jammed sample never spoils a
    batch.
    """
    # One step more than asked: a node's velocity needs the step that follows it.
    carry = (depart(system, start), jnp.zeros((), dtype=bool))
    _, seen = march(system, carry, step_s, steps + 1, record, halvings, until, patience)
    return trajectory(seen, step_s)


# Backwards in time, each step is set up again from its solution: less memory than keeping its slopes, and faster.
_frugal_step = jax.checkpoint(step, policy=jax.checkpoint_policies.save_only_these_names(SOLUTION))


def march(
    system: System,
    carry: tuple[Motion, Array],
    step_s: float | Array,
    steps: int,
    record: Record | None,
    halvings: int = 0,
    until: Int[Array, ""] | None = None,
    patience: int = PATIENCE,
) -> tuple[tuple[Motion, Array], Seen]:
    """Some steps from where a motion stands; the carry is the motion and whether it is lost. until, patience: see
    `rollout`.
    """
    by = system, carry[0], step_s, record
    carry = _moving(carry[0], step_s, by), carry[1]
    drives = None if record is None else record.values
    if until is None:

        def advance(carry: tuple[Motion, Array], drives: Array | None) -> tuple[tuple[Motion, Array], Seen]:
            return _advanced(_frugal_step, system, carry, step_s, record, drives, halvings)

        return lax.scan(advance, carry, drives, length=steps)

    def wanted(given: tuple, now: tuple[Array, Array, tuple[Motion, Array], Seen]) -> Array:
        return (now[0] < given[-1]) & ~now[2][1]

    def onward(given: tuple, now: tuple[Array, Array, tuple[Motion, Array], Seen]) -> tuple:
        (system, step_s, record, _), (k, spent, carry, every) = given, now
        drives = None if record is None else record.values[k]
        (motion, gone), seen = _advanced(step, system, carry, step_s, record, drives, halvings)
        spent = spent + seen.iterations
        gone = gone | (spent > patience * (k + GRACE))
        every = jax.tree.map(lambda all_, one: all_.at[k].set(one), every, seen._replace(lost=gone))
        return k + 1, spent, (motion, gone), every

    room = jax.tree.map(lambda one: jnp.zeros((steps, *one.shape), one.dtype), _unseen(system, carry[0]))
    room = _looked_at(room, by)
    given = system, step_s, record, jnp.minimum(until + 1, steps)
    none = jnp.zeros((), dtype=int)
    taken, _, carry, seen = loop(wanted, onward, given, (none, none, carry, room))
    # What is lost stays lost: the last node, behind which no time is spent, says so for all that follow.
    behind = jnp.minimum(jnp.arange(steps), taken - 1)
    return carry, jax.tree.map(lambda all_: all_[behind], seen)


def _advanced(
    stepped: Callable[..., tuple[Motion, Solved, Bounds]],
    system: System,
    carry: tuple[Motion, Array],
    step_s: float | Array,
    record: Record | None,
    drives: Array | None,
    halvings: int,
) -> tuple[tuple[Motion, Array], Seen]:
    """One step of a march.  stepped: `step`, or what keeps less of it where slopes are taken backwards."""
    motion, lost = carry
    acting = shaken(system, motion.time_s)
    acting = acting if record is None or drives is None else record.apply(acting, drives)
    if halvings:
        after, gone, seen = _cut_step(acting, motion, lost, step_s, halvings)
    else:
        after, solved, _ = stepped(acting, motion, step_s, _targets(acting), _unbounded(acting))
        gone = lost | _failed(solved, LOST)
        seen = _node(system, motion, after, solved, step_s, gone)
    kept = jax.tree.map(lambda old, new: jnp.where(gone, old, new), motion, after)
    return (kept, gone), seen._replace(lost=gone)


def _moving(motion: Motion, step_s: float | Array, by: Any) -> Motion:
    """The same motion, where all that the steps give slopes to has one from the beginning, if anything of `by` has."""

    def begun(m: Motion) -> tuple:
        return (
            m.pose,
            m.momentum,
            m.velocity,
            m.acceleration,
            m.rate,
            m.quickening,
            m.borne,
            m.opening,
            m.parting,
            m.taken,
        )

    def timed(m: Motion) -> tuple:
        return m.time_s, m.before_s

    motion = eqx.tree_at(timed, motion, varied(timed(motion), jnp.asarray(step_s)))
    return eqx.tree_at(begun, motion, varied(begun(motion), by))


def _unseen(system: System, motion: Motion) -> Seen:
    """A node of which nothing is known yet."""
    joints, walls, places = len(system.coordinate), system.contacts.count, touch.PLACES * system.touches.count
    none, count = jnp.zeros(()), jnp.zeros((), dtype=int)
    still, rows = jnp.zeros_like(motion.velocity), jnp.zeros((joints, 6))
    loads = jnp.zeros(walls), jnp.zeros(places)
    return Seen(
        motion.pose, still, motion.q, jnp.zeros(joints), rows, *loads, count, none, jnp.zeros((), dtype=bool), count
    )


def _looked_at(node: Seen, by: Any) -> Seen:
    """The same, with slopes where `_node` gives some, if anything of `by` has one."""
    moving = node.pose, node.velocity, node.q, node.rate, node.reaction, node.wall, node.touch
    return Seen(*varied(moving, by), *node[len(moving) :])


def shaken(system: System, time_s: Array) -> System:
    """The system in the frame of a base that shakes: weight takes the base's acceleration off."""
    if not system.bases:
        return system
    acceleration = sum((base.acceleration(time_s) for placed in system.bases for base in placed.each()), jnp.zeros(3))
    return accelerated(system, acceleration)


class _Attempt(NamedTuple):
    motion: Motion
    done: Array
    """Share of the step that is behind."""
    cuts: Array
    gone: Array
    node: Seen
    most: Bounds
    """Gaps that walls may ask for in the step to come."""
    payments: Array
    """How often that was bounded anew."""


def _cut_step(
    system: System, motion: Motion, lost: Array, step_s: float | Array, halvings: int
) -> tuple[Motion, Array, Seen]:
    """One step, in as many pieces as Newton's method needs, and such that no wall gives back more than it took."""

    def unfinished(given: tuple, now: _Attempt) -> Array:
        return (now.done < 1.0) & ~now.gone

    def attempt(given: tuple, now: _Attempt) -> _Attempt:
        system, step_s, begun, target, unbounded = given
        piece = Piece(now.cuts)
        share = piece.share
        along = begun + (now.done + share) * (target - begun)
        after, solved, asked = step(system, now.motion, share * step_s, along, now.most, piece)
        last = now.cuts == halvings
        failed = _failed(solved, jnp.where(last, LOST, UNSOLVED * system.tolerance))
        node = _node(system, now.motion, after, solved, share * step_s, now.gone)
        overdrawn = ~failed & asked.any_finite() & (now.payments < PAYMENTS)
        again = failed | overdrawn
        first = ~again & (now.done == 0.0)
        node = jax.tree.map(lambda old, new: jnp.where(first, new, old), now.node, node)
        node = node._replace(
            iterations=now.node.iterations + solved.iterations,
            error=jnp.where(again & ~last, now.node.error, jnp.fmax(now.node.error, solved.error)),
            halvings=jnp.maximum(now.node.halvings, now.cuts),
        )
        return _Attempt(
            jax.tree.map(lambda old, new: jnp.where(again, old, new), now.motion, after),
            jnp.where(again, now.done, now.done + share),
            jnp.where(failed & ~last, now.cuts + 1, now.cuts),
            failed & last,
            node,
            jax.tree.map(lambda less, all_: jnp.where(overdrawn, less, all_), now.most.least(asked), unbounded),
            jnp.where(overdrawn, now.payments + 1, 0),
        )

    none, count = jnp.zeros(()), jnp.zeros((), dtype=int)
    by = system, motion.pose
    node = _looked_at(_unseen(system, motion), by)
    unbounded = _unbounded(system)
    begin = _Attempt(motion, none, count, lost, node, varied(unbounded, by), count)
    end = loop(unfinished, attempt, (system, step_s, motion.q, _targets(system), unbounded), begin)
    return end.motion, end.gone, end.node


def _unbounded(system: System) -> Bounds:
    return giving.none(system.contacts.count, touch.PLACES * system.touches.count)


def _failed(solved: Solved, bound: float | Array) -> Array:
    """The comparison is written so that a NaN counts as failed."""
    return ~(solved.error < bound)


def _node(system: System, motion: Motion, after: Motion, solved: Solved, step_s: float | Array, lost: Array) -> Seen:
    """What stands at q_k: velocities of the steps before and after it, weighed by the time to their middles."""
    motion = refreshed(system, motion)
    before, weight = motion.before_s, 0.5 * (motion.before_s + step_s)

    def between(arriving: Array, leaving: Array) -> Array:
        return (step_s * arriving + before * leaving) / (before + step_s)

    return Seen(
        pose=motion.pose,
        velocity=between(motion.velocity, after.velocity),
        q=motion.q,
        rate=between(motion.rate, after.rate),
        reaction=solved.unknowns.impulses.rows / weight,
        wall=solved.unknowns.impulses.walls.normal / weight,
        touch=solved.unknowns.impulses.touches.normal / weight,
        iterations=solved.iterations,
        error=solved.error,
        lost=lost,
        halvings=jnp.zeros((), dtype=int),
    )


def trajectory(seen: Seen, step_s: float | Array) -> Trajectory:
    """The nodes of a motion."""
    return Trajectory(time_s=step_s * jnp.arange(seen.q.shape[0]), **seen._asdict())


def _targets(system: System) -> Float[Array, "joints"]:
    """q that driven joints must reach at the end of a step."""
    total = jnp.zeros(len(system.coordinate))
    for group in system.motions:
        total = total + group.summed(total.shape[0], jax.vmap(lambda e: e.target())(group.here))
    return total
