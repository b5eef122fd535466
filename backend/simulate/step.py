"""One time step: predict, then close the joints by Newton's method, differentiable through its solution."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jax.ad_checkpoint import checkpoint_name
from jaxtyping import Array, Bool, Float, Int

from backend.model.system import System
from backend.simulate import kinematics, law
from backend.simulate.equations import (
    Frame,
    Motion,
    Unknowns,
    ahead,
    direction,
    equations,
    frame,
    lengthening,
    linearise,
)
from backend.simulate.law import Impulses
from backend.simulate.momentum import BodyRows, momentum

MAX_ITERATIONS = 40
LARGEST_TURN = 1.0  # rad in one step: beyond it the quaternion step loses its inverse
TO_BOUNDARY = 0.99  # fraction of the way to γ = 0 or s = 0 that an iteration may go
BARRIER_FALL = 0.1
BARRIER_START = 1e3  # times the final barrier
SOLUTION = "solution of a step"  # all that a derivative backwards in time keeps of it


class Solved(NamedTuple):
    """A step's unknowns, and how Newton's method fared."""

    unknowns: Unknowns
    iterations: Int[Array, ""]
    error: Float[Array, ""]


@jax.custom_jvp
def close(system: System, at: Frame, guess: Unknowns) -> Solved:
    """Solve the step's equations by Newton's method."""
    return _newton(system, at, guess)[0]


def _newton(system: System, at: Frame, guess: Unknowns) -> tuple[Solved, kinematics.Rows]:
    """The solution, and the joints' rows there."""
    barrier = _barrier(system, at)
    interior = bool(system.stops)

    def unfinished(carry: tuple) -> Bool[Array, ""]:
        _, _, _, iterations, error, _ = carry
        return (error > system.tolerance) & (iterations < MAX_ITERATIONS)

    def iterate(carry: tuple) -> tuple:
        unknowns, residual, rows, iterations, _, aim = carry
        if interior:
            gap = unknowns.impulses.stop * unknowns.impulses.slack
            aim = jnp.maximum(barrier, BARRIER_FALL * jnp.minimum(jnp.max(gap), aim))
            centred = residual.impulses._replace(slack=gap - aim)
            residual = residual._replace(impulses=centred)
        change = direction(system, linearise(system, at, unknowns, rows), residual)
        fraction = _fraction(unknowns.impulses, change.impulses) if interior else 1.0
        unknowns = jax.tree.map(lambda z, dz: z + fraction * dz, unknowns, change)
        unknowns = unknowns._replace(xi=_shortened(unknowns.xi))
        residual, rows = equations(system, at, unknowns, barrier)
        return unknowns, residual, rows, iterations + 1, _size(system, at, residual, barrier), aim

    residual, rows = equations(system, at, guess, barrier)
    start = (guess, residual, rows, 0, _size(system, at, residual, barrier), BARRIER_START * barrier)
    unknowns, _, rows, iterations, error, _ = lax.while_loop(unfinished, iterate, start)
    return Solved(unknowns, jnp.asarray(iterations), error), rows


@close.defjvp
def _close_jvp(primals: tuple, tangents: tuple) -> tuple[Solved, Solved]:
    """Implicit function theorem: the residual's change, sent back through the factored slope."""
    system, at, guess = primals
    solved, rows = checkpoint_name(_newton(system, at, guess), SOLUTION)
    unknowns = solved.unknowns

    # The guess's own tangent is the first answer, so that only its small remainder goes through the stiff rows (1/ε):
    # the whole would leave rounding of 1e-9 in ξ, which is 1e-6 in the velocity it stands for.
    first = Unknowns(tangents[2].xi, jax.tree.map(jnp.zeros_like, unknowns.impulses))

    def moving(system: System, at: Frame, unknowns: Unknowns) -> Unknowns:
        return equations(system, at, unknowns, _barrier(system, at))[0]

    _, change = jax.jvp(moving, (system, at, unknowns), (*tangents[:2], first))
    linearised = linearise(system, at, unknowns, rows)
    answer = jax.tree.map(jnp.add, first, direction(system, linearised, change))
    none = jnp.zeros((), dtype=jax.dtypes.float0)
    return solved, Solved(answer, none, jnp.zeros_like(solved.error))


