"""Dry friction of a pin in its hole: it grows with the force that the pin carries."""

from jaxtyping import Array, Float

from backend.effects.effect import parameter
from backend.effects.shapes import AbstractDryFriction


class PinFriction(AbstractDryFriction):
    """Torque limit = coefficient x pin radius x |radial reaction|."""

    kind = "pin_friction"
    acts_on = "joint"
    odds = 0.5
    friction_coefficient: Float[Array, ""] = parameter(
        "1", "Coulomb coefficient between pin and hole", lower=0.0, joint_types=("revolute",), expected=0.2
    )
    presliding_rad: Float[Array, ""] = parameter(
        "rad", "turn by which it gives before it slides", lower=0.0, upper=0.01, joint_types=("revolute",),
        typical=1e-3, by_name=True, expected=1.0, tries=(0.5,),
    )  # fmt: skip
    onset_rad_per_s: Float[Array, ""] = parameter(
        "rad/s", "rate at which it reaches 71% of its size", lower=0.0, upper=0.05, joint_types=("revolute",),
        typical=1e-3, by_name=True, expected=1.0, tries=(0.5,), late=True,
    )  # fmt: skip

    def limit(self, load, pin_radius):
        """In proportion to the load."""
        return self.friction_coefficient * pin_radius * load

    def presliding(self):
        """The same under any load."""
        return self.presliding_rad

    def onset(self):
        """The same under any load."""
        return self.onset_rad_per_s
