"""Slow flow about a body: a force against its velocity."""

from jaxtyping import Array, Float

from backend.effects.effect import Wrench, parameter
from backend.effects.shapes import AbstractDrag


class LinearDrag(AbstractDrag):
    """Force = -coefficient x velocity of the centre of mass, at the centre of mass."""

    kind = "linear_drag"
    acts_on = "body"
    odds = 0.3
    n_s_per_m: Float[Array, ""] = parameter("N s/m", "force per speed", lower=0.0, expected=0.05)

    def wrench(self, body):
        """No torque about the centre of mass."""
        return Wrench(-self.n_s_per_m * body.v_WC)
