"""Ends of a joint's travel that it cannot pass."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from backend.effects.effect import SLIDING, TURNING, parameter
from backend.effects.shapes import AbstractJointStop, Wall

NO_STOP = 1.0e3  # rad or m: out of reach of any linkage, yet a finite number for the barrier
HARD_STEEL = 0.9  # restitution of hardened steel at low speed: where a drawing says nothing, up to this
RIGID = 1e15  # N m/rad or N/m: a blow of 100 kN presses it in by less than a nanometre
SOFT = 1e3  # weights times lengths a radian, or weights a length: what falls through one is caught within 4% of it


class JointStop(AbstractJointStop):
    """Ends that hold, rigid unless a stiffness is given; a blow keeps the share `restitution` of its speed."""

    kind = "joint_stop"
    acts_on = "joint"
    shared = False
    lower: Float[Array, ""] = parameter("rad or m", "lowest q", default=-NO_STOP, expected=1.0)
    upper: Float[Array, ""] = parameter("rad or m", "highest q", default=NO_STOP, expected=1.0)
    restitution: Float[Array, ""] = parameter(
        "1", "speed after over speed before a blow", lower=0.0, upper=1.0, by_name=True, unstated=HARD_STEEL
    )
    stiffness_n_m_per_rad: Float[Array, ""] = parameter(
        "N m/rad", "torque over how far an end gives way; the default is rigid", default=RIGID, lower=1e-3,
        joint_types=TURNING, by_name=True, unstated=SOFT, unstated_is_natural=True,
    )  # fmt: skip
    stiffness_n_per_m: Float[Array, ""] = parameter(
        "N/m", "force over how far an end gives way; the default is rigid", default=RIGID, lower=1e-3,
        joint_types=SLIDING, by_name=True, unstated=SOFT, unstated_is_natural=True,
    )  # fmt: skip

    def ends(self):
        """As declared."""
        return self.lower, self.upper

    def wall(self):
        """Smooth."""
        give = 1.0 / self.stiffness_n_m_per_rad + 1.0 / self.stiffness_n_per_m
        return Wall(jnp.zeros_like(self.restitution), give, self.restitution)
