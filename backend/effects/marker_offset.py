"""A marker that was glued on elsewhere."""

from jaxtyping import Array, Float

from backend.effects.effect import parameter
from backend.effects.shapes import AbstractMarkerError, across


class MarkerOffset(AbstractMarkerError):
    """A marker sits elsewhere on its body than drawn, along the two body axes that lie across the line of sight."""

    kind = "marker_offset"
    acts_on = "marker"
    dx_m: Float[Array, ""] = parameter(
        "m", "along the first: x of the body, y where its joints turn about x", expected=0.01
    )
    dy_m: Float[Array, ""] = parameter(
        "m", "along the second: y of the body, z where its joints do not turn about z", expected=0.01
    )

    def moved(self, p_BM, axis_B):
        """In body axes."""
        first, second = across(axis_B)
        return p_BM + self.dx_m * first + self.dy_m * second
