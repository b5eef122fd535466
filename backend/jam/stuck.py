"""Whether and since when a mechanism is at rest, within the creep that regularised friction allows.

Dry friction holds below a rate ε_v and therefore creeps: at a share r of its limit a joint turns at r / √(1 - r²) ε_v.
The creep ratio is the largest rate over ε_v; below ten, friction uses at most 99.5% of its limit.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from backend.model.system import STICK_RATE, System
from backend.simulate.rollout import Trajectory
from backend.simulate.spectrum import real

AT_REST = 10.0  # creep ratio
BODIES = 10.0  # times ε_v that a body may move by where a joint may by one: chains add up, walls give way
FEWEST = 5  # nodes that tell rest from the turning point of a swing
SHORTEST_S = 0.01
STANDSTILL = 1e-3  # of the greatest rate


class Rest(NamedTuple):
    """The stretch at rest that a motion ends with: the node at which it came to a standstill, and when that was."""

    node: int
    onset_s: float


def creep_ratio(system: System, path: Trajectory) -> Float[np.ndarray, "nodes"]:
    """The largest rate of any joint over the rate ε_v at which friction holds; bodies count by a tenth of theirs."""
    return np.asarray(_creep(system, path.rate, path.velocity))


def creep(
    system: System, rate: Float[Array, "nodes joints"], velocity: Float[Array, "nodes slots 6"]
) -> Float[Array, "nodes"]:
    """`creep_ratio`, to be compiled with what surrounds it."""
    joints = jnp.abs(rate) / system.stick_rate
    unit = jnp.concatenate([jnp.full(3, 1.0 / system.scale.length_m), jnp.ones(3)])
    bodies = jnp.abs(velocity)[:, real(system)] * unit / (BODIES * STICK_RATE)
    return jnp.maximum(joints.max(-1, initial=0.0), bodies.max((-2, -1), initial=0.0))


_creep = eqx.filter_jit(creep)


def at_rest(creep: Float[np.ndarray, "nodes"], step_s: float) -> Rest | None:
    """The rest that a motion ends with, or None where it still moves, or has only just stopped."""
    moving = np.flatnonzero(~(creep < AT_REST))
    first = int(moving[-1]) + 1 if moving.size else 0
    lasting = creep.size - first
    if lasting < FEWEST or (first > 0 and lasting * step_s < SHORTEST_S):
        return None
    # After a blow, or in a viscous joint, the last of the speed lingers; the standstill is when a thousandth is left.
    fast = np.flatnonzero(~(creep < max(AT_REST, STANDSTILL * float(creep.max()))))
    came = int(fast[-1]) + 1 if fast.size else 0
    return Rest(came, came * step_s)


def travel(system: System, path: Trajectory) -> float:
    """How far any body or joint came from the start, in mechanism lengths or rad."""
    length = float(system.scale.length_m)
    sliding = np.where(system.coordinate_rows[:, :3].any(-1), length, 1.0)
    turned = np.abs(np.asarray(path.q[-1] - path.q[0])) / sliding
    moved = np.asarray(path.pose.position[-1] - path.pose.position[0])[real(system)] / length
    return float(max(turned.max(initial=0.0), np.abs(moved).max(initial=0.0)))


def largest_play(system: System) -> Float[Array, ""]:
    """The largest room of any loose pin, in mechanism lengths."""
    rooms = jnp.where(jnp.array(system.contacts.travels, dtype=bool), 0.0, system.contacts.room)
    return jnp.max(rooms, initial=0.0) / system.scale.length_m
