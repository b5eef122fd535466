"""What a joint's rows answer to the impulses they carry.

Every joint carries six impulses λ along its rows y.  A held row gives way by a whisker, y + ε λ = 0, which
makes the impulses of an overconstrained mechanism unique (the compliance solve).  The coordinate's row answers
with damping, inertia, a spring, dry friction and efforts; walls inside the joint (ends of travel, a loose hole) push
on the rows they touch; any other row carries nothing.

Dry friction carries -u (w limit + slope |λ_xy|), of which `rubbing` tells the share u.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from backend.joints.joint import SLIDE
from backend.model.incidence import picked
from backend.model.system import System
from backend.simulate import contact, rubbing
from backend.simulate.contact import Push, Reach
from backend.simulate.rubbing import Rubbing


class Impulses(NamedTuple):
    """What the joints carry in a step: λ along their rows [N s, N m s], and what their walls carry."""

    rows: Float[Array, "joints 6"]
    walls: Push
    touches: Push
    """Of links that meet, at each of their places."""
    pads: Float[Array, "pads 2"]
    """Friction of bodies on the bed, in its plane [N s]."""


class Drive(NamedTuple):
    """What a step brings to the joints from outside its unknowns."""

    step_s: float | Array
    weight_s: Array
    """Time that the step's impulses stand for: half of the steps before and after q_k."""
    rubbing: Rubbing
    effort: Float[Array, "joints"]
    """Impulse of the efforts that depend on position [N m s or N s]."""
    rate: Float[Array, "joints"]
    """Of the coordinates, in the step before."""
    q: Float[Array, "joints"]
    """Coordinate at the step's start."""
    target: Float[Array, "joints"]
    """Displacement that a driven coordinate must make."""
    reach: Reach


class Slope(NamedTuple):
    """δλ = l₀ - K δy at one point of the law."""

    stiffness: Float[Array, "joints 6"] | Float[Array, "joints 6 6"]
    """K: of each row by itself, or full where rows depend on each other (walls, and friction that grows with the load).
    """
    load_friction: Float[Array, "joints 2"]
    walls: contact.Slope


def held(system: System) -> np.ndarray:
    """(joints, 6) rows held by the joint's kind or by a drive; play frees its own."""
    return system.rigid_rows | (system.coordinate_rows & system.is_driven[:, None])


def free(system: System) -> np.ndarray:
    """(joints, 6) one-hot rows of the coordinates that move by themselves."""
    return system.coordinate_rows & ~system.is_driven[:, None]


def displacement(system: System, y: Float[Array, "joints 6"]) -> Float[Array, "joints"]:
    """The coordinate's own row."""
    return jnp.sum(jnp.where(system.coordinate_rows, y, 0.0), -1)


def residual(system: System, drive: Drive, y: Float[Array, "joints 6"], impulses: Impulses, barrier: Array) -> Impulses:
    """How far the impulses are from what the laws ask."""
    moved = displacement(system, y)
    give = y - jnp.where(system.coordinate_rows, drive.target[:, None], 0.0) + system.compliance * impulses.rows
    limit = _dry_limit(system, drive, impulses.rows)
    own = _smooth(system, drive, moved) - limit * rubbing.share(drive.rubbing, moved)
    asked = jnp.where(free(system), own[:, None], 0.0)
    walls = impulses.walls
    if system.contacts.count:
        walls, pushed = contact.residual(system.contacts, drive.reach, at_walls(system, y), walls, barrier)
        asked = asked + _on_rows(system, pushed)
    return impulses._replace(rows=jnp.where(held(system), give, impulses.rows - asked), walls=walls)


def slope(system: System, drive: Drive, y: Float[Array, "joints 6"], impulses: Impulses) -> Slope:
    """Slope of the laws here."""
    contacts = system.contacts
    moved = displacement(system, y)
    limit = _dry_limit(system, drive, impulses.rows)
    dry = jnp.sum(jnp.where(free(system), impulses.rows, 0.0), -1) - _smooth(system, drive, moved)
    walls = _no_walls(impulses)
    if contacts.count:
        walls = contact.slope(contacts, drive.reach, at_walls(system, y), impulses.walls)
        pushed = _on_rows(system, contact.force(contacts, walls.face, impulses.walls))
        dry = dry - jnp.sum(jnp.where(free(system), pushed, 0.0), -1)
    own = 0.5 * drive.weight_s / drive.step_s * system.damping + system.rotor / drive.step_s
    own = own + 0.25 * drive.weight_s * system.stiffness
    own = own + rubbing.stiffness(drive.rubbing, limit, dry, moved)
    diagonal = jnp.where(held(system), 1.0 / system.compliance, jnp.where(free(system), own[:, None], 0.0))
    friction = jnp.zeros((moved.shape[0], 2))
    if not contacts.count and not system.load_dependent:
        return Slope(diagonal, friction, walls)
    full = diagonal[:, :, None] * jnp.eye(6)
    if contacts.count:
        selection = contacts.selection
        rows = jnp.einsum("cri,crs->cis", selection, walls.stiffness)
        walled = contacts.on_joints(jnp.einsum("cis,csj->cij", rows, selection))
        full = full + jnp.where(held(system)[:, :, None], 0.0, walled)
    if system.load_dependent:
        load = _load(system, drive, impulses.rows)
        friction = (system.dry_per_load * rubbing.share(drive.rubbing, moved) / load)[:, None] * impulses.rows[:, :2]
        coupled = jnp.sum(friction[:, :, None] * full[:, :2], 1)
        full = full - jnp.where(free(system)[:, :, None], coupled[:, None, :], 0.0)
    return Slope(full, friction, walls)


