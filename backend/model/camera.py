"""A camera that faces the plane of motion, from what is drawn."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from backend.effects.shapes import Camera, across
from backend.mechanism.mechanism import Mechanism

FLAT = 0.1  # share of gravity across the line of sight below which a picture has no down


def camera(mechanism: Mechanism, axis: Float[Array, "3"]) -> Camera:
    """Looks along `axis` at the middle of the joints, markers and centres of mass as drawn, its picture upright.

    Down is where weight points across the line of sight; where it points nowhere, z of the world is up, or y.
    """
    points = [(j.body_a, j.frame_a.position_m) for j in mechanism.joints]
    points += [(j.body_b, j.frame_b.position_m) for j in mechanism.joints]
    points += [(m.body, m.position_m) for m in mechanism.markers]
    points += [(b.id, b.inertial.center_of_mass_m) for b in mechanism.bodies if b.inertial]
    seen = np.array([mechanism.body(id_).pose.place(point) for id_, point in points])
    low, high = seen.min(0), seen.max(0)
    sight, gravity = np.asarray(axis), np.array(mechanism.gravity_m_per_s2, dtype=float)
    fall = gravity - (gravity @ sight) * sight
    if np.linalg.norm(fall) <= FLAT * np.linalg.norm(gravity):
        fall = -np.asarray(across(axis))[1]
        fall = fall - (fall @ sight) * sight
    reach = float(np.linalg.norm(high - low)) or 1.0
    down, middle = fall / np.linalg.norm(fall), 0.5 * (low + high)
    return Camera(axis, jnp.asarray(down), jnp.asarray(middle), jnp.asarray(reach))
