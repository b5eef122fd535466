"""A spring wound about a hinge."""

from jaxtyping import Array, Float

from backend.effects.effect import TURNING, parameter
from backend.effects.shapes import AbstractJointEffort


class TorsionSpring(AbstractJointEffort):
    """Torque = -stiffness x (q - rest)."""

    kind = "torsion_spring"
    acts_on = "joint"
    odds = 0.3
    stiffness_n_m_per_rad: Float[Array, ""] = parameter(
        "N m/rad", "torque per turn", lower=0.0, joint_types=TURNING, expected=0.05
    )
    rest_rad: Float[Array, ""] = parameter(
        "rad",
        "q at which it pulls nowhere",
        joint_types=TURNING,
        proportional_to="stiffness_n_m_per_rad",
        expected=0.5,
        tries=(0.0,),
    )

    def effort(self, q):
        """Towards rest."""
        return -self.stiffness_n_m_per_rad * (q - self.rest_rad)

    def potential(self, q):
        """½ k (q - rest)²."""
        return 0.5 * self.stiffness_n_m_per_rad * (q - self.rest_rad) ** 2
