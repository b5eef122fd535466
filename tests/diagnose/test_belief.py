"""How much of a likelihood a wrong law bears."""

import numpy as np
import pytest

from backend.diagnose.independent import independent


def test_white_noise_is_as_many_values_as_samples():
    r = np.random.default_rng(1).standard_normal(4000)
    assert independent(r) == pytest.approx(4000, rel=0.05)


@pytest.mark.parametrize("memory", [0.5, 0.9])
def test_noise_with_memory_is_as_many_values_as_its_mean_has(memory):
    rng, n = np.random.default_rng(2), 20000
    r = np.zeros(n)
    for k in range(1, n):
        r[k] = memory * r[k - 1] + rng.standard_normal()
    assert independent(r) == pytest.approx(n * (1 - memory) / (1 + memory), rel=0.1)


def test_sampling_a_smooth_miss_more_finely_adds_nothing():
    rng = np.random.default_rng(3)
    phase, size, rate = rng.uniform(0, 6.28, 40), rng.standard_normal(40), rng.uniform(0.2, 2.0, 40)

    def miss(samples):
        t = np.linspace(0.0, 30.0, samples)
        return np.sin(6.28 * rate * t[:, None] + phase) @ size

    coarse, fine = independent(miss(1000)), independent(miss(8000))
    assert fine == pytest.approx(coarse, rel=0.05)
    assert 20 < coarse < 240  # thirty seconds of a band of 1.8 Hz: 4 f T is 132


def test_a_library_from_which_all_but_one_was_left_out_holds_that_one():
    from backend.diagnose.belief import log_prior

    assert log_prior(1, 0) == log_prior(1, 1)
    assert np.isfinite(log_prior(2, 0))
    assert log_prior(1, 10) == pytest.approx(log_prior(1, 1) - np.log(10))
