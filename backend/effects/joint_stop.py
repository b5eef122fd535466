"""Ends of a joint's travel that it cannot pass."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from backend.effects.effect import parameter
from backend.effects.shapes import AbstractJointStop, Wall

NO_STOP = 1.0e3  # rad or m: out of reach of any linkage, yet a finite number for the barrier
HARD_STEEL = 0.9  # restitution of hardened steel at low speed: where a drawing says nothing, up to this


class JointStop(AbstractJointStop):
    """Rigid ends; a blow keeps the share `restitution` of its speed."""

    kind = "joint_stop"
    acts_on = "joint"
    lower: Float[Array, ""] = parameter("rad or m", "lowest q", default=-NO_STOP, expected=1.0)
    upper: Float[Array, ""] = parameter("rad or m", "highest q", default=NO_STOP, expected=1.0)
    restitution: Float[Array, ""] = parameter(
        "1", "speed after over speed before a blow", lower=0.0, upper=1.0, by_name=True, unstated=HARD_STEEL
    )

    def ends(self):
        """As declared."""
        return self.lower, self.upper

    def wall(self):
        """Smooth and rigid."""
        return Wall(jnp.zeros_like(self.restitution), jnp.zeros_like(self.restitution), self.restitution)
