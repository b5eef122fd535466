"""One time step: predict, then close the joints by Newton's method, differentiable through its solution."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.ad_checkpoint import checkpoint_name
from jaxtyping import Array, Bool, Float, Int

from backend.model.system import TOLERANCE, System
from backend.simulate import contact, kinematics, law, meeting, touch
from backend.simulate.contact import Push
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

MAX_ITERATIONS = 45
OFF_PATH = 0.3  # share of the barrier that a wall's γ s may be off at the default tolerance: of forces that are nothing
SLID = 0.1  # share of the sliding at which friction is half way, that sliding may be off at the default tolerance
RESTART = 20  # iterations after which walls are opened and Newton's method begins again
LARGEST_TURN = 1.0  # rad in one step: beyond it the quaternion step loses its inverse
TO_BOUNDARY = 0.999  # fraction of the way to γ = 0 or s = 0 that an iteration may go
BARRIER_FALL = 0.1  # share of the walls' mean γ s that an iteration aims at, at best
WARMTH = 10.0  # times the barrier that a wall's γ s starts with if it pushed before
OPEN_HOLE, OPEN_STOP = 1e-2, 1e-3  # slack that walls start with: share of the room, and rad or m
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
    interior = bool(system.contacts.count or system.touches.count)
    cold = _opened(system, at, guess, jnp.inf) if interior else guess

    def unfinished(carry: tuple) -> Bool[Array, ""]:
        _, _, _, iterations, error, _ = carry
        return (error > system.tolerance) & (iterations < MAX_ITERATIONS)

    def iterate(carry: tuple) -> tuple:
        unknowns, residual, rows, iterations, _, fraction = carry
        if interior:
            residual = residual._replace(impulses=_centred(unknowns.impulses, residual.impulses, fraction, barrier))
        change = direction(system, linearise(system, at, unknowns, rows), residual)
        fraction = _fraction(unknowns.impulses, change.impulses) if interior else fraction
        unknowns = jax.tree.map(lambda z, dz: z + fraction * dz, unknowns, change)
        unknowns = unknowns._replace(xi=_shortened(unknowns.xi))
        if interior:
            again = iterations + 1 == RESTART
            unknowns = jax.tree.map(lambda z, fresh: jnp.where(again, fresh, z), unknowns, cold)
            fraction = jnp.where(again, 1.0, fraction)
        residual, rows = equations(system, at, unknowns, barrier)
        return unknowns, residual, rows, iterations + 1, _size(system, at, unknowns, residual, barrier), fraction

    residual, rows = equations(system, at, guess, barrier)
    start = (guess, residual, rows, 0, _size(system, at, guess, residual, barrier), jnp.ones(()))
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
    system: System,
    motion: Motion,
    step_s: float | Array,
    target: Float[Array, "joints"],
    blur: float | Array = 1.0,
) -> tuple[Motion, Solved]:
    """Advance one time step: move freely, close the joints, respect friction and walls.

    blur: factor on the rate below which friction holds.
    """
    at = frame(system, motion, step_s, target, blur)
    solved = close(system, at, _guess(system, at, motion))
    xi, impulses = solved.unknowns
    pose = at.pose.advance(xi)
    placed = kinematics.bodies(system, pose)
    q = kinematics.unwrap(system, kinematics.coordinates(system, placed), motion.q)
    there = ahead(system, at, xi).value
    velocity = xi / step_s
    after = Motion(
        pose=pose,
        momentum=momentum(system, xi, step_s, -1.0),
        before_s=jnp.asarray(step_s),
        velocity=velocity,
        acceleration=(velocity - motion.velocity) / at.weight_s,
        q=q,
        rate=law.displacement(system, there) / step_s,
        lengthening=lengthening(system, at.strut_slope, xi) / step_s,
        opening=_opening(system, at, there),
        parting=meeting.partings(system, at.meeting, velocity),
        impulses=jax.tree.map(lax.stop_gradient, impulses),
    )
    return after, solved


def _opening(system: System, at: Frame, there: Float[Array, "joints 6"]) -> Float[Array, "walls"]:
    """Rate of the gaps at the walls."""
    reach = at.drive.reach
    gaps = [contact.gap(system.contacts, reach.room, eta) for eta in (law.at_walls(system, there), reach.here)]
    return (gaps[0] - gaps[1]) / at.step_s


def _guess(system: System, at: Frame, motion: Motion) -> Unknowns:
    """Keep accelerating as before; walls that pushed begin almost closed."""
    xi = _shortened(at.step_s * (motion.velocity + at.step_s * motion.acceleration))
    guess = Unknowns(xi, motion.impulses)
    return lax.stop_gradient(_opened(system, at, guess, WARMTH))


def _opened(system: System, at: Frame, guess: Unknowns, warmth: float) -> Unknowns:
    """Walls as far open as the motion would leave them, or a little; at most `warmth` times the barrier off."""
    barrier, impulses = _barrier(system, at), guess.impulses

    def opened(gap: Array, back: Array, least: Array, push: Push) -> Push:
        if warmth < np.inf:
            least = jnp.minimum(least, warmth * barrier / jnp.maximum(push.normal, 1e-300))
        slack = jnp.maximum(2 * gap - back, least)
        return Push(jnp.maximum(push.normal, barrier / slack), slack, push.rub)

    if system.contacts.count:
        reach = at.drive.reach
        gap = contact.gap(system.contacts, reach.room, reach.here)
        ends = np.array(system.contacts.travels, dtype=bool)
        least = jnp.where(ends, OPEN_STOP, OPEN_HOLE * reach.room)
        impulses = impulses._replace(walls=opened(gap, reach.back, least, impulses.walls))
    if system.touches.count:
        reach = at.meeting.reach
        least = OPEN_STOP * system.scale.length_m * jnp.ones_like(reach.room)
        impulses = impulses._replace(touches=opened(reach.room, reach.back, least, impulses.touches))
    return guess._replace(impulses=impulses)


def _barrier(system: System, at: Frame) -> Array:
    """κ is an energy times the step, so that impacts stay inelastic as the step shrinks."""
    return system.barrier * at.step_s


def _size(system: System, at: Frame, unknowns: Unknowns, residual: Unknowns, barrier: Array) -> Float[Array, ""]:
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
    now, left = unknowns.impulses, residual.impulses
    groups = [(system.contacts, at.drive.reach, now.walls, left.walls)]
    if system.touches.count:
        groups.append((touch.walls(system), at.meeting.reach, now.touches, left.touches))
    for contacts, reach, push, off in groups:
        rub = jnp.abs(off.rub) * impulse * length
        slid = TOLERANCE / SLID * contact.slid(contacts, reach, push, off.rub) / reach.stick
        parts += [
            jnp.abs(off.normal) / length,
            TOLERANCE / OFF_PATH * jnp.abs(off.slack) / barrier,
            jnp.minimum(rub, slid),
        ]
    parts.append(jnp.abs(residual.impulses.pads) * impulse * length)
    return jnp.max(jnp.stack([jnp.max(part, initial=0.0) for part in parts]))


def _centring(fraction: Array) -> Array:
    """Share of the walls' mean product to aim at: bold where the iteration before went all the way."""
    return jnp.clip(1.0 - fraction, BARRIER_FALL, 1.0)


