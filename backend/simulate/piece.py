"""What a piece of a step does differently: a step is cut in two where it has no solution, or none was found."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

BLUR = 10.0  # per cut, on the rate below which friction holds: where sticking is undecided, 1 µm of creep decides
BLURRED = 6  # cuts after which it grows no more
LAGGING = 2  # cuts beyond which friction is limited by the push of the step before


class Piece(NamedTuple):
    """A whole step, or what is left of it after some cuts.

    In a piece, walls push along their normal at q_{k+1} and give nothing back, and friction holds below a higher rate;
    after `LAGGING` cuts friction's limit and direction are those of q_k: a convex problem is left.
    """

    cuts: int | Array

    @property
    def cut(self) -> bool | Bool[Array, ""]:
        """Whether it is less than a whole step."""
        return self.cuts > 0

    @property
    def share(self) -> float | Array:
        """Of the whole step."""
        return 0.5**self.cuts

    @property
    def blur(self) -> Array:
        """Factor on the rate below which friction holds."""
        return BLUR ** jnp.minimum(self.cuts, BLURRED)

    @property
    def lagging(self) -> Bool[Array, ""]:
        """Whether friction leans on what is known at q_k."""
        return jnp.asarray(self.cuts > LAGGING)

    def left_in(self, gap: Float[Array, "walls"], give: Float[Array, "walls"]) -> Float[Array, "walls"]:
        """How deep a part may stay in a wall at the end of a piece that begins deeper than the wall gives way [m].

        A whole step may end behind a wall, for the next to give back.  What drove the part out within a piece would
        drive it as much faster as the piece is shorter; it leaves at the pace of a whole step.
        """
        return (1.0 - self.share) * jnp.maximum(-gap - give, 0.0)


WHOLE = Piece(0)
