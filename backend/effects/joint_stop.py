"""Ends of a joint's travel that it cannot pass."""

from jaxtyping import Array, Float

from backend.effects.effect import parameter
from backend.effects.shapes import AbstractJointStop

NO_STOP = 1.0e3  # rad or m: out of reach of any linkage, yet a finite number for the barrier


class JointStop(AbstractJointStop):
    """Rigid, inelastic ends."""

    kind = "joint_stop"
    acts_on = "joint"
    lower: Float[Array, ""] = parameter("rad or m", "lowest q", default=-NO_STOP)
    upper: Float[Array, ""] = parameter("rad or m", "highest q", default=NO_STOP)

    def ends(self):
        """As declared."""
        return self.lower, self.upper
