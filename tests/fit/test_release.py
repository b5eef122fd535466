import numpy as np
import pytest

from backend.fit.release import held_still, moving


def test_static_frames_average_and_their_scatter_shrinks_with_their_number():
    rng = np.random.default_rng(0)
    time = np.arange(60) / 100
    value = np.where(time < 0.25, 1.2, 5.0) + 0.01 * rng.standard_normal(60)
    start = held_still(time, value, np.full(60, 0.01), 0.25)
    assert start.samples == 25
    assert start.value_sd == pytest.approx(0.002)
    assert start.value == pytest.approx(1.2, abs=3 * start.value_sd)
    assert start.rate == 0.0


def test_one_sample_before_the_release_serves_alone():
    start = held_still(np.array([0.0, 0.1]), np.array([0.3, 9.0]), np.array([0.01, 0.01]), 0.05)
    assert (start.value, start.value_sd, start.samples) == (0.3, 0.01, 1)


def test_a_window_of_motion_gives_position_and_velocity():
    time = 0.5 + np.arange(80) / 250
    value = 0.3 * np.sin(4 * (time - 0.5) + 0.7) + 1e-4 * np.random.default_rng(1).standard_normal(80)
    start = moving(time, value, np.full(80, 1e-4), 0.5)
    # What a cubic cannot follow is allowed to reach the size of the noise, and adds to the estimate's own sd.
    assert start.value == pytest.approx(0.3 * np.sin(0.7), abs=4 * start.value_sd + 1e-4)
    assert start.rate == pytest.approx(1.2 * np.cos(0.7), rel=0.02)


def test_a_window_too_long_for_a_cubic_is_shortened_until_it_fits():
    time = np.arange(300) / 1000
    value = np.sin(25 * time)  # more than a whole period inside 0.3 s
    start = moving(time, value, np.full(300, 1e-4), 0.0)
    assert start.samples < 80
    assert start.rate == pytest.approx(25.0, rel=0.01)


def test_too_few_samples_for_a_velocity_ask_for_a_longer_window():
    with pytest.raises(ValueError, match=r"Lengthen release.window_s"):
        moving(np.array([0.0, 1.0]), np.zeros(2), np.ones(2), 0.0)
