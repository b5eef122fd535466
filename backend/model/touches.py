"""Contacts outside joints: links that meet, each a capsule there, and bodies that lie on the bed."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from backend.effects.shapes import AbstractBedFriction, AbstractLinkContact, Capsule, Wall
from backend.model.drawing import Drawing
from backend.model.incidence import picked
from backend.model.placed import Placed

UNIFORM = np.sqrt(0.75)  # half of a uniform bar's length over twice its radius of gyration: where its two pads carry it


class Touches(eqx.Module):
    """Pairs of links that may meet; one row each, in the order of the topology's touches."""

    first: Capsule
    second: Capsule
    wall: Wall

    @property
    def count(self) -> int:
        """Number of pairs."""
        return self.wall.friction.shape[0]


class Pads(eqx.Module):
    """Where bodies rest on the bed: two pads each, with a steady load."""

    bodies: tuple[int, ...] = eqx.field(static=True)
    point: Float[Array, "pads 3"]
    """From the centre of mass, in body axes [m]."""
    grip: Float[Array, "pads"]
    """Largest friction force [N]."""
    normal: Float[Array, "3"]
    """Of the bed, in W."""

    @property
    def count(self) -> int:
        """Number of pads."""
        return len(self.bodies)


def touches(placed: list[Placed]) -> Touches:
    """All link contacts, ends of the capsules from the bodies' origins as drawn."""
    parts = [jax.vmap(lambda e: (*e.capsules(), e.wall()))(group.here) for group in placed]
    if not parts:
        none, points = jnp.zeros(0), jnp.zeros((0, 3))
        empty = Capsule(points, points, none)
        return Touches(empty, empty, Wall(none, none, none))
    first, second, wall = jax.tree.map(lambda *leaves: jnp.concatenate(leaves), *parts)
    return Touches(first, second, wall)


def touching_kinds(placed: list[Placed]) -> list[Placed]:
    """The link contacts among effects, in the order of their kinds."""
    return [p for p in placed if isinstance(p.effect, AbstractLinkContact)]


def pads(
    placed: list[Placed], drawing: Drawing, normal: Float[Array, "3"], rotation: Float[Array, "bodies 3 3"]
) -> Pads:
    """Two pads per body, on its length through its centre of mass, each with half of its weight on the bed.

    normal: of the bed in W.  rotation: of the bodies as drawn.  A uniform bar's pads stand a quarter of its length from
    its middle, where they brake a spin as the whole bar would.
    """
    if not placed:
        return Pads((), jnp.zeros((0, 3)), jnp.zeros(0), normal)
    each = np.concatenate([group.at() for group in placed])
    coefficient = jnp.concatenate([jax.vmap(lambda e: e.coefficient())(group.here) for group in placed])
    n_B, drawn, mass = normal @ picked(rotation, each), picked(drawing.length_axis, each), picked(drawing.mass, each)
    along = drawn - n_B * jnp.sum(n_B * drawn, -1, keepdims=True)
    along = along / jnp.sqrt(jnp.sum(along**2, -1, keepdims=True) + 1e-300)
    gyration = jnp.sqrt(jnp.einsum("ni,nij,nj->n", n_B, picked(drawing.inertia, each), n_B) / mass)
    reach, grip = UNIFORM * gyration[:, None] * along, 0.5 * coefficient * mass * jnp.abs(drawing.gravity @ normal)
    bodies = tuple(np.repeat(each, 2).tolist())
    return Pads(bodies, jnp.stack([-reach, reach], 1).reshape(-1, 3), jnp.repeat(grip, 2), normal)


def bed_friction(placed: list[Placed]) -> list[Placed]:
    """The frictions on the bed among effects."""
    return [p for p in placed if isinstance(p.effect, AbstractBedFriction)]
