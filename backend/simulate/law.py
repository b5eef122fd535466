"""What a joint's rows answer to the impulses they carry.

Every joint carries six impulses λ along its rows y.  A held row gives way by a whisker, y + ε λ = 0, which
makes the impulses of an overconstrained mechanism unique (the compliance solve).  The coordinate's row answers
with damping, inertia, dry friction, efforts and stops; any other row carries nothing.

Dry friction: λ = -D y / √(y² + (h ε_v)²), D = h limit + slope |λ_xy|.  A stop with gap g keeps γ g = κ, γ, g > 0
(primal-dual interior point with slack s).
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from backend.model.system import System

STOP_SIDE = np.array([1.0, -1.0])  # slope of the lower and of the upper gap in q


class Impulses(NamedTuple):
    """What the joints carry in a step: λ per row [N s, N m s], γ per stop, s its slack [rad or m]."""

    rows: Float[Array, "joints 6"]
    stop: Float[Array, "stops 2"]
    slack: Float[Array, "stops 2"]


class Drive(NamedTuple):
    """What a step brings to the joints from outside its unknowns."""

    step_s: float | Array
    effort: Float[Array, "joints"]
    """Impulse of the efforts that depend on position [N m s or N s]."""
    before: Float[Array, "joints"]
    """Displacement of the coordinate in the step before."""
    q: Float[Array, "joints"]
    """Coordinate at the step's start."""
    target: Float[Array, "joints"]
    """Displacement that a driven coordinate must make."""


class Slope(NamedTuple):
    """δλ = l₀ - K δy at one point of the law, K diagonal but for friction's dependence on the load."""

    stiffness: Float[Array, "joints 6"]
    load_coupling: Float[Array, "joints 2"]
    load_friction: Float[Array, "joints 2"]
    stop_ratio: Float[Array, "stops 2"]


def held(system: System) -> np.ndarray:
    """(joints, 6) rows held by the joint's kind or by a drive."""
    return system.held_rows | (system.coordinate_rows & system.is_driven[:, None])


def free(system: System) -> np.ndarray:
    """(joints, 6) one-hot rows of the coordinates that move by themselves."""
    return system.coordinate_rows & ~system.is_driven[:, None]


def displacement(system: System, y: Float[Array, "joints 6"]) -> Float[Array, "joints"]:
    """The coordinate's own row."""
    return jnp.sum(jnp.where(system.coordinate_rows, y, 0.0), -1)


def residual(system: System, drive: Drive, y: Float[Array, "joints 6"], impulses: Impulses, barrier: Array) -> Impulses:
    """How far the impulses are from what the laws ask: rows, then gap - slack, then γ s - κ."""
    moved = displacement(system, y)
    give = y - jnp.where(system.coordinate_rows, drive.target[:, None], 0.0) + system.compliance * impulses.rows
    carried = jnp.sum(jnp.where(free(system), impulses.rows, 0.0), -1)
    dry, _ = _dry(system, drive, moved, impulses.rows)
    own = carried - _smooth(system, drive, moved) - _stop_push(system, impulses.stop) + dry
    rows = jnp.where(held(system), give, jnp.where(free(system), own[:, None], impulses.rows))
    gap = _gaps(system, drive, moved) - impulses.slack
    return Impulses(rows, gap, impulses.slack * impulses.stop - barrier)


def slope(system: System, drive: Drive, y: Float[Array, "joints 6"], impulses: Impulses) -> Slope:
    """Slope of the laws here.

    Dry friction's is the primal-dual one of Chan, Golub and Mulet (1999): equal to the true slope at the root, yet
    it keeps Newton's method steady while a joint changes between sticking and sliding.
    """
    moved = displacement(system, y)
    limit, rounded = _dry_limit(system, drive, moved, impulses.rows)
    carried = jnp.sum(jnp.where(free(system), impulses.rows, 0.0), -1)
    dry = carried - _smooth(system, drive, moved) - _stop_push(system, impulses.stop)
    dry = jnp.clip(dry, -limit, limit)
    ratio = impulses.stop / impulses.slack
    stiffness = 0.5 * system.damping + system.rotor / drive.step_s + (limit + dry * moved / rounded) / rounded
    stiffness = stiffness + _at_joints(system, jnp.sum(ratio, -1))
    rows = jnp.where(held(system), 1.0 / system.compliance, jnp.where(free(system), stiffness[:, None], 0.0))
    friction = jnp.zeros((moved.shape[0], 2))
    if system.load_dependent:
        radial = impulses.rows[:, :2]
        load = _load(system, drive, impulses.rows)
        friction = (system.dry_per_load * moved / rounded / load)[:, None] * radial
    coupling = -friction / system.compliance[:, :2]
    return Slope(rows, coupling, friction, ratio)


