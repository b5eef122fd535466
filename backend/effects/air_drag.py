"""Fast flow of air about a body: a force that grows with the square of its speed."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from backend.effects.effect import Wrench, parameter
from backend.effects.shapes import AbstractDrag

AIR_DENSITY_KG_PER_M3 = 1.225  # ISO 2533 standard atmosphere, sea level
STILL_M_PER_S = 1.0e-9  # keeps the speed's slope finite at rest


class AirDrag(AbstractDrag):
    """Force = -½ρ (drag area) |v| v at the centre of mass; drag area is C_d x frontal area."""

    kind = "air_drag"
    acts_on = "body"
    odds = 0.5
    drag_area_m2: Float[Array, ""] = parameter(
        "m^2", "drag coefficient x frontal area", lower=0.0, expected=0.05,
        # Where ½ρ A v² is the body's weight at the mechanism's own speed: a light link feels a small area.
        natural_unit="kg/m", typical=2.0 / AIR_DENSITY_KG_PER_M3,
    )  # fmt: skip

    def wrench(self, body):
        """No torque about the centre of mass."""
        speed = jnp.sqrt(jnp.sum(body.v_WC**2) + STILL_M_PER_S**2)
        return Wrench(-0.5 * AIR_DENSITY_KG_PER_M3 * self.drag_area_m2 * speed * body.v_WC)
