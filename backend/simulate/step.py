"""One time step: predict, then close the joints by Newton's method, differentiable through its solution."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.ad_checkpoint import checkpoint_name
from jaxtyping import Array, Bool, Float, Int

from backend.model.system import TOLERANCE, System
from backend.simulate import contact, giving, kinematics, law, meeting, rubbing, touch
from backend.simulate.contact import Push, Reach
from backend.simulate.equations import (
    Frame,
    Motion,
    There,
    Unknowns,
    ahead,
    direction,
    equations,
    frame,
    linearise,
    refreshed,
    softened,
)
from backend.simulate.giving import Bounds
from backend.simulate.law import Impulses
from backend.simulate.momentum import BodyRows, momentum
from backend.simulate.piece import WHOLE, Piece
from backend.simulate.slopes import along

MAX_ITERATIONS = 30  # of a step as it is asked
PATIENCE = 15  # iterations of each softer problem
STAGES = 20  # problems between a soft one and the one that is asked, at most
SOFTEST = 1e8  # factor on the rate below which friction holds: all friction is then a faint damping
HAZIEST = 1e4  # factor on the barrier of soft problems, at most
FALL = 0.1  # of the softness from stage to stage; its root where that was too bold
STILL = 1e-15  # error, in mechanism lengths, of a guess that needs no iteration: rounding, as at rest
LOOSE = 1e-6  # error, in mechanism lengths, that a stage may leave to the next
ENOUGH = 1e-4  # share of the linear fall of the merit that an iteration must bring
SHORTEST = 0.02  # share of an iteration's change below which no better point is sought
SLID = 0.1  # share of the sliding at which friction is half way, that sliding may be off at the default tolerance
ROUNDING = 1e-15  # of places and turns: strong friction that holds answers to it with more than the tolerance
LARGEST_TURN = 1.0  # rad in one step: beyond it the quaternion step loses its inverse
SOLUTION = "solution of a step"  # all that a derivative backwards in time keeps of it


class Solved(NamedTuple):
    """A step's unknowns, and how Newton's method fared."""

    unknowns: Unknowns
    there: There
    """Of it `moved` alone has slopes; the rest follows from the pose, see `refreshed`."""
    iterations: Int[Array, ""]
    error: Float[Array, ""]


@jax.custom_jvp
def close(system: System, at: Frame, guess: Unknowns) -> Solved:
    """Solve the step's equations by Newton's method.

    Walls are followed along the curve s γ = κ, where no iterate ever turns negative, and an iteration is shortened
    until it brings the residuals down.  Where that is not enough and friction lags (`Reach.lagging`), the way leads
    from a problem with soft friction and a wide barrier, stage by stage, to the one that is asked.
    """
    if not (system.contacts.count or system.touches.count):
        return _walk(system, at, 1.0, guess, MAX_ITERATIONS, system.tolerance)

    def go_on(now: _Stage) -> _Stage:
        plain = now.softness <= 1.0
        enough = jnp.where(plain, system.tolerance, LOOSE)
        first = now.left == stages
        solved = _walk(system, at, now.softness, now.known, jnp.where(first, MAX_ITERATIONS, PATIENCE), enough)
        arrived = solved.error <= enough
        hopeless = ~arrived & (now.softness >= SOFTEST)
        reached = jnp.where(arrived, now.softness, now.reached)
        fall = jnp.where(arrived | first, now.fall, jnp.sqrt(now.fall))
        return _Stage(
            solved._replace(iterations=now.solved.iterations + solved.iterations),
            jnp.where(first, SOFTEST, jnp.maximum(reached * fall, 1.0)),
            jax.tree.map(lambda old, new: jnp.where(arrived, new, old), now.known, solved.unknowns),
            reached,
            fall,
            jnp.where((arrived & plain) | hopeless, 0, now.left - 1),
        )

    stages = jnp.where(at.drive.reach.lagging, STAGES, 1)
    one = jnp.ones(())
    nowhere = jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), jax.eval_shape(ahead, system, at, guess.xi))
    begin = _Stage(
        Solved(guess, nowhere, jnp.asarray(0), jnp.inf * one),
        one,
        guess,
        SOFTEST * one,
        FALL * one,
        stages,
    )
    return lax.while_loop(lambda now: now.left > 0, go_on, begin).solved


class _Stage(NamedTuple):
    """A problem on the way from a soft one to the one that is asked."""

    solved: Solved
    softness: Array
    known: Unknowns
    """Solution of the last stage that was solved."""
    reached: Array
    """Its softness."""
    fall: Array
    """Factor on the softness from stage to stage."""
    left: Array


class _Point(NamedTuple):
    """Where Newton's method stands."""

    unknowns: Unknowns
    residual: Unknowns
    there: There
    iterations: Array
    error: Array
    merit: Array


