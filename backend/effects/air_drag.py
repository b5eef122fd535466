"""Fast flow of air about a body: a force that grows with the square of its speed."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from backend.effects.effect import BodyView, Wrench, parameter
from backend.effects.shapes import AbstractDrag

AIR_DENSITY_KG_PER_M3 = 1.225  # ISO 2533 standard atmosphere, sea level
STILL_M_PER_S = 1.0e-9  # keeps the speed's slope finite at rest
STATIONS, WEIGHTS = np.polynomial.legendre.leggauss(4)  # 1% off in the couple on a bar that spins about its middle


class AirDrag(AbstractDrag):
    """Force = -½ρ (drag area) |v| v at the centre of mass, or spread along a bar; drag area is C_d x frontal area.

    A bar feels it evenly along its length, and hardly along itself: by the cross-flow principle (Hoerner, Fluid-Dynamic
    Drag, 1965, ch. 3) only the velocity across the bar counts.
    """

    kind = "air_drag"
    acts_on = "body"
    odds = 0.5
    drag_area_m2: Float[Array, ""] = parameter(
        "m^2", "drag coefficient x frontal area", lower=0.0, expected=0.05,
        # Where ½ρ A v² is the body's weight at the mechanism's own speed: a light link feels a small area.
        natural_unit="kg/m", typical=2.0 / AIR_DENSITY_KG_PER_M3,
    )  # fmt: skip
    half_length_m: Float[Array, ""] = parameter(
        "m", "how far it is spread to both sides of the centre of mass, along the body's joints", lower=0.0,
        by_name=True, expected=0.5, tries=(0.5,), late=True,
    )  # fmt: skip
    slip: Float[Array, ""] = parameter(
        "1", "share of the velocity along the body's joints that the air does not hold", lower=0.0, upper=1.0,
        by_name=True, expected=1.0, tries=(0.5,), late=True,
    )  # fmt: skip

    def wrench(self, body: BodyView) -> Wrench:
        """Summed by Gauss's rule along the body, whose points move by middle + station x turning."""
        along = body.R_WB @ body.along_B
        half = self.half_length_m * body.part
        middle = body.v_WC - self.slip * (body.v_WC @ along) * along
        turning = half * jnp.cross(body.w_WB_W, along)  # across the body: nothing of it slips
        squares = middle @ middle + 2.0 * STATIONS * (middle @ turning) + STATIONS**2 * (turning @ turning)
        speed = WEIGHTS * jnp.sqrt(jnp.maximum(squares, 0.0) + STILL_M_PER_S**2)
        every, first, second = jnp.sum(speed), speed @ STATIONS, speed @ STATIONS**2
        size = -0.25 * AIR_DENSITY_KG_PER_M3 * self.drag_area_m2
        force = size * (every * middle + first * turning)
        return Wrench(force, size * half * jnp.cross(along, first * middle + second * turning))