def offset(system: System, at: Slope, impulses: Impulses, wanted: Impulses) -> tuple[Array, Array]:
    """l₀ and the stops' own change for residuals `wanted` (linear in them)."""
    rows = jnp.where(held(system), wanted.rows / system.compliance, wanted.rows)
    stop = -(wanted.slack + impulses.stop * wanted.stop) / impulses.slack
    change = -rows
    own = _at_joints(system, jnp.sum(STOP_SIDE * stop, -1)) - jnp.sum(at.load_friction * change[:, :2], -1)
    return change + jnp.where(free(system), own[:, None], 0.0), stop


def answer(system: System, at: Slope, jacobian: Float[Array, "joints 6 12"]) -> Float[Array, "joints 6 12"]:
    """K J."""
    product = at.stiffness[:, :, None] * jacobian
    if system.load_dependent:
        coupled = jnp.sum(at.load_coupling[:, :, None] * jacobian[:, :2], 1)
        product = product + jnp.where(free(system)[:, :, None], coupled[:, None, :], 0.0)
    return product


def react(system: System, at: Slope, dy: Float[Array, "joints 6"]) -> Float[Array, "joints 6"]:
    """K δy."""
    product = at.stiffness * dy
    if system.load_dependent:
        coupled = jnp.sum(at.load_coupling * dy[:, :2], -1)
        product = product + jnp.where(free(system), coupled[:, None], 0.0)
    return product


def stop_response(system: System, at: Slope, dy: Float[Array, "joints 6"]) -> tuple[Array, Array]:
    """Change of γ and of the slack that a displacement brings."""
    along = displacement(system, dy)[np.array(system.stops, dtype=int)][:, None] * STOP_SIDE
    return -at.stop_ratio * along, along


def _smooth(system: System, drive: Drive, moved: Array) -> Array:
    """Impulse of damping, inertia and effort along the coordinate."""
    damping = 0.5 * system.damping * (moved + drive.before)
    return drive.effort - damping - system.rotor * (moved - drive.before) / drive.step_s


def _dry(system: System, drive: Drive, moved: Array, rows: Array) -> tuple[Array, Array]:
    limit, rounded = _dry_limit(system, drive, moved, rows)
    return limit * moved / rounded, limit


def _dry_limit(system: System, drive: Drive, moved: Array, rows: Array) -> tuple[Array, Array]:
    limit = drive.step_s * system.dry_limit
    if system.load_dependent:
        limit = limit + system.dry_per_load * _load(system, drive, rows)
    return limit, jnp.sqrt(moved**2 + (drive.step_s * system.stick_rate) ** 2)


def _load(system: System, drive: Drive, rows: Array) -> Array:
    """Radial impulse; a millionth of the mechanism's weight keeps its slope finite."""
    weight = system.scale.mass_kg * system.scale.gravity_m_per_s2
    return jnp.sqrt(jnp.sum(rows[:, :2] ** 2, -1) + (drive.step_s * 1e-6 * weight) ** 2)


def _gaps(system: System, drive: Drive, moved: Array) -> Array:
    q = (drive.q + moved)[np.array(system.stops, dtype=int)][:, None]
    return jnp.asarray(STOP_SIDE) * (q - system.stop_ends)


def _stop_push(system: System, stop: Array) -> Array:
    return _at_joints(system, jnp.sum(STOP_SIDE * stop, -1))


def _at_joints(system: System, values: Array) -> Array:
    """Spread values of joints with stops over all joints."""
    if not system.stops:
        return jnp.zeros(())
    return jnp.zeros(len(system.coordinate)).at[np.array(system.stops, dtype=int)].set(values)
