"""A base that leans: gravity does not point where the drawing says."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from backend.effects.effect import parameter
from backend.effects.shapes import AbstractDrawnError


class GravityTilt(AbstractDrawnError):
    """The rig is turned about the world's x axis (roll), then y axis (pitch); W goes with the rig."""

    kind = "gravity_tilt"
    acts_on = "world"
    odds = 0.3
    roll_rad: Float[Array, ""] = parameter("rad", "turn of the rig about x", expected=0.02)
    pitch_rad: Float[Array, ""] = parameter("rad", "turn of the rig about y", expected=0.02)

    def redraw(self, drawing, place):
        """Gravity seen from the turned rig turns the other way."""
        x, y, z = drawing.gravity
        cos, sin = jnp.cos(self.pitch_rad), jnp.sin(self.pitch_rad)
        x, z = cos * x - sin * z, sin * x + cos * z
        cos, sin = jnp.cos(self.roll_rad), jnp.sin(self.roll_rad)
        y, z = cos * y + sin * z, -sin * y + cos * z
        return drawing.with_gravity(jnp.stack([x, y, z]))
