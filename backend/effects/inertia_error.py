"""A part whose mass is spread otherwise than drawn."""

from jaxtyping import Array, Float

from backend.effects.effect import parameter
from backend.effects.shapes import AbstractDrawnError


class InertiaError(AbstractDrawnError):
    """Same mass and centre; the whole inertia tensor about the centre of mass is larger by one factor."""

    kind = "inertia_error"
    acts_on = "body"
    relative: Float[Array, ""] = parameter("1", "true inertia / drawn inertia - 1", lower=-0.95, expected=0.1)

    def redraw(self, drawing, place):
        """Scale the inertia tensor."""
        return drawing.with_body(place, inertia=drawing.inertia[place] * (1 + self.relative))
