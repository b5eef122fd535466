"""A clock that starts at another moment than the motion's."""

from jaxtyping import Array, Float

from backend.effects.effect import parameter
from backend.effects.shapes import AbstractClock


class TimeOffset(AbstractClock):
    """True time = stated time + offset."""

    kind = "time_offset"
    acts_on = "camera"
    s: Float[Array, ""] = parameter("s", "true time - stated time", expected=0.1)

    def true_time(self, time_s):
        """Later by the offset."""
        return time_s + self.s
