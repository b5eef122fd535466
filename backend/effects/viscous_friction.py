"""Friction in proportion to a joint's rate: grease, bearings, eddy currents."""

from jaxtyping import Array, Float

from backend.effects.effect import TURNING, parameter
from backend.effects.shapes import AbstractJointDamping


class ViscousFriction(AbstractJointDamping):
    """Effort = -damping x rate."""

    kind = "viscous_friction"
    acts_on = "joint"
    damping_n_m_s_per_rad: Float[Array, ""] = parameter(
        "N m s/rad", "torque per rate of turn", lower=0.0, joint_types=TURNING, expected=0.05
    )
    damping_n_s_per_m: Float[Array, ""] = parameter(
        "N s/m", "force per rate of travel", lower=0.0, joint_types=("prismatic",), expected=0.05
    )

    def damping(self):
        """The one that fits the joint; the other is zero."""
        return self.damping_n_m_s_per_rad + self.damping_n_s_per_m
