"""The natural size of a parameter in a mechanism, from the mechanism's own mass, length and gravity."""

import re

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from backend.mechanism.mechanism import Mechanism
from backend.model.lengthwise import held_points

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
        return (float(self.length_m) / float(self.gravity_m_per_s2)) ** 0.5

    def of(self, unit: str) -> float:
        """The size that a quantity of this unit has here, e.g. 'N m s/rad' -> m g L x √(L/g)."""
        size = 1.0
        for sign, part in zip((1, -1), (unit.split(" or ")[0] + "/1").split("/")[:2], strict=True):
            for symbol, power in re.findall(r"([A-Za-z1]+)\^?(\d?)", part):
                kg, m, s = DIMENSIONS[symbol]
                base = float(self.mass_kg) ** kg * float(self.length_m) ** m * self.time_s**s
                size *= base ** (sign * int(power or 1))
        return size


def scale_of(mechanism: Mechanism, moving: list[str]) -> Scale:
    """Means over the moving bodies: of their masses, and of the distances between the points that hold them."""
    inertials = [mechanism.body(id_).inertial for id_ in moving]
    masses = [i.mass_kg for i in inertials if i]
    lengths = []
    for points in held_points(mechanism).values():
        lengths += [float(np.linalg.norm(p - points[0][0])) for p, _ in points[1:]]
    gyration = [np.sqrt(np.trace(i.inertia_kg_m2.matrix()) / i.mass_kg) for i in inertials if i]
    long = [length for length in lengths if length > 1e-6] or gyration
    gravity = float(np.linalg.norm(mechanism.gravity_m_per_s2)) or STANDARD_GRAVITY
    return Scale(jnp.asarray(np.mean(masses)), jnp.asarray(np.mean(long)), jnp.asarray(gravity))
