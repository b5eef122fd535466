"""Links that meet: where two capsules are nearest, and the directions in which they push and rub.

A pair of capsules can meet in five places: each of the four ends against the other's axis, and the two axes crossing.
Parallel bars that lie side by side thus hold each other at both ends of the stretch that they share.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from backend.model.contacts import JointContacts
from backend.model.system import System
from backend.simulate.kinematics import Bodies
from backend.simulate.small import apply, apply_transposed, dot

PLACES = 5
TINY_M = 1e-9  # keeps the direction between axes that meet finite
OUT_OF_REACH_M = 1.0  # gap of a crossing that lies beyond an axis's end: the ends speak for it
PARALLEL = 1e-6  # squared sine below which axes do not cross


class Near(NamedTuple):
    """The five places of every pair: gap [m], and rows (apart, along) in (Δx, turn) of the first, then second body."""

    gap: Float[Array, "places"]
    rows: Float[Array, "places 2 12"]


def walls(system: System) -> JointContacts:
    """The places as flat walls: contact coordinates are (apart, along, 0)."""
    touches = system.touches
    count = PLACES * touches.count

    def spread(values: Array) -> Array:
        return jnp.repeat(values, PLACES)

    return JointContacts(
        joints=(0,) * count,
        round=(False,) * count,
        travels=(False,) * count,
        rubs=True,
        loose=(),
        selection=jnp.zeros((count, 3, 6)),
        normal=jnp.tile(jnp.array([-1.0, 0.0]), (count, 1)),
        room=jnp.zeros(count),
        friction=spread(touches.wall.friction),
        give=spread(touches.wall.give),
        restitution=spread(touches.wall.restitution),
    )


def near(system: System, bodies: Bodies) -> Near:
    """Where the capsules of every pair are nearest at these poses."""
    if not system.touches.count:
        return Near(jnp.zeros(0), jnp.zeros((0, 2, 12)))
    first, second = np.array(system.topology.touches, dtype=int).reshape(-1, 2).T
    ends = []
    for slots, capsule in ((first, system.touches.first), (second, system.touches.second)):
        R, p = bodies.rotation[slots], bodies.position[slots]
        ends.append((p + apply(R, capsule.start), p + apply(R, capsule.end)))
    (a0, a1), (b0, b1) = ends
    along_a, along_b = a1 - a0, b1 - b0
    on_a, on_b, ok = _crossing(a0, along_a, b0, along_b)
    places = [
        (a0, _nearest(a0, b0, along_b), along_b),
        (a1, _nearest(a1, b0, along_b), along_b),
        (_nearest(b0, a0, along_a), b0, along_a),
        (_nearest(b1, a0, along_a), b1, along_a),
        (on_a, on_b, along_b),
    ]
    gaps, rows = [], []
    for place, (at_a, at_b, slide) in enumerate(places):
        line = at_b - at_a
        distance = jnp.sqrt(dot(line, line) + TINY_M**2)
        n = line / distance[:, None]
        gap = distance - system.touches.first.radius - system.touches.second.radius
        gaps.append(gap if place < PLACES - 1 else jnp.where(ok, gap, OUT_OF_REACH_M))
        t = slide - n * dot(n, slide)[:, None]
        t = t / jnp.sqrt(dot(t, t) + TINY_M**2)[:, None]
        # One point for both, so that what rubs before the gap is quite closed makes no couple.
        between = 0.5 * (system.touches.first.radius - system.touches.second.radius)[:, None]
        point = 0.5 * (at_a + at_b) + between * n
        rows.append(jnp.stack([_row(bodies, first, second, point, u) for u in (n, t)], 1))
    return Near(jnp.stack(gaps, 1).reshape(-1), jnp.stack(rows, 1).reshape(-1, 2, 12))


def _row(bodies: Bodies, first: np.ndarray, second: np.ndarray, point: Array, u_W: Array) -> Array:
    """Slope of the distance, along u, of what both bodies have at a point."""
    turns = []
    for slots in (first, second):
        R = bodies.rotation[slots]
        turns.append(jnp.cross(apply_transposed(R, point - bodies.position[slots]), apply_transposed(R, u_W)))
    return jnp.concatenate([-u_W, -turns[0], u_W, turns[1]], -1)


def _nearest(point: Array, start: Array, along: Array) -> Array:
    """Point of a segment nearest to another point."""
    share = dot(point - start, along) / (dot(along, along) + TINY_M**2)
    return start + jnp.clip(share, 0.0, 1.0)[:, None] * along


def _crossing(a0: Array, u: Array, b0: Array, v: Array) -> tuple[Array, Array, Array]:
    """Points where two axes pass each other, and whether both lie between the ends."""
    w = b0 - a0
    uu, vv, uv = dot(u, u) + TINY_M**2, dot(v, v) + TINY_M**2, dot(u, v)
    square = uu * vv - uv * uv
    crossing = square > PARALLEL * uu * vv
    square = jnp.where(crossing, square, 1.0)
    s = (dot(w, u) * vv - dot(w, v) * uv) / square
    t = (dot(w, u) * uv - dot(w, v) * uu) / square
    inside = crossing & (s > 0.0) & (s < 1.0) & (t > 0.0) & (t < 1.0)
    s, t = jnp.clip(s, 0.0, 1.0), jnp.clip(t, 0.0, 1.0)
    return a0 + s[:, None] * u, b0 + t[:, None] * v, inside
