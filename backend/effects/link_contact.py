"""Links that meet."""

from jaxtyping import Array, Float

from backend.effects.effect import parameter
from backend.effects.shapes import AbstractLinkContact, Capsule, Wall

RIGID = 1e10  # N/m


class LinkContact(AbstractLinkContact):
    """Two links, or all that may meet, each a capsule there, touch, push each other and rub along each other."""

    kind = "link_contact"
    acts_on = "bodies"
    radius_a_m: Float[Array, ""] = parameter("m", "the first capsule's radius", default=None, lower=0.0, typical=0.05)
    radius_b_m: Float[Array, ""] = parameter("m", "the second capsule's radius", default=None, lower=0.0, typical=0.05)
    start_a_m: Float[Array, "3"] = parameter(
        "m",
        "one end of the first capsule's axis, in the body's axes",
        default=None,
        size=3,
        drawn="outermost joints",
        by_name=True,
    )
    end_a_m: Float[Array, "3"] = parameter(
        "m", "its other end", default=None, size=3, drawn="outermost joints", by_name=True
    )
    start_b_m: Float[Array, "3"] = parameter(
        "m",
        "one end of the second capsule's axis, in the body's axes",
        default=None,
        size=3,
        drawn="outermost joints",
        by_name=True,
    )
    end_b_m: Float[Array, "3"] = parameter(
        "m", "its other end", default=None, size=3, drawn="outermost joints", by_name=True
    )
    friction_coefficient: Float[Array, ""] = parameter(
        "1", "friction force over normal force, along the link that is touched", lower=0.0
    )
    stiffness_n_per_m: Float[Array, ""] = parameter(
        "N/m", "normal force over penetration; the default is rigid", default=RIGID, lower=1.0, by_name=True
    )
    restitution: Float[Array, ""] = parameter(
        "1", "speed after over speed before an impact", lower=0.0, upper=1.0, by_name=True
    )

    def capsules(self):
        """As declared."""
        first = Capsule(self.start_a_m, self.end_a_m, self.radius_a_m)
        return first, Capsule(self.start_b_m, self.end_b_m, self.radius_b_m)

    def wall(self):
        """As declared."""
        return Wall(self.friction_coefficient, 1.0 / self.stiffness_n_per_m, self.restitution)
