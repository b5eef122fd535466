"""A tracker that slides off its marker."""

from jaxtyping import Array, Float

from backend.effects.effect import parameter
from backend.effects.shapes import AbstractView, across


class TrackerDrift(AbstractView):
    """The tracker slides off the marker in proportion to time since the record's first sample, where it was put on it.

    It drifts along the two world axes across the line of sight, before the release as after it.
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
