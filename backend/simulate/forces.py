"""Impulses of the effects on bodies and joints during one step."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from backend.effects.effect import BodyView, Wrench
from backend.model.incidence import added, gathered, picked
from backend.model.placed import Placed
from backend.model.system import System
from backend.simulate.kinematics import Bodies
from backend.simulate.momentum import BodyRows
from backend.simulate.small import apply, apply_transposed, dot

TINY_M = 1e-9  # keeps the direction of a strut of no length finite
NO_LIMIT = 1e-12  # of the mechanism's weight times its length: where nothing rubs, nothing gives


class Lines(NamedTuple):
    """Length of every strut [m], and its slope with respect to (Δx, turn) of its first, then second body."""

    length: Float[Array, "struts"]
    slope: Float[Array, "struts 12"]


def views(
    system: System,
    placed: Bodies,
    velocity: BodyRows,
    which: np.ndarray,
    parts: Float[Array, " places"] | None = None,
) -> BodyView:
    """What effects see of the bodies in these slots; parts: how much of a link each is, None: the whole."""
    resting = jnp.zeros((system.fixed_position.shape[0], 6))
    moving = picked(jnp.concatenate([velocity, resting]), which)
    mass = picked(jnp.concatenate([system.mass, jnp.ones(resting.shape[0])]), which)
    R_WB = picked(placed.rotation, which)
    return BodyView(
        p_WC=picked(placed.position, which),
        R_WB=R_WB,
        v_WC=moving[:, :3],
        w_WB_B=moving[:, 3:],
        mass=mass,
        p_BC=picked(system.center_of_mass, which),
        stretch=picked(system.stretch, which),
        along_B=picked(system.length_axis, which),
        part=jnp.ones(len(which)) if parts is None else parts,
    )


def body_forces(system: System, placed: Bodies, velocity: BodyRows, lines: Lines | None = None) -> BodyRows:
    """Forces that depend on where bodies are (weight, drives, springs), about the centre of mass [N, N m].

    lines: those of the struts, where they are known.
    """
    total = strut_pull(system, lines or strut_lines(system, placed))
    for group in system.forces:
        a, b = _both(group, system)
        wrenches = jax.vmap(lambda e, va, vb: e.wrench(va, vb))(
            group.here, views(system, placed, velocity, a), views(system, placed, velocity, b)
        )
        for wrench, which in zip(wrenches, (a, b), strict=True):
            if wrench is not None:
                total = total + _on_bodies(system, _in_body(placed, wrench, which), which)
    return total


def drag(system: System, placed: Bodies, velocity: BodyRows) -> BodyRows:
    """Forces against velocity, at a velocity given for every body [N, N m]."""
    total = jnp.zeros_like(velocity)
    for group in system.drags:
        which = group.at()
        shares = jnp.array(group.shares)
        wrench = jax.vmap(lambda e, v: e.wrench(v))(group.here, views(system, placed, velocity, which, shares))
        rows = _in_body(placed, wrench, which) * shares[:, None]
        total = total + _on_bodies(system, rows, which)
    return total


def drag_slope(system: System, placed: Bodies, velocity: BodyRows) -> Float[Array, "slots 6 6"]:
    """d drag / d velocity of the same body: drag acts on one body at a time."""

    def one(direction: Float[Array, "6"]) -> BodyRows:
        along = jnp.broadcast_to(direction, velocity.shape)
        return jax.jvp(lambda v: drag(system, placed, v), (velocity,), (along,))[1]

    return jnp.moveaxis(jax.vmap(one)(jnp.eye(6)), 0, -1)


def joint_efforts(system: System, q: Float[Array, "joints"]) -> Float[Array, "joints"]:
    """Efforts along the joints' coordinates that depend on where the joint is [N m or N]."""
    total = jnp.zeros_like(q)
    for group in system.efforts:
        total = total + group.summed(q.shape[0], jax.vmap(lambda e, x: e.effort(x))(group.here, picked(q, group.at())))
    return total


def dry_limits(system: System, rate: Float[Array, "joints"]) -> Float[Array, "joints"]:
    """Limit of the dry friction at joints that carry nothing, at these rates of their coordinates [N m or N]."""
    return system.dry_limit + _of_rates(system, rate, lambda e, x: e.limit(x))


