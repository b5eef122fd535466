"""A latch that opens late."""

from jaxtyping import Array, Float

from backend.effects.effect import parameter
from backend.effects.shapes import AbstractHold


class LateRelease(AbstractHold):
    """The mechanism is held until `delay_s` after the stated release; frames before it are still.

    Recorded inputs, a shaking base and the camera keep the stated clock.  A simulated run counts from the true release.
    """

    kind = "late_release"
    acts_on = "world"
    delay_s: Float[Array, ""] = parameter("s", "true minus stated release", lower=0.0, expected=0.1)

    def delay(self):
        """As declared."""
        return self.delay_s
