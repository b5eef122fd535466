"""A motor's rotor behind its gear, felt at the joint."""

from jaxtyping import Array, Float

from backend.effects.effect import TURNING, parameter
from backend.effects.shapes import AbstractJointInertia


class RotorInertia(AbstractJointInertia):
    """Inertia against the joint's acceleration: rotor inertia x (gear ratio)², at the joint."""

    kind = "rotor_inertia"
    acts_on = "joint"
    odds = 0.3
    kg_m2: Float[Array, ""] = parameter(
        "kg m^2", "rotor inertia felt at the joint", lower=0.0, joint_types=TURNING, expected=0.05
    )

    def inertia(self):
        """About the joint's axis."""
        return self.kg_m2
