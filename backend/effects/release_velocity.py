"""A hand that pushes while it lets go."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from backend.effects.effect import TURNING, parameter
from backend.effects.shapes import AbstractPush


class ReleaseVelocity(AbstractPush):
    """The mechanism starts with a speed of the joints that `on` names, or of its first joint where that is the world.

    All other joints start as slowly as the loops allow.  A start that is known to move adds its own rates.
    """

    kind = "release_velocity"
    acts_on = "world"
    odds = 0.5
    rad_per_s: Float[Array, ""] = parameter("rad/s", "of a turning joint", joint_types=TURNING, expected=0.1)
    m_per_s: Float[Array, ""] = parameter("m/s", "of a sliding joint", joint_types=("prismatic",), expected=0.1)

    def speed(self, turning):
        """The one that fits the joint."""
        return jnp.where(turning, self.rad_per_s, self.m_per_s)
