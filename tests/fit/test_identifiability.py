from dataclasses import replace

import numpy as np
import pytest

from backend.fit.identifiability import Z95, assess, profile_interval
from backend.fit.prior import GaussianPrior
from backend.fit.solve import LeastSquares, solve

TIME = np.linspace(0, 3, 120)


def decay(value, sigma=1.0, time=TIME):
    def residual(x):
        return (x[0] * np.exp(-x[1] * time) - value) / sigma

    def linearise(x):
        e = np.exp(-x[1] * time)
        return residual(x), np.stack([e, -x[0] * time * e], 1) / sigma

    return LeastSquares(
        ["height", "rate"], residual, linearise, np.array([-np.inf, 0.0]), np.full(2, np.inf), np.ones(2)
    )


def fitted(value, sigma=1.0):
    p = decay(value, sigma)
    s = solve(p, np.array([1.5, 0.8]))
    return p, s, assess(p.names, s, p.scale, np.zeros(TIME.size, int), np.arange(TIME.size))


def ar1(rng, n, a):
    e, r = rng.standard_normal(n), np.empty(n)
    r[0] = e[0]
    for k in range(1, n):
        r[k] = a * r[k - 1] + np.sqrt(1 - a**2) * e[k]
    return r


def covered(noise, seeds=200, sigma=0.05):
    """Share of seeds whose 95% intervals hold the truth: (misfit-aware, noise only), both parameters."""
    truth = np.array([2.0, 1.0])
    inside, naive = [], []
    for seed in range(seeds):
        value = 2 * np.exp(-TIME) + sigma * noise(np.random.default_rng(seed))
        _, s, u = fitted(value, sigma)
        inside.append(np.abs(s.x - truth) < Z95 * u.sd)
        naive.append(np.abs(s.x - truth) < Z95 * u.noise_sd)
    return np.mean(inside), np.mean(naive)


def test_intervals_cover_the_truth_95_times_in_100_under_white_noise():
    aware, naive = covered(lambda rng: rng.standard_normal(TIME.size))
    # 400 cases: sd of a 95% share is 1.1%. Never below the noise, so the aware intervals may only err on the wide side.
    assert 0.92 < naive < 0.98
    assert 0.94 < aware <= 1.0


def test_intervals_see_noise_with_memory_that_white_intervals_miss():
    aware, naive = covered(lambda rng: ar1(rng, TIME.size, 0.8))
    assert naive < 0.75
    # 120 samples hold about 13 independent ones: estimated memory costs a few percent.
    assert aware > 0.86


def test_intervals_see_that_sigma_was_believed_too_small():
    aware, naive = covered(lambda rng: 5.0 * rng.standard_normal(TIME.size))
    assert naive < 0.5
    assert aware > 0.92


def test_a_model_that_misses_is_reported_with_its_misfit_in_sigmas():
    value = 2 * np.exp(-TIME) + 0.02 * np.sin(15 * TIME)
    _, _, u = fitted(value, sigma=0.001)
    assert u.chi_square_per_point == pytest.approx(200.0, rel=0.2)  # (0.02 / sqrt 2 / 0.001)^2
    assert any("misses the data by" in w for w in u.warnings)
    assert np.all(u.sd > 5 * u.noise_sd)


def test_two_parameters_that_act_only_as_a_product_are_called_unidentified():
    def linearise(x):
        return x[0] * x[1] * TIME - 6 * TIME, np.stack([x[1] * TIME, x[0] * TIME], 1)

    p = LeastSquares(
        ["gain", "load"], lambda x: linearise(x)[0], linearise, np.full(2, -9.0), np.full(2, 9.0), np.ones(2)
    )
    s = solve(p, np.array([2.0, 2.0]))
    u = assess(p.names, s, p.scale, np.zeros(TIME.size, int), np.arange(TIME.size))
    assert u.unidentified == (True, True)
    assert np.all(np.isinf(u.sd))
    assert any("gain cannot be told" in w for w in u.warnings)
    assert set(u.weakest) == {"gain", "load"}


def test_parameters_that_trade_are_named_as_a_pair():
    both = np.stack([TIME, TIME + 0.05 * TIME**2], 1)
    value = both @ [1.0, 1.0] + 0.1 * np.random.default_rng(0).standard_normal(TIME.size)
    p = LeastSquares(
        ["drag", "friction"], lambda x: (both @ x - value) / 0.1, lambda x: ((both @ x - value) / 0.1, both / 0.1),
        np.full(2, -9.0), np.full(2, 9.0), np.ones(2),
    )  # fmt: skip
    s = solve(p, np.zeros(2))
    u = assess(p.names, s, p.scale, np.zeros(TIME.size, int), np.arange(TIME.size))
    assert u.correlation[0, 1] < -0.95
    assert any("drag and friction trade against each other" in w for w in u.warnings)


