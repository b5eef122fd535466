"""Fast flow of air about a body: a force that grows with the square of its speed."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from backend.effects.effect import BodyView, Wrench, parameter
from backend.effects.shapes import AbstractDrag

AIR_DENSITY_KG_PER_M3 = 1.225  # ISO 2533 standard atmosphere, sea level
STILL_M_PER_S = 1.0e-9  # keeps the speed's slope finite at rest
STATIONS = 4  # 1% off in the couple on a bar that spins about its middle
RULE = tuple(zip(*map(np.ndarray.tolist, np.polynomial.legendre.leggauss(STATIONS)), strict=True))  # stations, weights


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
        """Summed by Gauss's rule along the body, whose points move by middle + station x turning, all in B.

        Written as sums of products, so that XLA fuses them: these are a fifth of the work of all slopes otherwise.
        """
        along, half = body.along_B, self.half_length_m * body.part
        v_WC_B = jnp.sum(body.R_WB * body.v_WC[:, None], 0)
        middle = v_WC_B - self.slip * _dot(v_WC_B, along) * along
        turning = half * jnp.cross(body.w_WB_B, along)  # across the body: nothing of it slips
        both, spin = 2.0 * _dot(middle, turning), _dot(turning, turning)
        still = _dot(middle, middle) + STILL_M_PER_S**2
        # A sum of squares, but for its rounding.
        speeds = [w * jnp.sqrt(jnp.maximum(still + s * both + s**2 * spin, STILL_M_PER_S**2)) for s, w in RULE]
        every, first, second = (sum(s**power * v for (s, _), v in zip(RULE, speeds, strict=True)) for power in range(3))
        size = -0.25 * AIR_DENSITY_KG_PER_M3 * self.drag_area_m2
        force_B = size * (every * middle + first * turning)
        torque_B = size * half * jnp.cross(along, first * middle + second * turning)
        return Wrench(jnp.sum(body.R_WB * force_B, -1), torque_B=torque_B)


def _dot(a: Float[Array, "3"], b: Float[Array, "3"]) -> Float[Array, ""]:
    return jnp.sum(a * b)
