"""A link that bends: a long arm, a thin strip, a part with a slit."""

from jaxtyping import Array, Float

from backend.effects.effect import parameter
from backend.effects.shapes import AbstractSection


class LinkFlexibility(AbstractSection):
    """The link is two halves on a spring hinge at its centre of mass; bending torque = stiffness x angle."""

    kind = "link_flexibility"
    acts_on = "body"
    stiffness_n_m_per_rad: Float[Array, ""] = parameter(
        "N m/rad", "bending torque per angle; the default is rigid", default=1e9, lower=0.0, typical=100.0, expected=1.0
    )
    damping_n_m_s_per_rad: Float[Array, ""] = parameter(
        "N m s/rad", "bending torque per rate", lower=0.0, expected=0.05
    )
    axis: Float[Array, "3"] = parameter(
        "1",
        "what it bends about, in body axes; read when the model is built; 0 0 0 is the axis of its joints",
        size=3,
        by_name=True,
    )

    def stiffness(self):
        """As drawn."""
        return self.stiffness_n_m_per_rad

    def damping(self):
        """As drawn."""
        return self.damping_n_m_s_per_rad
