"""A part whose centre of mass is not where it was drawn."""

from jaxtyping import Array, Float

from backend.effects.effect import parameter
from backend.effects.shapes import AbstractDrawnError


class CenterOfMassError(AbstractDrawnError):
    """Same mass and same inertia about the centre of mass, which lies elsewhere."""

    kind = "center_of_mass_error"
    acts_on = "body"
    shared = False
    offset_m: Float[Array, "3"] = parameter("m", "true minus drawn, in body axes", size=3, expected=0.02)

    def redraw(self, drawing, place):
        """Move the centre; joints and markers stay."""
        return drawing.with_body(place, center_of_mass=drawing.center_of_mass[place] + self.offset_m)
