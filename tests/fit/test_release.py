import numpy as np
import pytest

from backend.fit.release import held_still, moving
from backend.fit.wild import agreeing


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


def strides(n, noise=1e-4):
    time = np.arange(n) / 150
    return time, 0.09 * np.sin(3 * time + 0.4) + noise * np.random.default_rng(2).standard_normal(n)


@pytest.mark.parametrize("at", [0, 1, 20, 44])
def test_one_wild_sample_of_a_window_is_left_out(at):
    time, value = strides(45)
    sigma = np.full(45, 1e-4)
    clean = moving(time, value, sigma, 0.0)
    value[at] += 0.05
    start = moving(time, value, sigma, 0.0)
    assert start.samples == 44  # the window is as long as it was
    assert start.value == pytest.approx(clean.value, abs=2 * clean.value_sd)
    assert start.rate == pytest.approx(clean.rate, abs=2 * clean.rate_sd)


def test_several_wild_samples_do_not_hide_each_other():
    time, value = strides(45)
    clean = moving(time, value, np.full(45, 1e-4), 0.0)
    value[[2, 9, 30]] += (0.05, 0.05, -0.03)
    assert moving(time, value, np.full(45, 1e-4), 0.0).value == pytest.approx(clean.value, abs=2 * clean.value_sd)


def test_a_motion_that_sets_in_within_the_window_is_no_wild_sample():
    time = np.arange(45) / 150
    value = np.where(time > 0.27, 20.0 * (time - 0.27), 0.0)
    kept = agreeing(np.vander(time, 4) / 1e-4, value / 1e-4, 1.0)
    assert np.all(kept)


def test_wild_static_frames_are_left_out_though_their_scatter_says_nothing_of_them():
    value = 0.1 + 2e-4 * np.random.default_rng(3).standard_normal(30)
    value[7] += 0.05
    start = held_still(np.arange(30) / 100, value, np.full(30, float(np.std(value))), 1.0)
    assert (start.samples, start.value) == (29, pytest.approx(0.1, abs=2e-4))


def test_a_count_of_an_encoder_up_or_down_is_no_wild_frame():
    value = np.full(30, 0.1)
    value[[4, 19]] += 1e-3
    start = held_still(np.arange(30) / 100, value, np.full(30, 1e-3 / np.sqrt(12)), 1.0)
    assert start.samples == 30
