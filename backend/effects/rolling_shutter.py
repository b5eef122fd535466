"""A camera that exposes one row of a picture after another."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from backend.effects.effect import parameter
from backend.effects.shapes import AbstractShutter

HEIGHT = 2.0  # extents of the mechanism that a picture is high, where none is given
GUESS = 0.35  # of that height, one sd: people film from 1.2 to 3 extents high


class RollingShutter(AbstractShutter):
    """Rows are taken one after another, downwards; a picture's time is that of one of them, the middle one by default.

    Which row a camera's clock speaks of is seldom known, and a late clock is most of what a wrong one looks like.
    """

    kind = "rolling_shutter"
    acts_on = "camera"
    readout_s: Float[Array, ""] = parameter(
        "s", "from the first row to the last", lower=0.0, expected=0.1, rests_on=("height_m", GUESS)
    )
    height_m: Float[Array, ""] = parameter(
        "m", "of a picture, at the mechanism; 0: twice the extent of what is drawn", lower=0.0, by_name=True
    )

    stamped_row: Float[Array, ""] = parameter(
        "1", "whose time is stated: 0 the first, 1 the last; beyond these where the picture is higher than `height_m`",
        default=0.5, lower=-1.0, upper=2.0, by_name=True, proportional_to="readout_s", expected=0.3, tries=(0.5,),
    )  # fmt: skip

    def delay(self, sight, camera):
        """A point that moves down meets its row later: delay = pace (row + delay x speed downwards), and from the row
        whose time is stated instead of the middle one.
        """
        height = jnp.where(self.height_m > 0, self.height_m, HEIGHT * camera.reach)
        pace = self.readout_s / height
        row = (sight.p_WP - camera.center) @ camera.down
        since = pace * row + self.readout_s * (0.5 - self.stamped_row)
        return since / (1 - pace * (sight.v_WP @ camera.down))
