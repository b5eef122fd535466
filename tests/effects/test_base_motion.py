"""Whether a base shook before the release, too."""

import jax.numpy as jnp
import numpy as np
import pytest

from backend.effects.base_motion import BaseMotion

TIME = jnp.linspace(-0.5, 0.5, 101)


def base(begins_at_release: float) -> BaseMotion:
    return BaseMotion(
        amplitude_m=jnp.array([2e-3, 0.0, 1e-3]),
        frequency_hz=jnp.array(3.0),
        phase_rad=jnp.array(0.7),
        begins_at_release=jnp.array(begins_at_release),
    )


def test_a_base_that_shakes_all_along_is_one_sine():
    expected = np.sin(2 * np.pi * 3.0 * TIME + 0.7)[:, None] * np.array([2e-3, 0.0, 1e-3])
    assert np.asarray(base(0.0).displacement(TIME)) == pytest.approx(expected, abs=1e-15)


def test_a_base_set_off_by_the_release_rests_before_it_and_moves_alike_after():
    rests, shakes = np.asarray(base(1.0).displacement(TIME)), np.asarray(base(0.0).displacement(TIME))
    before, after = np.asarray(TIME) <= 0.0, np.asarray(TIME) >= 0.0
    assert np.ptp(rests[before], axis=0) == pytest.approx(0.0, abs=1e-15)
    assert rests[after] == pytest.approx(shakes[after], abs=1e-15)
    assert np.ptp(shakes[before], axis=0)[0] > 3e-3


def test_the_force_is_that_of_the_motion():
    h, t = 1e-4, 0.2
    places = [np.asarray(base(1.0).displacement(jnp.array(t + k * h))) for k in (-1, 0, 1)]
    expected = (places[0] - 2 * places[1] + places[2]) / h**2
    assert np.asarray(base(1.0).acceleration(jnp.array(t))) == pytest.approx(expected, rel=1e-5)
