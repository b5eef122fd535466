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
from backend.simulate.contact import Push, Reach
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
SLID = 0.1  # share of the sliding at which friction is half way, that sliding may be off at the default tolerance
PATIENCE = 15
FIRST = 30
STAGES = 20
HAZIEST = 1e4
SOFTEST = 1e8
FALL = 0.1
LOOSE = 1e-6
LARGEST_TURN = 1.0  # rad in one step: beyond it the quaternion step loses its inverse
ENOUGH = 1e-4  # share of the linear fall of the merit that a step must bring
SHORTEST = 0.02  # share of an iteration's change below which no better point is sought
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


class _Walk(NamedTuple):
    """Where Newton's method stands."""

    unknowns: Unknowns
    residual: Unknowns
    rows: kinematics.Rows
    iterations: Array
    error: Array
    merit: Array


class _Stage(NamedTuple):
    """A problem on the way from one that is soft to the one that is asked."""

    walk: _Walk
    softness: Array
    known: Unknowns
    """Solution of the last stage that was solved, and its softness."""
    reached: Array
    fall: Array
    """Factor on the softness from stage to stage."""
    left: Array


def _newton(system: System, given: Frame, guess: Unknowns) -> tuple[Solved, kinematics.Rows]:
    """The solution, and the joints' rows there."""
    def softened(softness: float | Array) -> tuple[Frame, Array]:
        return blurred(given, softness), _barrier(system, given) * jnp.minimum(softness, HAZIEST)

    def looked(softness: float | Array, unknowns: Unknowns, iterations: int | Array) -> _Walk:
        at, barrier = softened(softness)
        residual, rows = equations(system, at, unknowns, barrier)
        error, merit = _size(system, at, unknowns, residual, barrier)
        return _Walk(unknowns, residual, rows, jnp.asarray(iterations), error, merit)

    def walked(
        softness: float | Array, begin: Unknowns, iterations: int | Array, last: int | Array, enough: float | Array
    ) -> _Walk:
        at, barrier = softened(softness)

        def unfinished(now: _Walk) -> Bool[Array, ""]:
            return (now.error > enough) & (now.iterations < last)

        def iterate(now: _Walk) -> _Walk:
            change = direction(system, linearise(system, at, now.unknowns, now.rows), now.residual)

            def tried(share: Array) -> _Walk:
                return looked(softness, _moved(at, now.unknowns, change, share, barrier), now.iterations + 1)

            if not interior:
                return tried(jnp.ones(()))

            def short(carry: tuple[Array, _Walk]) -> Bool[Array, ""]:
                share, then = carry
                return (then.merit > (1.0 - ENOUGH * share) * now.merit) & (share > SHORTEST) & (then.error > enough)

            def shorter(carry: tuple[Array, _Walk]) -> tuple[Array, _Walk]:
                share = 0.5 * carry[0]
                return share, tried(share)

            nowhere = now._replace(merit=jnp.inf * jnp.ones(()), error=jnp.inf * jnp.ones(()))
            return lax.while_loop(short, shorter, (2.0 * jnp.ones(()), nowhere))[1]

        begin = _moved(at, begin, jax.tree.map(jnp.zeros_like, begin), 0.0, barrier)
        return lax.while_loop(unfinished, iterate, looked(softness, begin, iterations))

    interior = bool(system.contacts.count or system.touches.count)
    if not interior:
        end = walked(1.0, guess, 0, MAX_ITERATIONS, system.tolerance)
        return Solved(end.unknowns, end.iterations, end.error), end.rows

    stages = jnp.where(given.drive.reach.lagging, STAGES, 1)

    def stage(now: _Stage) -> _Stage:
        plain = now.softness <= 1.0
        enough = jnp.where(plain, system.tolerance, LOOSE)
        patience = jnp.where(now.left == stages, FIRST, PATIENCE)
        walk = walked(now.softness, now.known, now.walk.iterations, now.walk.iterations + patience, enough)
        solved = walk.error <= enough
        first = plain & (now.left == stages) & ~solved
        known = jax.tree.map(lambda old, new: jnp.where(solved, new, old), now.known, walk.unknowns)
        reached = jnp.where(solved, now.softness, now.reached)
        fall = jnp.where(solved | first, now.fall, jnp.sqrt(now.fall))
        softness = jnp.where(first, SOFTEST, jnp.maximum(reached * fall, 1.0))
        hopeless = ~solved & (now.softness >= SOFTEST)
        left = jnp.where((solved & plain) | hopeless, 0, now.left - 1)
        return _Stage(walk, softness, known, reached, fall, left)

    begin = _Stage(looked(1.0, guess, 0), jnp.ones(()), guess, SOFTEST * jnp.ones(()), FALL * jnp.ones(()), stages)
    end = lax.while_loop(lambda now: now.left > 0, stage, begin).walk
    return Solved(end.unknowns, end.iterations, end.error), end.rows


