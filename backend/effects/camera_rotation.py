"""A camera turned about its line of sight."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from backend.effects.effect import parameter
from backend.effects.shapes import AbstractView


class CameraRotation(AbstractView):
    """Every point is reported turned about the line of sight through the world's origin."""

    kind = "camera_rotation"
    acts_on = "camera"
    rad: Float[Array, ""] = parameter(
        "rad", "turn of the picture about the axis of the joints, right-handed", expected=0.02
    )

    def view(self, sight, camera):
        """Rodrigues' turn of p about the axis."""
        p_WP, axis = sight.p_WP, camera.axis
        along = jnp.sum(p_WP * axis, -1, keepdims=True) * axis
        across = p_WP - along
        return along + jnp.cos(self.rad) * across + jnp.sin(self.rad) * jnp.cross(axis, across)
