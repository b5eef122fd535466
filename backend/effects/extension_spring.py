"""A coil spring between two bodies, with an optional damper beside it."""

from jaxtyping import Array, Float

from backend.effects.effect import parameter
from backend.effects.shapes import AbstractStrut


class ExtensionSpring(AbstractStrut):
    """Tension = preload + stiffness x (length - free length); pushes when shorter."""

    kind = "extension_spring"
    acts_on = "bodies"
    odds = 0.1  # what a drawn one loses: coils give back nearly all of a swing, pins rub
    anchor_a_m: Float[Array, "3"] = parameter(
        "m", "end on the first body, in its axes", default=None, size=3, by_name=True
    )
    anchor_b_m: Float[Array, "3"] = parameter(
        "m",
        "end on the second body, in its axes; where one body is named, on the first fixed body, in that body's axes",
        default=None,
        size=3,
        by_name=True,
    )
    stiffness_n_per_m: Float[Array, ""] = parameter("N/m", "force per lengthening", lower=0.0)
    free_length_m: Float[Array, ""] = parameter("m", "length without force", lower=0.0)
    preload_n: Float[Array, ""] = parameter("N", "pull beside that of the stiffness", by_name=True)
    damping_n_s_per_m: Float[Array, ""] = parameter("N s/m", "force per rate of lengthening", lower=0.0, expected=0.05)

    def anchors(self):
        """As drawn."""
        return self.anchor_a_m, self.anchor_b_m

    def tension(self, length):
        """Linear in the lengthening."""
        return self.preload_n + self.stiffness_n_per_m * (length - self.free_length_m)

    def damping(self):
        """Along the spring."""
        return self.damping_n_s_per_m

    def potential(self, length):
        """F₀ (l - l₀) + ½ k (l - l₀)²."""
        longer = length - self.free_length_m
        return self.preload_n * longer + 0.5 * self.stiffness_n_per_m * longer**2
