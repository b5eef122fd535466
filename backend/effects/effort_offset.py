"""A constant torque or force at a joint: a leaning base, a cable, an amplifier's zero."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from backend.effects.effect import TURNING, parameter
from backend.effects.shapes import AbstractJointEffort


class EffortOffset(AbstractJointEffort):
    """The same effort everywhere, positive towards growing q."""

    kind = "effort_offset"
    acts_on = "joint"
    torque_n_m: Float[Array, ""] = parameter(
        "N m", "torque on the second body", joint_types=TURNING, drive="mean", expected=0.05
    )
    force_n: Float[Array, ""] = parameter(
        "N", "force on the second body", joint_types=("prismatic",), drive="mean", expected=0.05
    )

    def effort(self, q):
        """Independent of q."""
        return self.torque_n_m + self.force_n

    def potential(self, q):
        """None: it counts as a drive."""
        return jnp.zeros_like(q)
