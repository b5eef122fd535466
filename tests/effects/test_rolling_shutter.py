"""When a row of a picture is read, against the row whose time is stated."""

import jax.numpy as jnp
import pytest

from backend.effects.rolling_shutter import RollingShutter
from backend.effects.shapes import Camera, Sight

READOUT_S, HEIGHT_M = 0.01, 0.5
CAMERA = Camera(jnp.array([0.0, 1.0, 0.0]), jnp.array([0.0, 0.0, -1.0]), jnp.zeros(3), jnp.asarray(0.4))


def delay(below_middle_m, stamped_row, speed_down=0.0):
    effect = RollingShutter(jnp.asarray(READOUT_S), jnp.asarray(HEIGHT_M), jnp.asarray(stamped_row))
    p, v = jnp.array([[0.1, 0.0, -below_middle_m]]), jnp.array([[0.0, 0.0, -speed_down]])
    return float(effect.delay(Sight(p, v, jnp.zeros(1), jnp.asarray(0.0)), CAMERA)[0])


@pytest.mark.parametrize(
    ("stamped", "row", "late"), [(0.0, 0.0, 0.0), (0.0, 1.0, 1.0), (0.5, 0.5, 0.0), (1.0, 0.5, -0.5)]
)
def test_a_row_is_late_by_its_share_of_the_readout_after_the_stamped_one(stamped, row, late):
    assert delay((row - 0.5) * HEIGHT_M, stamped) == pytest.approx(late * READOUT_S, abs=1e-15)


def test_a_point_that_moves_down_is_met_where_it_then_is():
    speed, start = 3.0, 0.05
    t = delay(start, 0.0, speed)
    row = 0.5 + (start + speed * t) / HEIGHT_M  # where it is when it is read
    assert t == pytest.approx(row * READOUT_S, rel=1e-12)
