"""A tracker that slides off its marker."""

from jaxtyping import Array, Float

from backend.effects.effect import parameter
from backend.effects.shapes import AbstractView, across


class TrackerDrift(AbstractView):
    """The tracker slides off the marker in the course of time, along the two world axes across the line of sight.

    It is right in the first frame, where it was put on the marker.
    """

    kind = "tracker_drift"
    acts_on = "marker"
    x_m_per_s: Float[Array, ""] = parameter(
        "m/s", "along the first: x of the world, y where the joints turn about x", expected=2e-3
    )
    z_m_per_s: Float[Array, ""] = parameter(
        "m/s", "along the second: z of the world, y where the joints turn about z", expected=2e-3
    )

    def view(self, sight, camera):
        """In proportion to time."""
        first, second = across(camera.axis)
        since = (sight.time_s - sight.began_s)[..., None]
        return sight.p_WP + since * (self.x_m_per_s * first + self.z_m_per_s * second)
