"""Weight.  A drawing gives it as `gravity_m_per_s2`, not in its list of effects."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from backend.effects.effect import Wrench, parameter
from backend.effects.shapes import AbstractBodyForce


class Gravity(AbstractBodyForce):
    """Mass x gravity at every body's centre of mass."""

    kind = "gravity"
    acts_on = "world"
    gravity_m_per_s2: Float[Array, "3"] = parameter("m/s^2", "acceleration of free fall, in W", size=3)

    def wrench(self, a, b):
        """No torque about the centre of mass; the world feels nothing worth counting."""
        return Wrench(a.mass * self.gravity_m_per_s2), None

    def potential(self, a, b):
        """-m g·p, zero at the world's origin."""
        return -a.mass * jnp.sum(self.gravity_m_per_s2 * a.p_WC)