def _centred(now: Impulses, residual: Impulses, fraction: Array, barrier: Array) -> Impulses:
    """Residuals that aim at a common product γ s on the way to the barrier, at all walls and places."""
    products = [push.normal * push.slack for push in (now.walls, now.touches)]
    aim = jnp.maximum(barrier, _centring(fraction) * jnp.mean(jnp.concatenate(products)))
    walls, touches = products
    return residual._replace(
        walls=residual.walls._replace(slack=walls - aim), touches=residual.touches._replace(slack=touches - aim)
    )


def _fraction(now: Impulses, change: Impulses) -> Float[Array, ""]:
    """Largest step that keeps γ and s inside, at most a whole one."""

    def room(value: Array, by: Array) -> Array:
        return jnp.min(jnp.where(by < 0, -value / jnp.where(by < 0, by, -1.0), jnp.inf), initial=jnp.inf)

    pairs = [(now.walls, change.walls), (now.touches, change.touches)]
    rooms = [room(a, b) for one, by in pairs for a, b in ((one.normal, by.normal), (one.slack, by.slack))]
    nearest = jnp.min(jnp.stack(rooms))

    return jnp.minimum(1.0, TO_BOUNDARY * nearest)


def _shortened(xi: BodyRows) -> BodyRows:
    phi = xi[:, 3:]
    size = jnp.sqrt(jnp.sum(phi * phi, -1, keepdims=True) + 1e-30)
    return jnp.concatenate([xi[:, :3], phi * jnp.minimum(1.0, LARGEST_TURN / size)], -1)
