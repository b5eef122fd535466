"""A wrong ruler: every position is reported too large or too small."""

from jaxtyping import Array, Float

from backend.effects.effect import parameter
from backend.effects.shapes import AbstractView


class CameraScale(AbstractView):
    """Reported = (1 + relative) x true, from the world's origin."""

    kind = "camera_scale"
    acts_on = "camera"
    relative: Float[Array, ""] = parameter("1", "reported length / true length - 1", lower=-0.9, expected=0.01)

    def view(self, sight, camera):
        """Scale about the origin."""
        return (1 + self.relative) * sight.p_WP
