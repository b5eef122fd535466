"""Where drawn points and body origins are in a motion."""

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Int

from backend.model.model import Model
from backend.model.state import Pose
from backend.model.system import System
from backend.simulate import kinematics
from backend.simulate.loop import loop
from backend.simulate.rollout import Trajectory
from backend.simulate.slopes import varied
from backend.simulate.small import apply

BLOCK = 128  # nodes at once


def marker_positions(model: Model, system: System, pose: Pose) -> Float[Array, "markers 3"]:
    """World positions of the drawing's markers at one pose [m]."""
    placed = kinematics.bodies(system, pose)
    which = np.array(model.marker_bodies, dtype=int)
    return placed.position[which] + apply(placed.rotation[which], system.markers)


def marker_paths(model: Model, system: System, trajectory: Trajectory) -> Float[Array, "nodes markers 3"]:
    """World positions of the drawing's markers over a motion [m]."""
    return jax.vmap(lambda pose: marker_positions(model, system, pose))(trajectory.pose)


def marker_velocities(model: Model, system: System, trajectory: Trajectory) -> Float[Array, "nodes markers 3"]:
    """World velocities of the drawing's markers over a motion [m/s]."""
    return _velocities(model, system, trajectory.pose, trajectory.velocity)


def markers_until(
    model: Model, system: System, trajectory: Trajectory, until: Int[Array, ""]
) -> tuple[Float[Array, "nodes markers 3"], Float[Array, "nodes markers 3"]]:
    """Positions and velocities [m, m/s] up to a node after which nobody looks, nothing behind: the room that a motion
    has is often several times its length. Differentiable forwards.
    """
    nodes = trajectory.q.shape[0]
    block = min(BLOCK, nodes)

    def wanted(given: tuple, now: tuple) -> Array:
        return now[0] * block <= given[-1]

    def onward(given: tuple, now: tuple) -> tuple:
        (system, pose, velocity, _), (k, path, rate) = given, now
        first = jnp.minimum(k * block, nodes - block)
        part, moving = jax.tree.map(lambda all_: lax.dynamic_slice_in_dim(all_, first, block), (pose, velocity))
        at = jax.vmap(lambda one: marker_positions(model, system, one))(part)
        moved = _velocities(model, system, part, moving)
        return k + 1, *(
            lax.dynamic_update_slice_in_dim(all_, some, first, 0) for all_, some in ((path, at), (rate, moved))
        )

    given = system, trajectory.pose, trajectory.velocity, until
    room = jnp.zeros((nodes, len(model.marker_ids), 3))
    _, path, rate = loop(wanted, onward, given, (jnp.zeros((), dtype=int), *varied((room, room), given)))
    return path, rate


def _velocities(model: Model, system: System, poses: Pose, velocities: Array) -> Float[Array, "nodes markers 3"]:
    which = np.array(model.marker_bodies, dtype=int)

    def at(pose: Pose, velocity: Array) -> Array:
        placed = kinematics.bodies(system, pose)
        resting = jnp.zeros((system.fixed_position.shape[0], 6))
        moving = jnp.concatenate([velocity, resting])[which]
        return moving[:, :3] + apply(placed.rotation[which], jnp.cross(moving[:, 3:], system.markers))

    return jax.vmap(at)(poses, velocities)


def origins(system: System, pose: Pose) -> Float[Array, "bodies 3"]:
    """World positions of all bodies' CAD origins [m]."""
    placed = kinematics.bodies(system, pose)
    return placed.position - apply(placed.rotation, system.center_of_mass)