def test_the_profile_of_a_linear_parameter_is_its_normal_interval():
    A = np.stack([np.ones_like(TIME), TIME], 1)
    value = A @ [1.0, 2.0] + np.random.default_rng(1).standard_normal(TIME.size)
    p = LeastSquares(
        ["a", "b"], lambda x: A @ x - value, lambda x: (A @ x - value, A), np.full(2, -99.0), np.full(2, 99.0),
        np.ones(2),
    )  # fmt: skip
    s = solve(p, np.zeros(2))
    u = assess(p.names, s, p.scale, np.zeros(TIME.size, int), np.arange(TIME.size))
    profile = profile_interval(p, s, 1, u.covariance, u.noise_sd[1])
    assert profile.bounded
    half = Z95 * u.sd[1]
    assert profile.lower == pytest.approx(s.x[1] - half, abs=0.03 * half)  # the search stops within 3%
    assert profile.upper == pytest.approx(s.x[1] + half, abs=0.03 * half)


def test_the_profile_of_a_weak_curve_is_lopsided_where_the_normal_interval_is_not():
    """Little of the decay is seen, so a high rate is excluded more firmly than a low one... or the reverse."""
    time = np.linspace(0, 0.8, 40)
    truth, sigma = np.array([2.0, 1.0]), 0.25
    value = truth[0] * np.exp(-truth[1] * time) + sigma * np.random.default_rng(5).standard_normal(40)
    p = decay(value, sigma, time)
    s = solve(p, truth)
    u = assess(p.names, s, p.scale, np.zeros(40, int), np.arange(40))
    profile = profile_interval(p, s, 1, u.covariance, u.noise_sd[1], max_points=12, max_iterations=20)
    best = {}
    for value_at_end in (profile.lower, profile.upper):  # brute force over the other parameter
        e = np.exp(-value_at_end * time)
        height = (e @ value) / (e @ e)
        best[value_at_end] = np.sum(((height * e - value) / sigma) ** 2) - np.sum(s.residual**2)
    inflation = max(u.sd[1] / u.noise_sd[1], 1.0) ** 2
    for deviance in best.values():
        assert deviance / inflation == pytest.approx(Z95**2, rel=0.08)  # 3% in its root


def test_a_profile_that_meets_its_bound_is_open_there():
    value = 0.01 * np.exp(-0.02 * TIME) + 0.05 * np.random.default_rng(2).standard_normal(TIME.size)
    p = decay(value, 0.05)
    s = solve(p, np.array([0.1, 0.1]))
    u = assess(p.names, s, p.scale, np.zeros(TIME.size, int), np.arange(TIME.size))
    profile = profile_interval(p, s, 1, u.covariance, u.noise_sd[1])
    assert profile.lower is None


def test_a_tolerance_holds_what_the_data_cannot_tell():
    names = ["gain", "load"]
    prior = GaussianPrior.of(names, {"load": (3.0, 0.1)})

    def linearise(x):
        r = np.concatenate([(x[0] * x[1] - 6.0) * TIME, prior.residual(x)])
        return r, np.vstack([np.stack([x[1] * TIME, x[0] * TIME], 1), prior.jacobian(2)])

    p = LeastSquares(names, lambda x: linearise(x)[0], linearise, np.full(2, -9.0), np.full(2, 9.0), np.ones(2))
    s = solve(p, np.array([1.0, 3.5]))
    run = np.append(np.zeros(TIME.size, int), -1)
    u = assess(names, s, p.scale, run, np.arange(TIME.size + 1))
    np.testing.assert_allclose(s.x, [2.0, 3.0], rtol=1e-6)
    assert u.sd[1] == pytest.approx(0.1, rel=1e-3)  # all that is known of load is its tolerance
    assert not any(u.unidentified)


def test_a_tolerance_on_nothing_lists_what_there_is():
    with pytest.raises(KeyError, match="known: gain, load"):
        GaussianPrior.of(["gain", "load"], {"mass": (0.0, 1.0)})


def test_a_profile_by_gradients_alone_is_the_same():
    value = 2 * np.exp(-TIME) + 0.25 * np.random.default_rng(3).standard_normal(TIME.size)
    p, s, u = fitted(value, 0.25)
    asked = []
    traced = replace(p, linearise=asked.append, trace_back=lambda x, w: p.linearise(x)[1].T @ w)
    for j in range(2):
        plain = profile_interval(p, s, j, u.covariance, u.noise_sd[j], max_iterations=2)
        other = profile_interval(traced, s, j, u.covariance, u.noise_sd[j], max_iterations=2)
        assert other.lower == pytest.approx(plain.lower, abs=0.03 * u.sd[j])  # either stops within 3% of the end
        assert other.upper == pytest.approx(plain.upper, abs=0.03 * u.sd[j])
    assert not asked
