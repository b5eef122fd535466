"""Dry friction of constant size: seals, preloaded bearings, ball screws."""

from jaxtyping import Array, Float

from backend.effects.effect import TURNING, parameter
from backend.effects.shapes import AbstractDryFriction


class CoulombFriction(AbstractDryFriction):
    """Effort of constant size against sliding; holds up to the same size at rest."""

    kind = "coulomb_friction"
    acts_on = "joint"
    friction_torque_n_m: Float[Array, ""] = parameter(
        "N m", "sliding torque", lower=0.0, joint_types=TURNING, expected=0.05
    )
    friction_force_n: Float[Array, ""] = parameter(
        "N", "sliding force", lower=0.0, joint_types=("prismatic",), expected=0.05
    )
    presliding_rad: Float[Array, ""] = parameter(
        "rad", "turn by which it gives before it slides", lower=0.0, upper=0.01, joint_types=TURNING,
        typical=1e-3, by_name=True, expected=1.0, tries=(0.5,),
    )  # fmt: skip
    onset_rad_per_s: Float[Array, ""] = parameter(
        "rad/s", "rate at which it reaches 71% of its size", lower=0.0, upper=0.05, joint_types=TURNING,
        typical=1e-3, by_name=True, expected=1.0, tries=(0.5,), late=True,
    )  # fmt: skip
    presliding_m: Float[Array, ""] = parameter(
        "m", "travel by which it gives before it slides", lower=0.0, upper=1e-3, joint_types=("prismatic",),
        typical=1e-4, by_name=True, expected=1.0, tries=(0.5,),
    )  # fmt: skip
    onset_m_per_s: Float[Array, ""] = parameter(
        "m/s", "rate at which it reaches 71% of its size", lower=0.0, upper=0.01, joint_types=("prismatic",),
        typical=1e-3, by_name=True, expected=1.0, tries=(0.5,), late=True,
    )  # fmt: skip

    def limit(self, load, pin_radius):
        """The same under any load."""
        return self.friction_torque_n_m + self.friction_force_n

    def presliding(self):
        """A joint has only one of them."""
        return self.presliding_rad + self.presliding_m

    def onset(self):
        """Alike."""
        return self.onset_rad_per_s + self.onset_m_per_s
