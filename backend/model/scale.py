"""The natural size of a parameter in a mechanism, from the mechanism's own mass, length and gravity."""

import re

import equinox as eqx
from jaxtyping import Array, Float

STANDARD_GRAVITY = 9.80665  # m/s², for mechanisms drawn without weight
DIMENSIONS = {  # exponents of kg, m, s
    "1": (0, 0, 0),
    "rad": (0, 0, 0),
    "m": (0, 1, 0),
    "kg": (1, 0, 0),
    "s": (0, 0, 1),
    "Hz": (0, 0, -1),
    "N": (1, 1, -2),
    "J": (1, 2, -2),
}


class Scale(eqx.Module):
    """Typical mass [kg] of a moving body, size [m] of the mechanism, and free fall [m/s²].

    Array leaves, so that drawings of one topology and other sizes share one compiled program.
    """

    mass_kg: Float[Array, ""]
    length_m: Float[Array, ""]
    gravity_m_per_s2: Float[Array, ""]

    @property
    def time_s(self) -> float:
        """√(length / gravity)."""
        return float(self.length_m / self.gravity_m_per_s2) ** 0.5

    def of(self, unit: str) -> float:
        """The size that a quantity of this unit has here, e.g. 'N m s/rad' -> m g L x √(L/g)."""
        size = 1.0
        for sign, part in zip((1, -1), (unit.split(" or ")[0] + "/1").split("/")[:2], strict=True):
            for symbol, power in re.findall(r"([A-Za-z1]+)\^?(\d?)", part):
                kg, m, s = DIMENSIONS[symbol]
                base = float(self.mass_kg) ** kg * float(self.length_m) ** m * self.time_s**s
                size *= base ** (sign * int(power or 1))
        return size
