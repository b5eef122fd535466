"""A joint whose axis leans."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from backend.effects.effect import parameter
from backend.effects.shapes import AbstractDrawnError


class JointAxisError(AbstractDrawnError):
    """The joint's axis leans in its first body: frame_a turns about its own x, then y.

    The second body goes with the axis and moves out of the drawn plane.  A closed planar loop cannot follow: rigid
    parts without play bind.  A drawing of one is refused, because its loop stays open.  A fit shares the misfit among
    its joints.  Their strain is of second order in the lean, so the slope at zero is true, but from 1e-5 rad on the
    strain of joints as stiff as ours drives the loop, and the motion says nothing about a real rig.
    """

    kind = "joint_axis_error"
    acts_on = "joint"
    odds = 0.1
    shared = False
    rad: Float[Array, "2"] = parameter("rad", "tilt about x and y of frame_a", size=2, expected=0.02)

    def redraw(self, drawing, place):
        """Turn frame_a."""
        (a, b), zero, one = self.rad, jnp.zeros(()), jnp.ones(())
        about_x = jnp.array([[one, zero, zero], [zero, jnp.cos(a), -jnp.sin(a)], [zero, jnp.sin(a), jnp.cos(a)]])
        about_y = jnp.array([[jnp.cos(b), zero, jnp.sin(b)], [zero, one, zero], [-jnp.sin(b), zero, jnp.cos(b)]])
        return drawing.with_axes_a(place, drawing.axes_a[place] @ about_x @ about_y)
