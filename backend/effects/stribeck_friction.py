"""Dry friction that is larger before sliding than during it: greased slides, brakes, bowed strings."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from backend.effects.effect import SLIDING, TURNING, parameter
from backend.effects.shapes import AbstractRateFriction


class StribeckFriction(AbstractRateFriction):
    """Effort against sliding that falls from a static to a sliding level: F_c + (F_s - F_c) exp(-(v / v_s)²).

    Armstrong-Hélouvry, Dupont and Canudas de Wit (1994), section 2.2, with exponent 2.  The bounds on v_s keep it above
    the rate at which dry friction holds (`STICK_RATE`), where a joint at rest would count as sliding.
    """

    kind = "stribeck_friction"
    acts_on = "joint"
    odds = 0.3
    static_torque_n_m: Float[Array, ""] = parameter(
        "N m",
        "torque at which turning begins",
        lower=0.0,
        joint_types=TURNING,
        at_least="friction_torque_n_m",
        expected=0.05,
    )
    friction_torque_n_m: Float[Array, ""] = parameter(
        "N m", "sliding torque", lower=0.0, joint_types=TURNING, expected=0.05
    )
    stribeck_velocity_rad_per_s: Float[Array, ""] = parameter(
        "rad/s", "speed over which it falls", default=0.1, lower=1e-4, joint_types=TURNING,
        expected=0.3, tries=(0.1,),
    )  # fmt: skip
    static_force_n: Float[Array, ""] = parameter(
        "N", "force at which sliding begins", lower=0.0, joint_types=SLIDING, at_least="friction_force_n", expected=0.05
    )
    friction_force_n: Float[Array, ""] = parameter("N", "sliding force", lower=0.0, joint_types=SLIDING, expected=0.05)
    stribeck_velocity_m_per_s: Float[Array, ""] = parameter(
        "m/s", "speed over which it falls", default=0.01, lower=1e-5, joint_types=SLIDING,
        expected=0.3, tries=(0.1,),
    )  # fmt: skip

    presliding_rad: Float[Array, ""] = parameter(
        "rad", "turn by which it gives before it slides", lower=0.0, upper=0.01, joint_types=TURNING,
        typical=1e-3, by_name=True, expected=1.0, tries=(0.5,),
    )  # fmt: skip
    onset_rad_per_s: Float[Array, ""] = parameter(
        "rad/s", "rate at which it reaches 71% of its size", lower=0.0, upper=0.05, joint_types=TURNING,
        typical=1e-3, by_name=True, expected=1.0, tries=(0.5,), late=True,
    )  # fmt: skip
    presliding_m: Float[Array, ""] = parameter(
        "m", "travel by which it gives before it slides", lower=0.0, upper=1e-3, joint_types=SLIDING,
        typical=1e-4, by_name=True, expected=1.0, tries=(0.5,),
    )  # fmt: skip
    onset_m_per_s: Float[Array, ""] = parameter(
        "m/s", "rate at which it reaches 71% of its size", lower=0.0, upper=0.01, joint_types=SLIDING,
        typical=1e-3, by_name=True, expected=1.0, tries=(0.5,), late=True,
    )  # fmt: skip

    def limit(self, rate):
        """Torque level plus force level: a joint has only one of them."""
        turning = _level(self.static_torque_n_m, self.friction_torque_n_m, rate / self.stribeck_velocity_rad_per_s)
        sliding = _level(self.static_force_n, self.friction_force_n, rate / self.stribeck_velocity_m_per_s)
        return turning + sliding

    def presliding(self):
        """A joint has only one of them."""
        return self.presliding_rad + self.presliding_m

    def onset(self):
        """Alike."""
        return self.onset_rad_per_s + self.onset_m_per_s


def _level(static: Array, kinetic: Array, relative: Array) -> Array:
    return kinetic + (static - kinetic) * jnp.exp(-(relative**2))
