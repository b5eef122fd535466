"""What was drawn, as arrays: the numbers an effect may correct before the motion starts."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from backend.model.incidence import with_row


class Drawing(eqx.Module):
    """Bodies (slots of moving bodies, then fixed ones) and joints of a mechanism, SI, in body axes.

    Points are given from a body's CAD origin; `stretch` maps a drawn point to the real part's.
    """

    mass: Float[Array, "bodies"]
    center_of_mass: Float[Array, "bodies 3"]
    inertia: Float[Array, "bodies 3 3"]
    stretch: Float[Array, "bodies 3 3"]
    length_axis: Float[Array, "bodies 3"]
    point_a: Float[Array, "joints 3"]
    point_b: Float[Array, "joints 3"]
    axes_a: Float[Array, "joints 3 3"]
    axes_b: Float[Array, "joints 3 3"]
    pin_radius: Float[Array, "joints"]
    begins_near: Float[Array, "joints"]
    """Angle that a turning joint's q begins within half a turn of [rad]."""
    gravity: Float[Array, "3"]

    def with_body(self, body: int, **rows: Any) -> "Drawing":
        """A copy in which the named rows of one body are replaced."""
        names = list(rows)
        return eqx.tree_at(
            lambda d: [getattr(d, name) for name in names],
            self,
            [with_row(getattr(self, name), body, rows[name]) for name in names],
        )

    def with_axes_a(self, joint: int, axes: Float[Array, "3 3"]) -> "Drawing":
        """A copy in which a joint's frame in its first body has other axes."""
        return eqx.tree_at(lambda d: d.axes_a, self, with_row(self.axes_a, joint, axes))

    def with_gravity(self, gravity: Float[Array, "3"]) -> "Drawing":
        """A copy under other gravity [m/s²]."""
        return eqx.tree_at(lambda d: d.gravity, self, jnp.asarray(gravity))
