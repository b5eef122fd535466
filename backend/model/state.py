"""Where a mechanism is and how it moves."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from backend.frames import quaternion
from backend.model.model import Model
from backend.model.system import System


class Pose(eqx.Module):
    """Centre of mass [m, W] and attitude quaternion of every moving body (slots)."""

    position: Float[Array, "slots 3"]
    quaternion: Float[Array, "slots 4"]

    def advance(self, xi: Float[Array, "slots 6"]) -> "Pose":
        """Move by ξ = (Δx in W [m], φ in body axes [rad])."""
        return Pose(self.position + xi[:, :3], quaternion.advance(self.quaternion, xi[:, 3:]))

    def increment(self, other: "Pose") -> Float[Array, "slots 6"]:
        """The ξ that leads from here to the other pose."""
        turn = quaternion.increment(self.quaternion, other.quaternion)
        return jnp.concatenate([other.position - self.position, turn], -1)


class Start(eqx.Module):
    """Pose and velocity (centre of mass in W [m/s], turn rate in body axes [rad/s]) at time zero."""

    pose: Pose
    velocity: Float[Array, "slots 6"]


@eqx.filter_jit
def drawn_pose(model: Model, made: System) -> Pose:
    """Every moving body where the drawing puts its origin and axes."""
    slots = model.topology.slots
    attitude = model.drawn_poses[:slots, 3:]
    attitude = attitude / jnp.linalg.norm(attitude, axis=-1, keepdims=True)
    lever = jnp.einsum("bij,bj->bi", quaternion.rotation(attitude), made.center_of_mass[:slots])
    return Pose(model.drawn_poses[:slots, :3] + lever, attitude)
