"""A known push at a point of a body: a hand, a weight on a string, a motor's thrust."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from backend.effects.effect import Wrench, parameter
from backend.effects.shapes import AbstractBodyForce


class AppliedForce(AbstractBodyForce):
    """Force along a direction fixed in W, at a point of the first body; the second takes the reaction."""

    kind = "applied_force"
    acts_on = "bodies"
    force_n: Float[Array, ""] = parameter("N", "size of the push", drive="mean")
    direction: Float[Array, "3"] = parameter(
        "1", "where to, in W (made a unit vector)", default=None, size=3, by_name=True
    )
    point_m: Float[Array, "3"] = parameter("m", "where, in the first body's axes", size=3, by_name=True)

    def wrench(self, a, b):
        """Equal and opposite at one point of space, so that no torque appears from nothing."""
        force = self.force_n * self.direction / jnp.linalg.norm(self.direction)
        p_WP = a.point(self.point_m)
        return (
            Wrench(force, jnp.cross(p_WP - a.p_WC, force)),
            Wrench(-force, -jnp.cross(p_WP - b.p_WC, force)),
        )

    def potential(self, a, b):
        """None: it is a drive."""
        return jnp.zeros(())
