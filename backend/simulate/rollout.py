"""Many steps in a row, from a start to a trajectory."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from backend.model.state import Pose, Start
from backend.model.system import System
from backend.simulate import forces, kinematics
from backend.simulate.equations import Motion, lengthening
from backend.simulate.law import Impulses
from backend.simulate.momentum import instantaneous
from backend.simulate.record import Record
from backend.simulate.step import SOLUTION, step

LOST = 1e-6  # error of a step, in mechanism lengths, above which its result is not a motion


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
    iterations: Int[Array, "nodes"]
    error: Float[Array, "nodes"]
    """Residual of the step, in mechanism lengths."""
    lost: Bool[Array, "nodes"]
    """True from the first step that could not be solved: the motion is frozen there."""


def depart(system: System, start: Start, step_s: float | Array) -> Motion:
    """The motion that begins at a start: half a step's impulses are taken back, for no step led here."""
    bodies = kinematics.bodies(system, start.pose)
    jacobian = kinematics.rows(system, bodies).jacobian
    joints = len(system.coordinate)
    q = kinematics.coordinates(system, bodies)
    xi = step_s * start.velocity
    moved = joint_rates(system, jacobian, xi)
    _, strut_slope = forces.strut_lines(system, bodies)
    lengthened = lengthening(system, strut_slope, xi)
    efforts = forces.joint_efforts(system, q) - _resistance(system, moved / step_s)
    rows = jnp.where(system.coordinate_rows, efforts[:, None], 0.0)
    acting = forces.body_forces(system, bodies, start.velocity) + forces.drag(system, bodies, start.velocity)
    acting = acting + forces.collect(system.topology.joint_sides, jnp.sum(jacobian * rows[:, :, None], 1))
    damping = -system.strut_damping * lengthened / step_s
    if system.topology.struts:
        acting = acting + forces.collect(system.topology.strut_sides, damping[:, None] * strut_slope)
    stops = len(system.stops)
    return Motion(
        pose=start.pose,
        momentum=instantaneous(system, start.velocity) - 0.5 * step_s * acting,
        xi=xi,
        xi_guess=xi,
        q=q,
        displacement=moved,
        lengthening=lengthened,
        impulses=Impulses(jnp.zeros((joints, 6)), jnp.zeros((stops, 2)), jnp.ones((stops, 2))),
    )


def joint_rates(system: System, jacobian: Float[Array, "joints 6 12"], velocity: Array) -> Float[Array, "joints"]:
    """Rate of every coordinate under a velocity (or displacement under an increment) of the bodies."""
    along = jnp.sum(jnp.where(system.coordinate_rows[:, :, None], jacobian, 0.0), 1)
    pairs = jnp.concatenate([velocity, jnp.zeros_like(system.fixed_position).repeat(2, 1)])[system.pairs]
    return jnp.sum(along * pairs.reshape(-1, 12), -1)


def _resistance(system: System, rate: Float[Array, "joints"]) -> Float[Array, "joints"]:
    """Damping and dry friction (without its load, which only the first step knows) at a rate."""
    return system.damping * rate + system.dry_limit * rate / jnp.sqrt(rate**2 + system.stick_rate**2)


class Seen(NamedTuple):
    """What each step leaves behind: the pose it left from, and what it did."""

    pose: Pose
    xi: Float[Array, "steps slots 6"]
    displacement: Float[Array, "steps joints"]
    q: Float[Array, "steps joints"]
    rows: Float[Array, "steps joints 6"]
    iterations: Int[Array, "steps"]
    error: Float[Array, "steps"]
    lost: Bool[Array, "steps"]


def rollout(
    system: System, start: Start, step_s: float | Array, steps: int, record: Record | None = None
) -> Trajectory:
    """Move for `steps` steps of `step_s` seconds.

    record: known drives, sampled on the steps (see `record.on_steps`).  A step that cannot be solved freezes the
    motion and sets `lost` from there on, so that one jammed sample never spoils a batch.
    """
    # One step more than asked: a node's velocity needs the step that follows it.
    carry = (depart(system, start, step_s), jnp.zeros((), dtype=bool))
    _, seen = march(system, carry, step_s, steps + 1, record)
    return trajectory(seen, start, carry[0].displacement, step_s)


# Backwards in time, each step is set up again from its solution: less memory than keeping its slopes, and faster.
_frugal_step = jax.checkpoint(step, policy=jax.checkpoint_policies.save_only_these_names(SOLUTION))


def march(
    system: System, carry: tuple[Motion, Array], step_s: float | Array, steps: int, record: Record | None
) -> tuple[tuple[Motion, Array], Seen]:
    """Some steps from where a motion stands; the carry is the motion and whether it is lost."""

    def advance(carry: tuple[Motion, Array], drives: Array | None) -> tuple[tuple[Motion, Array], Seen]:
        motion, lost = carry
        acting = system if record is None or drives is None else record.apply(system, drives)
        after, solved = _frugal_step(acting, motion, step_s, _targets(acting))
        # The comparison is written so that a NaN counts as lost.
        lost = lost | ~(solved.error < LOST)
        kept = jax.tree.map(lambda old, new: jnp.where(lost, old, new), motion, after)
        rows = solved.unknowns.impulses.rows
        seen = Seen(motion.pose, kept.xi, kept.displacement, motion.q, rows, solved.iterations, solved.error, lost)
        return (kept, lost), seen

    return lax.scan(advance, carry, None if record is None else record.values, length=steps)


def trajectory(seen: Seen, start: Start, displacement: Float[Array, "joints"], step_s: float | Array) -> Trajectory:
    """Nodes of a motion from its steps, one fewer; displacement: of the coordinates, in a step before the start."""
    nodes = seen.q.shape[0]
    return Trajectory(
        time_s=step_s * jnp.arange(nodes),
        pose=seen.pose,
        velocity=_at_nodes(seen.xi, start.velocity, step_s),
        q=seen.q,
        rate=_at_nodes(seen.displacement, displacement / step_s, step_s),
        reaction=(seen.rows / step_s).at[0].multiply(2.0),  # the first step carries half a step's impulses
        iterations=seen.iterations,
        error=seen.error,
        lost=seen.lost,
    )


def _at_nodes(increments: Array, first: Array, step_s: float | Array) -> Array:
    """Central differences of increments, and the known value at the start."""
    return jnp.concatenate([first[None], (increments[:-1] + increments[1:]) / (2 * step_s)])


def _targets(system: System) -> Float[Array, "joints"]:
    """q that driven joints must reach at the end of a step."""
    total = jnp.zeros(len(system.coordinate))
    for group in system.motions:
        total = total + group.summed(total.shape[0], jax.vmap(lambda e: e.target())(group.here))
    return total