def _walk(
    system: System, asked: Frame, softness: float | Array, begin: Unknowns, most: int | Array, enough: float | Array
) -> Solved:
    """Newton's method on one problem."""
    at, haze = softened(asked, softness), jnp.minimum(softness, HAZIEST)
    barrier = jax.tree.map(lambda sharp: sharp * haze, _barrier(system, asked))
    interior = bool(system.contacts.count or system.touches.count)

    def looked(unknowns: Unknowns, iterations: int | Array) -> _Point:
        residual, there = equations(system, at, unknowns, barrier)
        error, merit = _size(system, at, unknowns, residual, there)
        return _Point(unknowns, residual, there, jnp.asarray(iterations), error, merit)

    def unfinished(now: _Point) -> Bool[Array, ""]:
        # A guess lags behind what moves: taken as good enough it would drop as much of the momentum in every step.
        lagging = (now.iterations == 0) & (now.error > STILL)
        return ((now.error > enough) | lagging) & (now.iterations < most)

    def iterate(now: _Point) -> _Point:
        change, _ = direction(system, linearise(system, at, now.unknowns, now.there), now.residual)

        def tried(share: float | Array) -> _Point:
            return looked(_moved(at, now.unknowns, change, share, barrier), now.iterations + 1)

        if not interior:
            return tried(1.0)

        def worse(trial: tuple[Array, _Point]) -> Bool[Array, ""]:
            share, then = trial
            fell = then.merit <= (1.0 - ENOUGH * share) * now.merit
            # The first is always made: a merit that overflows compares with nothing, and each iteration must end.
            return (share > 1.0) | (~fell & (share > SHORTEST) & (then.error > enough))

        def shorter(trial: tuple[Array, _Point]) -> tuple[Array, _Point]:
            share = 0.5 * trial[0]
            return share, tried(share)

        return lax.while_loop(worse, shorter, (jnp.full((), 2.0), now))[1]

    if interior:
        begin = _moved(at, begin, jax.tree.map(jnp.zeros_like, begin), 0.0, barrier)
    end = lax.while_loop(unfinished, iterate, looked(begin, 0))
    return Solved(end.unknowns, end.there, end.iterations, end.error)


def _moved(at: Frame, unknowns: Unknowns, change: Unknowns, share: float | Array, barrier: Bounds) -> Unknowns:
    """Unknowns moved by a share of a change, walls along their curve."""
    xi, impulses = unknowns
    by = change.impulses
    walls, touches = impulses.walls, impulses.touches
    if walls.normal.size:
        walls = contact.along_path(at.drive.reach, walls, by.walls, share, barrier.walls)
    if touches.normal.size:
        touches = contact.along_path(at.meeting.reach, touches, by.touches, share, barrier.touches)
    return Unknowns(
        _shortened(xi + share * change.xi),
        Impulses(impulses.rows + share * by.rows, walls, touches, impulses.pads + share * by.pads),
    )


