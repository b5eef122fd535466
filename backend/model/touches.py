"""Contacts outside joints: links that meet, each a capsule there, and bodies that lie on the bed."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from backend.effects.shapes import AbstractBedFriction, AbstractLinkContact, Capsule, Wall
from backend.model.drawing import Drawing
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
    bodies: list[int] = []
    points, grips = [], []
    weight = jnp.abs(drawing.gravity @ normal)
    for group in placed:
        coefficient = jax.vmap(lambda e: e.coefficient())(group.here)
        for place, body in enumerate(group.at()):
            n_B = rotation[body].T @ normal
            along = drawing.length_axis[body] - n_B * (n_B @ drawing.length_axis[body])
            along = along / jnp.sqrt(along @ along + 1e-300)
            gyration = jnp.sqrt(n_B @ drawing.inertia[body] @ n_B / drawing.mass[body])
            for side in (-1.0, 1.0):
                bodies.append(int(body))
                points.append(side * UNIFORM * gyration * along)
                grips.append(0.5 * coefficient[place] * drawing.mass[body] * weight)
    none = jnp.zeros((0, 3))
    return Pads(tuple(bodies), jnp.stack(points) if points else none, jnp.stack(grips) if grips else none[:, 0], normal)


def bed_friction(placed: list[Placed]) -> list[Placed]:
    """The frictions on the bed among effects."""
    return [p for p in placed if isinstance(p.effect, AbstractBedFriction)]
