"""A known twist on a body: a motor's torque."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from backend.effects.effect import Wrench, parameter
from backend.effects.shapes import AbstractBodyForce


class AppliedTorque(AbstractBodyForce):
    """Torque about an axis fixed in W on the first body; the second takes the reaction."""

    kind = "applied_torque"
    acts_on = "bodies"
    torque_n_m: Float[Array, ""] = parameter("N m", "size of the twist", drive="mean")
    axis: Float[Array, "3"] = parameter(
        "1", "about which axis, in W (made a unit vector)", default=None, size=3, by_name=True
    )

    def wrench(self, a, b):
        """Pure torques."""
        torque = self.torque_n_m * self.axis / jnp.linalg.norm(self.axis)
        return Wrench(jnp.zeros(3), torque), Wrench(jnp.zeros(3), -torque)

    def potential(self, a, b):
        """None: it is a drive."""
        return jnp.zeros(())