def dry_stiffness(
    system: System, drive: Drive, y: Float[Array, "joints 6"], impulses: Impulses, far_m: Array
) -> Float[Array, "joints 6"]:
    """By how much dry friction's impulse changes at most as a joint turns by 1 rad or slides by `far_m`."""
    moved = displacement(system, y)
    per = rubbing.steepest(drive.rubbing, _dry_limit(system, drive, impulses.rows), moved)
    slides = system.coordinate_rows[:, SLIDE]
    return jnp.where(free(system), (per * jnp.where(slides, far_m, 1.0))[:, None], 0.0)


def offset(system: System, at: Slope, impulses: Impulses, wanted: Impulses) -> tuple[Array, Push]:
    """l₀ and the walls' own change for residuals `wanted` (linear in them)."""
    change = -jnp.where(held(system), wanted.rows / system.compliance, wanted.rows)
    walls = wanted.walls
    if system.contacts.count:
        walls, pushed = contact.offset(system.contacts, at.walls, impulses.walls, wanted.walls)
        change = change + jnp.where(held(system), 0.0, _on_rows(system, pushed))
    if system.load_dependent:
        loaded = jnp.sum(at.load_friction * change[:, :2], -1)
        change = change - jnp.where(free(system), loaded[:, None], 0.0)
    return change, walls


def react(system: System, at: Slope, dy: Float[Array, "joints 6"]) -> Float[Array, "joints 6"]:
    """K δy."""
    if at.stiffness.ndim == 2:
        return at.stiffness * dy
    return jnp.sum(at.stiffness * dy[:, None, :], -1)


def walls_respond(system: System, at: Slope, own: Push, dy: Float[Array, "joints 6"]) -> Push:
    """Change of what the walls carry: their own, and what a displacement brings."""
    if not system.contacts.count:
        return own
    brought = contact.respond(system.contacts, at.walls, at_walls(system, dy))
    return Push(*(mine + theirs for mine, theirs in zip(own, brought, strict=True)))


def at_walls(system: System, y: Float[Array, "joints 6"]) -> Float[Array, "walls 3"]:
    """Contact coordinates η = P y."""
    contacts = system.contacts
    if not contacts.count:
        return jnp.zeros((0, 3))
    return jnp.sum(contacts.selection * picked(y, contacts.at)[:, None, :], -1)


def _on_rows(system: System, pushed: Float[Array, "walls 3"]) -> Float[Array, "joints 6"]:
    return system.contacts.on_joints(jnp.sum(system.contacts.selection * pushed[:, :, None], 1))


def _smooth(system: System, drive: Drive, moved: Array) -> Array:
    """Impulse of damping, inertia, spring and effort along the coordinate.

    The spring takes the mean (q⁻ + 2 q + q⁺) / 4 around the node, which stays stable however stiff it is.
    """
    rate = moved / drive.step_s
    damping = 0.5 * drive.weight_s * system.damping * (rate + drive.rate)
    wound = drive.q - system.rest + 0.25 * (moved - drive.step_s * drive.rate)
    spring = drive.weight_s * system.stiffness * wound
    return drive.effort - damping - spring - system.rotor * (rate - drive.rate)


def _dry_limit(system: System, drive: Drive, rows: Array) -> Array:
    limit = drive.weight_s * drive.rubbing.limit
    return limit + system.dry_per_load * _load(system, drive, rows) if system.load_dependent else limit


def _load(system: System, drive: Drive, rows: Array) -> Array:
    """Radial impulse; a millionth of the weight that the joint holds keeps its slope finite."""
    weight = system.joint_mass * system.scale.gravity_m_per_s2
    return jnp.sqrt(jnp.sum(rows[:, :2] ** 2, -1) + (drive.step_s * 1e-6 * weight) ** 2)


def _no_walls(impulses: Impulses) -> contact.Slope:
    none = impulses.walls.normal
    two, three = jnp.zeros((0, 2)), jnp.zeros((0, 3))
    square = jnp.zeros((0, 2, 2))
    face = contact.Face(none, two, two, square, two)
    return contact.Slope(face, jnp.zeros((0, 3, 3)), three, three, three, none, none, none)