def _close_jvp(primals: tuple, tangents: tuple) -> tuple[Solved, Solved]:
    """Implicit function theorem: the residual's change, sent back through the factored slope."""
    system, at, guess = primals
    solved = close(system, at, guess)
    unknowns = checkpoint_name(solved.unknowns, SOLUTION)

    def moving(system: System, at: Frame, xi: BodyRows) -> tuple[Unknowns, There, BodyRows]:
        return *equations(system, at, unknowns._replace(xi=xi), _barrier(system, at)), xi

    # The guess's own tangent is the first answer, so that only its small remainder goes through the stiff rows (1/ε):
    # the whole leaves 1e-10 of a slope in rounding, however often it is solved for.
    now, first = along(moving, (system, at, unknowns.xi), (*tangents[:2], tangents[2].xi))
    # Where the solution leads is computed anew, so that a derivative backwards in time keeps the solution alone.
    answer, displaced = direction(system, linearise(system, at, unknowns, now[1]), first[0], refined=True)
    answer = answer._replace(xi=first[2] + answer.xi)
    there = jax.tree.map(jnp.zeros_like, first[1])._replace(moved=first[1].moved + displaced)
    none = jnp.zeros((), dtype=jax.dtypes.float0)
    iterations, error = checkpoint_name((solved.iterations, solved.error), SOLUTION)
    return Solved(unknowns, solved.there, iterations, error), Solved(answer, there, none, jnp.zeros_like(error))


close.defjvp(_close_jvp, symbolic_zeros=True)


def step(
    system: System,
    motion: Motion,
    step_s: float | Array,
    target: Float[Array, "joints"],
    most: Bounds,
    piece: Piece = WHOLE,
) -> tuple[Motion, Solved, Bounds]:
    """Advance one time step: move freely, close the joints, respect friction and walls.

    most: largest gaps that walls may ask for; returned is what they may ask for where they gave back too much.
    """
    motion = refreshed(system, motion)
    at = frame(system, motion, step_s, target, most, piece)
    solved = close(system, at, _guess(system, at, motion))
    solved = solved._replace(error=lax.stop_gradient(solved.error))
    (xi, impulses), there = solved.unknowns, solved.there
    q = kinematics.coordinates_near(system, there.bodies, motion.q)
    velocity = xi / step_s
    parting = Bounds(_opening(system, at, there.moved), meeting.partings(system, at.meeting, velocity))
    took, asked = _accounts(system, at, motion, impulses, parting)
    rate = law.displacement(system, there.moved) / step_s
    after = Motion(
        pose=at.pose.advance(xi),
        bodies=lax.stop_gradient(there.bodies),
        rows=lax.stop_gradient(there.rows),
        time_s=motion.time_s + step_s,
        momentum=momentum(system, xi, step_s, -1.0),
        before_s=jnp.asarray(step_s),
        velocity=velocity,
        acceleration=(velocity - motion.velocity) / at.weight_s,
        q=lax.stop_gradient(q),
        rate=rate,
        quickening=(rate - motion.rate) / at.weight_s,
        borne=rubbing.borne_after(at.drive.rubbing, rate * step_s),
        opening=parting.walls,
        parting=parting.touches,
        impulses=jax.tree.map(lax.stop_gradient, impulses),
        taken=took,
    )
    return after, solved, asked


def _accounts(system: System, at: Frame, motion: Motion, impulses: Impulses, rate: Bounds) -> tuple[Bounds, Bounds]:
    """What walls have taken after the step, and what they may ask for instead."""
    inside, between = at.drive.reach, at.meeting.reach
    gap, room = contact.gap(system.contacts, inside.room, inside.here), between.room
    ahead = Bounds(gap + at.step_s * rate.walls, room + at.step_s * rate.touches)
    own, taken, barrier = (motion.opening, rate.walls), motion.taken, _energy(system)
    walls = giving.account(inside, impulses.walls, ahead.walls, own, taken.walls, barrier.walls)
    own = motion.parting, rate.touches
    touches = giving.account(between, impulses.touches, ahead.touches, own, taken.touches, barrier.touches)
    return Bounds(walls[0], touches[0]), Bounds(walls[1], touches[1])


def _opening(system: System, at: Frame, there: Float[Array, "joints 6"]) -> Float[Array, "walls"]:
    """Rate of the gaps at the walls."""
    reach = at.drive.reach
    gaps = [contact.gap(system.contacts, reach.room, eta) for eta in (law.at_walls(system, there), reach.here)]
    return (gaps[0] - gaps[1]) / at.step_s


