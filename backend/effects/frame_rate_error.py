"""A camera whose frames come faster or slower than its file says."""

from jaxtyping import Array, Float

from backend.effects.effect import parameter
from backend.effects.shapes import AbstractClock


class FrameRateError(AbstractClock):
    """True frame rate = (1 + relative) x the stated one."""

    kind = "frame_rate_error"
    acts_on = "camera"
    relative: Float[Array, ""] = parameter("1", "true frame rate / stated rate - 1", lower=-0.9, expected=0.01)

    def true_time(self, time_s):
        """Frames that come faster span less time."""
        return time_s / (1 + self.relative)