def giving(system: System, rate: Float[Array, "joints"]) -> tuple[Float[Array, "joints"], Float[Array, "joints"]]:
    """How far dry friction gives before it slides [rad or m], and the rate of its onset [rad/s or m/s]: where a joint
    has several kinds, each counts by its limit under the mechanism's weight.
    """
    bend = system.bend + _of_rates(system, rate, lambda e, x: e.limit(x) * e.presliding())
    creep = system.creep + _of_rates(system, rate, lambda e, x: e.limit(x) * e.onset())
    heavy = system.scale.mass_kg * system.scale.gravity_m_per_s2
    limit = dry_limits(system, rate) + heavy * system.dry_per_load + NO_LIMIT * heavy * system.scale.length_m
    return bend / limit, creep / limit


def _of_rates(
    system: System, rate: Float[Array, "joints"], law: Callable[[Any, Array], Array]
) -> Float[Array, "joints"]:
    """Summed over the friction that depends on a joint's rate."""
    total = jnp.zeros_like(rate)
    for group in system.rate_frictions:
        total = total + group.summed(rate.shape[0], jax.vmap(law)(group.here, picked(rate, group.at())))
    return total


def strut_lines(system: System, placed: Bodies) -> Lines:
    """Length and slope of every strut."""
    if not system.topology.struts:
        return Lines(jnp.zeros(0), jnp.zeros((0, 12)))
    ends = np.array(system.topology.struts, dtype=int).reshape(-1, 2)
    a, b = ends[:, 0], ends[:, 1]
    R_WA, R_WB = picked(placed.rotation, a), picked(placed.rotation, b)
    line = (
        picked(placed.position, b)
        + apply(R_WB, system.strut_b)
        - picked(placed.position, a)
        - apply(R_WA, system.strut_a)
    )
    length = jnp.sqrt(dot(line, line) + TINY_M**2)
    u_W = line / length[:, None]
    turn_a = jnp.cross(system.strut_a, apply_transposed(R_WA, u_W))
    turn_b = jnp.cross(system.strut_b, apply_transposed(R_WB, u_W))
    return Lines(length, jnp.concatenate([-u_W, -turn_a, u_W, turn_b], -1))


def strut_pull(system: System, lines: Lines) -> BodyRows:
    """Elastic tension of every strut on its two bodies."""
    if not system.topology.struts:
        return jnp.zeros((system.topology.slots, 6))
    length, slope = lines
    return collect(system.topology.strut_sides, -strut_tension(system, length)[:, None] * slope)


def strut_tension(system: System, length: Float[Array, "struts"]) -> Float[Array, "struts"]:
    """Pull of every strut [N]; struts stand in the order of their kinds."""
    tensions, first = [], 0
    for group in system.struts:
        count = len(group.places)
        tensions.append(jax.vmap(lambda e, x: e.tension(x))(group.here, length[first : first + count]))
        first += count
    return jnp.concatenate(tensions) if tensions else jnp.zeros(0)


def collect(table: np.ndarray, rows: Array) -> BodyRows:
    """Sum rows of six (one per side of a pair) into the bodies that the table of sides names."""
    return gathered(rows.reshape(-1, 6), table)


def _in_body(placed: Bodies, wrench: Wrench, which: np.ndarray) -> Float[Array, "places 6"]:
    """Force in W, torque in body axes."""
    torque = jnp.zeros_like(wrench.force) if wrench.torque_B is None else wrench.torque_B
    if wrench.torque is not None:
        torque = torque + apply_transposed(picked(placed.rotation, which), wrench.torque)
    return jnp.concatenate([wrench.force, torque], -1)


def _on_bodies(system: System, rows: Float[Array, "places 6"], which: np.ndarray) -> BodyRows:
    """Summed over the places of each moving body; what acts on a fixed one is lost."""
    return added(rows, np.minimum(which, system.topology.slots), system.topology.slots)


def _both(group: Placed, system: System) -> tuple[np.ndarray, np.ndarray]:
    """First and second body of every place; the first fixed body where no second is named."""
    ground = system.topology.slots
    pairs = [(p[0], p[1] if len(p) > 1 else ground) for p in group.places]
    table = np.array(pairs, dtype=int).reshape(-1, 2)
    return table[:, 0], table[:, 1]
