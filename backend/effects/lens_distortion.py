"""A lens that bends straight lines."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from backend.effects.effect import parameter
from backend.effects.shapes import AbstractView


class LensDistortion(AbstractView):
    """Radial distortion about the picture's middle: r becomes r (1 + k1 r² + k2 r⁴) (Brown 1966)."""

    kind = "lens_distortion"
    acts_on = "camera"
    k1: Float[Array, ""] = parameter(
        "1/m^2", "relative displacement per squared distance from the middle of what is drawn", expected=5e-3
    )
    k2: Float[Array, ""] = parameter("1/m^4", "and per its fourth power", expected=5e-4)
    aim_right_m: Float[Array, ""] = parameter(
        "m", "where the line of sight meets the picture, right of the middle of what is drawn", by_name=True,
        expected=0.5, tries=(0.0,),
    )  # fmt: skip
    aim_down_m: Float[Array, ""] = parameter("m", "and below it", by_name=True, expected=0.5, tries=(0.0,))

    def view(self, sight, camera):
        """Across the line of sight only."""
        p = sight.p_WP - camera.aimed(self.aim_right_m, self.aim_down_m)
        radial = p - jnp.sum(p * camera.axis, -1, keepdims=True) * camera.axis
        square = jnp.sum(radial**2, -1, keepdims=True)
        return sight.p_WP + (self.k1 * square + self.k2 * square**2) * radial
