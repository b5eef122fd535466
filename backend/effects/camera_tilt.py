"""A camera that does not face the plane of motion."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from backend.effects.effect import parameter
from backend.effects.shapes import AbstractView

FAR = 3.0  # extents of the mechanism from which a lens of 40° sees a picture that is two extents high
GUESS = 0.35  # of that distance, one sd: phones stand at two, long lenses at five
AFAR = ("distance_m", GUESS)  # what is seen of a tilt is its share of the distance


class CameraTilt(AbstractView):
    """The camera leans about the picture's middle (keystone): what comes nearer is reported larger.

    Points turn about the middle of what is drawn, by pitch, then yaw, and are projected from the camera's distance; at
    zero every point is reported where it is, whatever its depth.
    """

    kind = "camera_tilt"
    acts_on = "camera"
    pitch_rad: Float[Array, ""] = parameter("rad", "about the picture's horizontal", expected=0.05, rests_on=AFAR)
    yaw_rad: Float[Array, ""] = parameter("rad", "about the picture's vertical", expected=0.05, rests_on=AFAR)
    distance_m: Float[Array, ""] = parameter(
        "m", "from the camera to the mechanism; 0: three times the extent of what is drawn", lower=0.0, by_name=True,
        expected=1.5, tries=(FAR,), late=True,
    )  # fmt: skip
    aim_right_m: Float[Array, ""] = parameter(
        "m", "where the line of sight meets the picture, right of the middle of what is drawn", by_name=True,
        expected=0.5, tries=(0.0,),
    )  # fmt: skip
    aim_down_m: Float[Array, ""] = parameter("m", "and below it", by_name=True, expected=0.5, tries=(0.0,))

    def view(self, sight, camera):
        """Turn in the camera's axes (right, down, along), then divide by the depth gained."""
        axes = jnp.stack([camera.right, camera.down, camera.axis])
        drawn = (sight.p_WP - camera.aimed(self.aim_right_m, self.aim_down_m)) @ axes.T
        x, y, z = jnp.moveaxis(drawn, -1, 0)
        cos, sin = jnp.cos(self.pitch_rad), jnp.sin(self.pitch_rad)
        turned_y, deep = cos * y - sin * z, sin * y + cos * z
        cos, sin = jnp.cos(self.yaw_rad), jnp.sin(self.yaw_rad)
        turned_x, deep = cos * x + sin * deep, -sin * x + cos * deep
        distance = jnp.where(self.distance_m > 0, self.distance_m, FAR * camera.reach)
        nearer = distance / (distance + deep - z)
        seen = jnp.stack([nearer * turned_x, nearer * turned_y, z], -1)
        return sight.p_WP + (seen - drawn) @ axes
