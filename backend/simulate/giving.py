"""What walls have taken from the motion, and may give back.

A blow takes two steps, and what it gives back is told by its gaps before.  Where another wall strikes in between, those
gaps tell of a motion that is no more, and a blow would give back more than it took (`python -m benchmarks.blows`).
An impulse γ at a node does the work γ (ġ⁻ + ġ⁺) / 2, ġ the rate of its gap in the steps around it.  Each wall keeps
account of that while it is pressed; a step in which one would overdraw is made again, and the gap that this wall asks
for at q_{k+1} is what its account can pay.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from backend.simulate.contact import Push, Reach

SMALL = 100.0  # barriers: work below is the barrier's own


class Bounds(NamedTuple):
    """A number for every wall inside joints, and for every place where links touch."""

    walls: Float[Array, "walls"]
    touches: Float[Array, "places"]

    def any_finite(self) -> Bool[Array, ""]:
        """Whether some of them bounds anything."""
        return jnp.isfinite(self.walls).any() | jnp.isfinite(self.touches).any()

    def least(self, other: "Bounds") -> "Bounds":
        """The smaller of both."""
        return Bounds(jnp.minimum(self.walls, other.walls), jnp.minimum(self.touches, other.touches))


def none(walls: int, places: int) -> Bounds:
    """Nothing is bounded."""
    return Bounds(jnp.full(walls, jnp.inf), jnp.full(places, jnp.inf))


def account(
    reach: Reach,
    push: Push,
    ahead: Float[Array, "walls"],
    rates: tuple[Float[Array, "walls"], Float[Array, "walls"]],
    taken: Float[Array, "walls"],
    barrier: Array,
) -> tuple[Float[Array, "walls"], Float[Array, "walls"]]:
    """What each wall has taken by now [J], and the gap that it may ask for instead [m]; inf where it may as it did.

    ahead: gap at q_{k+1}; rates: of the gaps in the steps around q_k; taken: by the step before; barrier in J.
    """
    if not push.normal.size:
        return taken, ahead
    moved = reach.step_s * (rates[0] + rates[1])  # by the gap, over both steps
    left = taken - push.normal * moved / (2.0 * reach.step_s)
    pressed = reach.ease * push.normal > push.slack
    # The two bodies alone answer a smaller way x with a push smaller by (moved - x) / ease; other bodies stiffen them.
    rest = reach.ease * push.normal - moved
    root = jnp.sqrt(rest * rest + 8.0 * reach.step_s * reach.ease * taken + 1e-300)
    paid = ahead - jnp.maximum(moved - 0.5 * (root - rest), 0.0)
    return jnp.where(pressed, jnp.maximum(left, 0.0), 0.0), jnp.where(left < -SMALL * barrier, paid, jnp.inf)
