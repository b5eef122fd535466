"""A link longer or shorter than drawn."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from backend.effects.effect import parameter
from backend.effects.shapes import AbstractDrawnError


class LengthError(AbstractDrawnError):
    """The link is stretched along its length at constant mass: pins, centre of mass, markers and inertia follow.

    Along its length only: a link stretched in all directions would lift its pins off the plane of motion and
    strain a closed loop that in truth fits.
    """

    kind = "length_error"
    acts_on = "body"
    relative: Float[Array, ""] = parameter("1", "true length / drawn length - 1", lower=-0.9, expected=0.01)

    def redraw(self, drawing, place):
        """Stretch by I + e u uᵀ; inertia through the second moment S = ½tr(J) I - J, which maps as F S Fᵀ."""
        along = drawing.length_axis[place]
        stretch = jnp.eye(3) + self.relative * jnp.outer(along, along)
        inertia = drawing.inertia[place]
        moment = stretch @ (0.5 * jnp.trace(inertia) * jnp.eye(3) - inertia) @ stretch.T
        return drawing.with_body(
            place,
            stretch=stretch @ drawing.stretch[place],
            inertia=jnp.trace(moment) * jnp.eye(3) - moment,
        )
