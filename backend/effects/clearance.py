"""A pin that is thinner than its hole."""

import equinox as eqx
from jaxtyping import Array, Float

from backend.effects.effect import choice, parameter
from backend.effects.shapes import AbstractJointClearance, Wall

RIGID = 1e10  # N/m: 100 N press it in by 10 nm

# Where a drawing says nothing of its walls they may be anything that one makes pins and holes of.
RUBBER = 1e5  # N/m: a bush of rubber, or thin printed plastic
HARD_STEEL = 0.9  # restitution of hardened steel at low speed
DRY = 0.5  # Coulomb coefficient of unlike metals or plastics without grease


class Clearance(AbstractJointClearance):
    """The pin, thinner than its hole, moves inside it, strikes its wall and rubs along it."""

    kind = "clearance"
    acts_on = "joint"
    radial_m: Float[Array, ""] = parameter(
        "m", "half the difference of hole and pin diameter", default=None, lower=0.0, drawn="clearance_m",
        joint_types=("revolute",), typical=1e-3, expected=3.0,
    )  # fmt: skip
    friction_coefficient: Float[Array, ""] = parameter(
        "1", "Coulomb coefficient between pin and hole; acts at the point of contact", lower=0.0,
        joint_types=("revolute",), by_name=True, unstated=DRY,
    )  # fmt: skip
    stiffness_n_per_m: Float[Array, ""] = parameter(
        "N/m", "normal force over penetration of the wall; the default is rigid", default=RIGID, lower=1.0,
        joint_types=("revolute",), by_name=True, unstated=RUBBER,
    )  # fmt: skip
    restitution: Float[Array, ""] = parameter(
        "1", "speed after over speed before an impact", lower=0.0, upper=1.0, joint_types=("revolute",), by_name=True,
        unstated=HARD_STEEL,
    )  # fmt: skip
    bearing_length_m: Float[Array, ""] = parameter(
        "m", "distance of two rings that hold the pin, which then tilts between them; 0: it stays parallel", lower=0.0,
        joint_types=("revolute",), by_name=True,
    )  # fmt: skip
    shape: str = choice("circle", "rectangle", doc="outline in which the pin's axis moves; a rectangle bounds x and y")
    rings: int = eqx.field(static=True, default=1)

    @classmethod
    def structure(cls, parameters):
        """Two rings where a bearing's length is given."""
        length = parameters.get("bearing_length_m", 0.0)
        return {**super().structure(parameters), "rings": 2 if length > 0 else 1}

    def radius(self):
        """As declared."""
        return self.radial_m

    def bearing_length(self):
        """As declared."""
        return self.bearing_length_m

    def wall(self):
        """As declared."""
        return Wall(self.friction_coefficient, 1.0 / self.stiffness_n_per_m, self.restitution)