def _guess(system: System, at: Frame, motion: Motion) -> Unknowns:
    """Keep accelerating as before; walls keep pushing, and take up what the motion would close."""
    xi = _shortened(at.step_s * (motion.velocity + at.step_s * motion.acceleration))
    impulses, barrier = motion.impulses, _barrier(system, at)

    def begun(reach: Reach, gap: Array, push: Push, barrier: Array) -> Push:
        return contact.on_path(reach, reach.ease * push.normal - (2 * gap - reach.back), push.rub, barrier)

    if system.contacts.count:
        reach = at.drive.reach
        gap = contact.gap(system.contacts, reach.room, reach.here)
        impulses = impulses._replace(walls=begun(reach, gap, impulses.walls, barrier.walls))
    if system.touches.count:
        reach = at.meeting.reach
        impulses = impulses._replace(touches=begun(reach, reach.room, impulses.touches, barrier.touches))
    return Unknowns(xi, lax.stop_gradient(impulses))


def _barrier(system: System, at: Frame) -> Bounds:
    """κ is an energy times the step, so that impacts stay inelastic as the step shrinks."""
    return jax.tree.map(lambda energy: energy * at.step_s, _energy(system))


def _energy(system: System) -> Bounds:
    """What each wall spends to stay open [J], by the mass that it holds."""
    each = system.barrier / system.scale.mass_kg
    return Bounds(each * system.joint_mass[system.contacts.at], each * jnp.repeat(system.touch_mass, touch.PLACES))


def _size(
    system: System, at: Frame, unknowns: Unknowns, residual: Unknowns, there: There
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Largest residual, and the sum of their squares, as displacements in mechanism lengths."""
    length = system.scale.length_m
    inertia = jnp.trace(system.inertia, axis1=1, axis2=2) / 3
    linear_part = jnp.abs(residual.xi[:, :3]) * (at.step_s / length / system.mass[:, None])
    turning = jnp.abs(residual.xi[:, 3:]) * (at.step_s / length / jnp.sqrt(inertia * system.mass)[:, None])
    row_scale = jnp.array([1 / length] * 3 + [1.0] * 3)
    per_mass, held = at.step_s / length, law.held(system)
    impulse = (per_mass / length / system.joint_mass)[:, None]
    far = jnp.max(jnp.abs(at.pose.position), initial=length)
    rounding = ROUNDING * law.dry_stiffness(system, at.drive, there.moved, unknowns.impulses, far)
    rows = jnp.maximum(jnp.abs(residual.impulses.rows) - rounding, 0.0) * jnp.where(held, row_scale, impulse)
    padded = jnp.minimum(system.mass, system.scale.mass_kg)[np.array(system.pads.bodies, dtype=int)]
    parts, rubs, slides = (
        [linear_part, turning, rows, jnp.abs(residual.impulses.pads) * per_mass / padded[:, None]],
        [],
        [],
    )
    now, left = unknowns.impulses, residual.impulses
    groups = []
    if system.contacts.count:
        mass = system.joint_mass[system.contacts.at]
        groups.append((system.contacts, at.drive.reach, now.walls, left.walls, mass))
    if system.touches.count:
        mass = jnp.repeat(system.touch_mass, touch.PLACES)
        groups.append((touch.walls(system), at.meeting.reach, now.touches, left.touches, mass))
    for contacts, reach, push, off, mass in groups:
        parts.append(jnp.abs(off.normal) / length)
        rub = jnp.abs(off.rub) * per_mass / mass
        slid = TOLERANCE / SLID * contact.slid(contacts, reach, push, off.rub) / reach.stick
        rubs.append(rub)
        slides.append(jnp.minimum(rub, slid))
    largest = jnp.max(jnp.concatenate([part.ravel() for part in parts + slides]))
    every = jnp.concatenate([part.ravel() for part in parts + rubs])
    return largest, every @ every


def _shortened(xi: BodyRows) -> BodyRows:
    phi = xi[:, 3:]
    size = jnp.sqrt(jnp.sum(phi * phi, -1, keepdims=True) + 1e-30)
    return jnp.concatenate([xi[:, :3], phi * jnp.minimum(1.0, LARGEST_TURN / size)], -1)
