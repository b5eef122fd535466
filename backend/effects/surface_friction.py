"""Dry friction of a body that lies on the bed."""

from jaxtyping import Array, Float

from backend.effects.effect import parameter
from backend.effects.shapes import AbstractBedFriction


class SurfaceFriction(AbstractBedFriction):
    """Dry friction of a body that slides on the bed under its own weight alone; no other body rests on it."""

    kind = "surface_friction"
    acts_on = "body"
    odds = 0.1
    friction_coefficient: Float[Array, ""] = parameter(
        "1",
        "friction force over the force on the bed, half of the body's weight at each of two pads, (√3/2) radii of "
        "gyration to either side of its centre of mass along its length",
        lower=0.0,
        expected=0.2,
    )

    def coefficient(self):
        """As declared."""
        return self.friction_coefficient