def blurred(at: Frame, factor: Array) -> Frame:
    reach, meet = at.drive.reach, at.meeting
    drive = at.drive._replace(stick=at.drive.stick * factor, reach=reach._replace(stick=reach.stick * factor))
    meet = meet._replace(stick=meet.stick * factor, reach=meet.reach._replace(stick=meet.reach.stick * factor))
    return at._replace(drive=drive, meeting=meet)


def _moved(at: Frame, unknowns: Unknowns, change: Unknowns, share: float | Array, barrier: Array) -> Unknowns:
    """Unknowns moved by a share of a change, walls along their curve."""
    xi, impulses = unknowns
    by = change.impulses
    walls, touches = impulses.walls, impulses.touches
    if walls.normal.size:
        walls = contact.along_path(at.drive.reach, walls, by.walls, share, barrier)
    if touches.normal.size:
        touches = contact.along_path(at.meeting.reach, touches, by.touches, share, barrier)
    return Unknowns(
        _shortened(xi + share * change.xi),
        Impulses(impulses.rows + share * by.rows, walls, touches, impulses.pads + share * by.pads),
    )


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
    """Keep accelerating as before; walls keep pushing, or stay as far off as the motion would leave them."""
    xi = _shortened(at.step_s * (motion.velocity + at.step_s * motion.acceleration))
    impulses, barrier = motion.impulses, _barrier(system, at)

    def begun(reach: Reach, gap: Array, push: Push) -> Push:
        return contact.on_path(reach, reach.ease * push.normal - jnp.maximum(2 * gap - reach.back, 0.0), push.rub, barrier)

    if system.contacts.count:
        reach = at.drive.reach
        gap = contact.gap(system.contacts, reach.room, reach.here)
        impulses = impulses._replace(walls=begun(reach, gap, impulses.walls))
    if system.touches.count:
        reach = at.meeting.reach
        impulses = impulses._replace(touches=begun(reach, reach.room, impulses.touches))
    return lax.stop_gradient(Unknowns(xi, impulses))


def _barrier(system: System, at: Frame) -> Array:
    """κ is an energy times the step, so that impacts stay inelastic as the step shrinks."""
    return system.barrier * at.step_s


def _size(
    system: System, at: Frame, unknowns: Unknowns, residual: Unknowns, barrier: Array
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Largest residual, and the sum of their squares, as displacements in mechanism lengths."""
    length = system.scale.length_m
    inertia = jnp.trace(system.inertia, axis1=1, axis2=2) / 3
    linear_part = jnp.abs(residual.xi[:, :3]) * (at.step_s / length / system.mass[:, None])
    turning = jnp.abs(residual.xi[:, 3:]) * (at.step_s / length / jnp.sqrt(inertia * system.mass)[:, None])
    row_scale = jnp.array([1 / length] * 3 + [1.0] * 3)
    impulse = at.step_s / (system.scale.mass_kg * length**2)
    held = law.held(system)
    rows = jnp.abs(residual.impulses.rows) * jnp.where(held, row_scale, impulse)
    parts, rubs = [linear_part, turning, rows, jnp.abs(residual.impulses.pads) * impulse * length], []
    now, left = unknowns.impulses, residual.impulses
    groups = [(system.contacts, at.drive.reach, now.walls, left.walls)]
    if system.touches.count:
        groups.append((touch.walls(system), at.meeting.reach, now.touches, left.touches))
    for contacts, reach, push, off in groups:
        parts.append(jnp.abs(off.normal) / length)
        rub = jnp.abs(off.rub) * impulse * length
        slid = TOLERANCE / SLID * contact.slid(contacts, reach, push, off.rub) / reach.stick
        rubs.append((rub, jnp.minimum(rub, slid)))
    largest = jnp.max(jnp.stack([jnp.max(part, initial=0.0) for part in parts + [slid for _, slid in rubs]]))
    return largest, sum(jnp.sum(part * part) for part in parts + [rub for rub, _ in rubs])


def _shortened(xi: BodyRows) -> BodyRows:
    phi = xi[:, 3:]
    size = jnp.sqrt(jnp.sum(phi * phi, -1, keepdims=True) + 1e-30)
    return jnp.concatenate([xi[:, :3], phi * jnp.minimum(1.0, LARGEST_TURN / size)], -1)
