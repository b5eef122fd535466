"""The speed with which a hand lets a mechanism go."""

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from backend.joints.joint import TURN
from backend.model.incidence import added
from backend.model.state import Pose
from backend.model.system import System
from backend.simulate import kinematics, law
from backend.simulate.momentum import BodyRows

FAINT = 1e-6  # weight of joints that are not pushed: they move only as the loops ask
AGAIN = 3  # times that pushed joints are asked for what they lack: near a dead centre others go 100 times as fast
UNSEEN = 1e-13  # of free motions that no joint shows


def pushed(system: System, pose: Pose, motions: Float[Array, "mobility slots 6"]) -> BodyRows:
    """Velocity at the release: pushed joints have their speeds, all others as little as can be.

    motions: velocities that the held rows allow, one for each free motion.
    """
    jacobian = kinematics.rows(system, kinematics.bodies(system, pose)).jacobian
    rates = jax.vmap(lambda v: law.displacement(system, _rates(system, jacobian, v)))(motions).T
    turning = system.coordinate_rows[:, TURN]
    unit = jnp.where(turning, 1.0, 1.0 / system.scale.length_m)
    wanted, named = jnp.zeros(len(turning)), np.zeros(len(turning), dtype=bool)
    for placed in system.pushes:
        joints = np.array([joint for (joint,) in (place or (_first(system),) for place in placed.places)], dtype=int)
        speeds = jax.vmap(lambda push, turns: push.speed(turns))(placed.here, jnp.asarray(turning[joints]))
        wanted, named = wanted + added(speeds, joints, len(turning)), named | np.isin(np.arange(len(turning)), joints)
    weight = jnp.where(named, 1.0, FAINT) * unit**2
    square = rates.T @ (weight[:, None] * rates) + UNSEEN * jnp.eye(rates.shape[1])
    gain = jnp.linalg.solve(square, rates.T * weight)

    def asked_again(_: int, asked: Float[Array, "joints"]) -> Float[Array, "joints"]:
        return asked + jnp.where(named, wanted - rates @ (gain @ asked), 0.0)

    share = gain @ lax.fori_loop(0, 1 + AGAIN, asked_again, jnp.zeros(len(turning)))
    return jnp.einsum("m,mbi->bi", share, motions)


def _first(system: System) -> int:
    """The first drawn joint that moves by itself."""
    moves = (system.pairs < system.topology.slots).any(1)
    free = system.coordinate_rows.any(1) & ~system.is_driven & moves
    free[list(system.sections)] = False
    if not free.any():
        raise ValueError("release_velocity: no joint of this mechanism can be given a speed; remove the effect")
    return int(np.flatnonzero(free)[0])


def _rates(system: System, jacobian: Float[Array, "joints 6 12"], velocity: BodyRows) -> Float[Array, "joints 6"]:
    """Rates of all rows under a velocity of the bodies."""
    every = jnp.concatenate([velocity, jnp.zeros_like(system.fixed_position).repeat(2, 1)])
    return jnp.sum(jacobian * every[system.pairs].reshape(-1, 1, 12), -1)
