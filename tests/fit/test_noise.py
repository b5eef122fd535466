import numpy as np
import pytest

from backend.fit.noise import channel_noise, lag_one, quantum, third_difference_sigma, whiten_ar1, whiten_ar1_transposed


def test_third_differences_see_the_noise_and_not_the_motion():
    rng = np.random.default_rng(0)
    time = np.sort(rng.uniform(0, 4, 4000))  # uneven on purpose
    value = np.sin(3 * time) + 0.01 * rng.standard_normal(4000)
    assert third_difference_sigma(time, value) == pytest.approx(0.01, rel=0.06)  # 2% of a median, three sd


def test_impacts_and_outliers_hardly_move_the_noise_estimate():
    rng = np.random.default_rng(1)
    time = np.arange(2000) / 240
    value = np.abs(np.sin(3 * time)) + 0.001 * rng.standard_normal(2000)
    value[::100] += 5.0
    assert third_difference_sigma(time, value) == pytest.approx(0.001, rel=0.15)  # 4% of windows hold an outlier


def test_a_parabola_on_uneven_times_has_no_third_difference():
    time = np.cumsum(np.random.default_rng(2).uniform(0.5, 2.0, 50))
    assert third_difference_sigma(time, 3 + 2 * time - time**2) < 1e-9  # rounding of values near 1e3


def test_an_encoder_held_still_is_as_noisy_as_its_rounding():
    step = 2 * np.pi / 4096
    time = np.arange(100) / 100
    angle = np.round(np.sin(time) / step) * step
    angle[:30] = 0.0
    noise = channel_noise(time, angle, release_s=0.3)
    assert noise.source == "static"
    np.testing.assert_allclose(noise.sigma, step / np.sqrt(12), rtol=1e-6)


def test_a_quantum_is_found_in_counts_and_not_in_white_noise():
    rng = np.random.default_rng(4)
    assert quantum(0.25 * rng.integers(0, 40, 500)) == pytest.approx(0.25)
    assert quantum(rng.standard_normal(500)) == 0.0


def test_wild_samples_hide_neither_a_quantum_nor_how_little_a_coarse_channel_scatters():
    rng, step = np.random.default_rng(3), 4e-4
    time, still = np.arange(600) / 100, 0.3
    value = np.round(np.where(time < still, 0.03, 0.03 + 0.1 * np.sin(time - still)) / step) * step
    value += step * (rng.random(600) < 0.1)
    wild = np.r_[5, 250:260]
    value[wild] += rng.uniform(0.02, 0.08, wild.size)
    assert quantum(value) == pytest.approx(step, rel=1e-6)
    assert channel_noise(time, value, release_s=still).sigma[0] < step


def test_sigma_in_the_data_is_believed_and_holes_are_filled():
    time = np.arange(200) / 100
    value = np.sin(time) + 0.01 * np.random.default_rng(5).standard_normal(200)
    given = np.full(200, 0.5)
    assert channel_noise(time, value, given).source == "given"
    given[10:] = np.nan
    mixed = channel_noise(time, value, given)
    assert mixed.sigma[0] == 0.5
    assert mixed.sigma[20] == pytest.approx(0.01, rel=0.3)  # third differences of 190 samples


def test_a_channel_that_never_changes_or_is_too_short_does_not_tell_its_noise():
    assert np.all(np.isnan(channel_noise(np.arange(50.0), np.full(50, 3.0)).sigma))
    assert np.all(np.isnan(channel_noise(np.arange(4.0), np.arange(4.0) ** 2).sigma))


def test_one_wild_frame_before_the_release_does_not_widen_the_noise():
    rng = np.random.default_rng(4)
    time, value = np.arange(60) / 240.0, 1e-3 * rng.standard_normal(60)
    value[7] += 0.05
    noise = channel_noise(time, value, release_s=0.2)
    assert noise.source == "static"
    np.testing.assert_allclose(noise.sigma, 1e-3, rtol=0.3)


def test_whitening_an_ar1_series_leaves_white_noise_of_the_same_size():
    rng = np.random.default_rng(6)
    e = rng.standard_normal(20000)
    r = np.empty_like(e)
    r[0] = e[0]
    for k in range(1, e.size):
        r[k] = 0.9 * r[k - 1] + np.sqrt(1 - 0.81) * e[k]
    a = lag_one(r)
    white = whiten_ar1(r, a)
    assert a == pytest.approx(0.9, abs=0.02)  # sd sqrt(1 - a^2) / sqrt(n) = 0.003
    assert abs(lag_one(white)) < 0.03
    assert white.std() == pytest.approx(1.0, rel=0.05)


def test_places_repeated_while_held_do_not_claim_to_be_perfect():
    # A still picture is coded as "the same again": every place repeats to the last digit.
    rng, t = np.random.default_rng(2), np.arange(200) / 240
    moving = np.sin(9 * (t - 0.1)) + 1e-3 * rng.standard_normal(t.size)
    found = channel_noise(t, np.where(t < 0.1, 0.123456, moving), release_s=0.1)
    assert found.source == "third_difference"
    assert found.sigma[0] == pytest.approx(1e-3, rel=0.4)  # static frames pull the median of the differences down


def test_whitening_and_its_transpose_agree():
    rng = np.random.default_rng(8)
    rows, weight = rng.standard_normal((2, 30))
    assert weight @ whiten_ar1(rows, 0.7) == pytest.approx(whiten_ar1_transposed(weight, 0.7) @ rows, rel=1e-12)
