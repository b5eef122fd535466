"""A camera that exposes one row of a picture after another."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from backend.effects.effect import parameter
from backend.effects.shapes import AbstractShutter

HEIGHT = 2.0  # extents of the mechanism that a picture is high, where none is given


class RollingShutter(AbstractShutter):
    """Rows are taken one after another, downwards; a picture's time is that of its middle row."""

    kind = "rolling_shutter"
    acts_on = "camera"
    readout_s: Float[Array, ""] = parameter("s", "from the first row to the last", lower=0.0, expected=0.1)
    height_m: Float[Array, ""] = parameter(
        "m", "of a picture, at the mechanism; 0: twice the extent of what is drawn", lower=0.0, by_name=True
    )

    def delay(self, sight, camera):
        """A point that moves down meets its row later: delay = pace (row + delay x speed downwards)."""
        height = jnp.where(self.height_m > 0, self.height_m, HEIGHT * camera.reach)
        pace = self.readout_s / height
        row = (sight.p_WP - camera.center) @ camera.down
        return pace * row / (1 - pace * (sight.v_WP @ camera.down))
