"""What a camera sees that does not face the plane of motion."""

import jax.numpy as jnp
import numpy as np
import pytest

from backend.effects.camera_tilt import FAR, CameraTilt
from backend.effects.shapes import Camera, Sight

REACH_M = 0.4
CAMERA = Camera(jnp.array([0.0, 1.0, 0.0]), jnp.array([0.0, 0.0, -1.0]), jnp.zeros(3), jnp.asarray(REACH_M))
POINTS = np.array([[0.15, 0.0, -0.1], [-0.2, 0.0, 0.05], [0.0, 0.0, 0.2]])


def seen(yaw_rad, distance_m):
    effect = CameraTilt(jnp.asarray(0.0), jnp.asarray(yaw_rad), jnp.asarray(distance_m), jnp.zeros(()), jnp.zeros(()))
    sight = Sight(jnp.asarray(POINTS), jnp.zeros_like(POINTS), jnp.zeros(len(POINTS)), jnp.asarray(0.0))
    return np.asarray(effect.view(sight, CAMERA))[:, [0, 2]]


@pytest.mark.parametrize("distance_m", [0.0, 0.9])
def test_a_turned_pinhole_sees_the_plane_shortened_and_what_is_nearer_larger(distance_m):
    """Image of a plane turned by yaw about the vertical, at a scale of one in its middle."""
    yaw, far = 0.1, distance_m or FAR * REACH_M
    x, z = POINTS[:, 0], POINTS[:, 2]
    scale = far / (far - np.sin(yaw) * x)
    expected = np.stack([np.cos(yaw) * x * scale, z * scale], 1)
    np.testing.assert_allclose(seen(yaw, distance_m), expected, rtol=1e-12)


def test_what_is_told_of_a_tilt_beside_its_keystone_is_the_distance():
    """Where someone stretched the picture back along both axes, the keystone is left: a small tilt from nearby."""
    keystone = 0.1 / (FAR * REACH_M)
    x, z = POINTS[:, 0], POINTS[:, 2]
    expected = np.stack([x, z], 1) / (1.0 - keystone * x)[:, None]
    near = 0.05
    off = np.abs(seen(keystone * near, near) - expected).max()
    assert off < 2e-6 < 8e-4 < np.abs(seen(keystone * FAR * REACH_M, 0.0) - expected).max()
