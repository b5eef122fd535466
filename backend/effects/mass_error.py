"""A part heavier or lighter than drawn."""

from jaxtyping import Array, Float

from backend.effects.effect import parameter
from backend.effects.shapes import AbstractDrawnError


class MassError(AbstractDrawnError):
    """Same shape, other density: mass and inertia grow together."""

    kind = "mass_error"
    acts_on = "body"
    relative: Float[Array, ""] = parameter("1", "true mass / drawn mass - 1", lower=-0.95, expected=0.1)

    def redraw(self, drawing, place):
        """Scale mass and inertia."""
        return drawing.with_body(
            place,
            mass=drawing.mass[place] * (1 + self.relative),
            inertia=drawing.inertia[place] * (1 + self.relative),
        )
