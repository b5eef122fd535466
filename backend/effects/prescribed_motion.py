"""A joint driven along a known path, whatever force that takes."""

from jaxtyping import Array, Float

from backend.effects.effect import parameter
from backend.effects.shapes import AbstractJointMotion


class PrescribedMotion(AbstractJointMotion):
    """q follows its value; recorded as an input it follows the record, joined smoothly between samples."""

    kind = "prescribed_motion"
    acts_on = "joint"
    q: Float[Array, ""] = parameter("rad or m", "the joint's coordinate", drive="end")

    def target(self):
        """As declared."""
        return self.q
