"""Dry friction of a body that lies on the bed."""

from jaxtyping import Array, Float

from backend.effects.effect import parameter
from backend.effects.shapes import AbstractBedFriction


class SurfaceFriction(AbstractBedFriction):
    """Dry friction of a body that slides on the bed under its own weight."""

    kind = "surface_friction"
    acts_on = "body"
    odds = 0.1
    friction_coefficient: Float[Array, ""] = parameter(
        "1", "friction force over the force on the bed", lower=0.0, expected=0.2
    )

    def coefficient(self):
        """As declared."""
        return self.friction_coefficient