def step(
    system: System, motion: Motion, step_s: float | Array, target: Float[Array, "joints"]
) -> tuple[Motion, Solved]:
    """Advance one time step: move freely, close the joints, respect friction and stops."""
    at = frame(system, motion, step_s, target)
    solved = close(system, at, _guess(system, at, motion))
    xi, impulses = solved.unknowns
    pose = at.pose.advance(xi)
    placed = kinematics.bodies(system, pose)
    q = kinematics.unwrap(system, kinematics.coordinates(system, placed), motion.q)
    moved = law.displacement(system, ahead(system, at, xi).value)
    after = Motion(
        pose=pose,
        momentum=momentum(system, xi, step_s, -1.0),
        xi=xi,
        xi_guess=2 * xi - motion.xi,
        q=q,
        displacement=moved,
        lengthening=lengthening(system, at.strut_slope, xi),
        impulses=jax.tree.map(lax.stop_gradient, impulses),
    )
    return after, solved


def _guess(system: System, at: Frame, motion: Motion) -> Unknowns:
    """Keep accelerating as before; stops start a little open."""
    xi = _shortened(motion.xi_guess)
    stop, slack = motion.impulses.stop, motion.impulses.slack
    if system.stops:
        open_by = 1e-3 * jnp.ones_like(slack)
        slack = jnp.maximum(slack, open_by)
        stop = jnp.maximum(stop, _barrier(system, at) / slack)
    return Unknowns(xi, lax.stop_gradient(Impulses(motion.impulses.rows, stop, slack)))


def _barrier(system: System, at: Frame) -> Array:
    """κ is an energy times the step, so that impacts stay inelastic as the step shrinks."""
    return system.barrier * at.step_s


def _size(system: System, at: Frame, residual: Unknowns, barrier: Array) -> Float[Array, ""]:
    """Largest residual as a displacement in mechanism lengths."""
    length = system.scale.length_m
    inertia = jnp.trace(system.inertia, axis1=1, axis2=2) / 3
    linear_part = jnp.abs(residual.xi[:, :3]) * (at.step_s / length / system.mass[:, None])
    turning = jnp.abs(residual.xi[:, 3:]) * (at.step_s / length / jnp.sqrt(inertia * system.mass)[:, None])
    row_scale = jnp.array([1 / length] * 3 + [1.0] * 3)
    impulse = at.step_s / (system.scale.mass_kg * length**2)
    held = law.held(system)
    rows = jnp.abs(residual.impulses.rows) * jnp.where(held, row_scale, impulse)
    parts = [linear_part, turning, rows]
    if system.stops:
        parts += [
            jnp.abs(residual.impulses.stop),
            system.tolerance * jnp.abs(residual.impulses.slack) / (1e-3 * barrier),
        ]
    return jnp.max(jnp.stack([jnp.max(part, initial=0.0) for part in parts]))


def _fraction(now: Impulses, change: Impulses) -> Float[Array, ""]:
    """Largest step that keeps γ and s inside, at most a whole one."""

    def room(value: Array, by: Array) -> Array:
        return jnp.min(jnp.where(by < 0, -value / jnp.where(by < 0, by, -1.0), jnp.inf))

    return jnp.minimum(1.0, TO_BOUNDARY * jnp.minimum(room(now.stop, change.stop), room(now.slack, change.slack)))


def _shortened(xi: BodyRows) -> BodyRows:
    phi = xi[:, 3:]
    size = jnp.sqrt(jnp.sum(phi * phi, -1, keepdims=True) + 1e-30)
    return jnp.concatenate([xi[:, :3], phi * jnp.minimum(1.0, LARGEST_TURN / size)], -1)
