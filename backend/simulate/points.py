"""Where drawn points and body origins are in a motion."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from backend.model.model import Model
from backend.model.state import Pose
from backend.model.system import System
from backend.simulate import kinematics
from backend.simulate.rollout import Trajectory
from backend.simulate.small import apply


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
    which = np.array(model.marker_bodies, dtype=int)

    def at(pose: Pose, velocity: Array) -> Array:
        placed = kinematics.bodies(system, pose)
        resting = jnp.zeros((system.fixed_position.shape[0], 6))
        moving = jnp.concatenate([velocity, resting])[which]
        return moving[:, :3] + apply(placed.rotation[which], jnp.cross(moving[:, 3:], system.markers))

    return jax.vmap(at)(trajectory.pose, trajectory.velocity)


def origins(system: System, pose: Pose) -> Float[Array, "bodies 3"]:
    """World positions of all bodies' CAD origins [m]."""
    placed = kinematics.bodies(system, pose)
    return placed.position - apply(placed.rotation, system.center_of_mass)
