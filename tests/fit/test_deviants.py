"""Which of many columns deviate, where the answer is known: linear problems with a noise of 1."""

from dataclasses import replace

import numpy as np
import pytest

from backend.fit.deviants import deviants, lasso, projected

SAMPLES, PLACES = 400, 15


def problem(seed, truth, X=None, bounds=None):
    """Whitened residuals at zero deviations of columns that share much with each other and with a common one."""
    rng = np.random.default_rng(seed)
    if X is None:
        base = np.cumsum(rng.standard_normal((SAMPLES, 1)), 0)
        X = base + np.cumsum(rng.standard_normal((SAMPLES, PLACES)), 0)
    y = X @ truth + rng.standard_normal(SAMPLES)
    free = np.full(PLACES, -np.inf), np.full(PLACES, np.inf)
    return projected(
        -y, X, np.zeros(PLACES, int), np.zeros((SAMPLES, 0)), 0 * truth, np.ones(PLACES), bounds or free,
        np.zeros(SAMPLES, int), np.arange(SAMPLES),
    )  # fmt: skip


def test_the_penalty_is_a_soft_threshold_where_columns_are_orthogonal():
    c = np.array([3.0, -2.0, 0.5, -0.9])
    np.testing.assert_allclose(lasso(np.eye(4), c, 1.0, np.zeros(4)), [2.0, -1.0, 0.0, 0.0], atol=1e-12)


def test_a_penalised_minimum_holds_its_optimality_conditions():
    rng = np.random.default_rng(0)
    A = rng.standard_normal((50, 8)) + rng.standard_normal((50, 1))
    A /= np.linalg.norm(A, axis=0)
    c = A.T @ (5 * A[:, 2] - 4 * A[:, 5] + rng.standard_normal(50))
    d = lasso(A.T @ A, c, 1.0, np.zeros(8))
    pull = c - A.T @ A @ d
    np.testing.assert_allclose(pull[d != 0], np.sign(d[d != 0]), atol=1e-4)  # coordinate descent stops at 1e-6
    assert np.all(np.abs(pull) <= 1.0 + 1e-4)
    assert 0 < np.sum(d != 0) < 8


def test_where_none_deviates_one_fit_in_a_hundred_names_one():
    named = sum(bool(deviants(problem(seed, np.zeros(PLACES)), 1.0).apart) for seed in range(200))
    assert named <= 8  # 2 expected: 4 sd, with the sandwich's own scatter


@pytest.mark.parametrize("noise", [1.0, 3.0])
def test_a_name_has_to_take_away_what_noise_alone_would_not_and_does(noise):
    truth = np.where(np.arange(PLACES) == 4, 0.1, 0.0)
    for seed in range(10):
        seen = problem(seed, truth)
        seen = replace(seen, r=noise * seen.r)
        found, column = deviants(seen, noise), seen.X[:, 4]
        assert found.due[4] == pytest.approx((3.4 * noise) ** 2, rel=0.5)  # a hundredth by 15 places: 3.4 sigmas
        assert (column @ seen.r) ** 2 / (column @ column) > found.due[4]


@pytest.mark.parametrize("count", [1, 2])
def test_those_that_deviate_clearly_are_named_and_no_other(count):
    exact = 0
    for seed in range(50):
        truth = np.zeros(PLACES)
        truth[[4, 11][:count]] = [0.2, -0.2][:count]  # some twenty standard deviations
        found = deviants(problem(seed, truth), 1.0)
        exact += found.apart == tuple(np.flatnonzero(truth))
        assert set(np.flatnonzero(truth)) <= set(found.apart)
    assert exact >= 46


def test_places_that_do_the_same_are_named_in_each_others_stead():
    rng = np.random.default_rng(0)
    X = np.cumsum(rng.standard_normal((SAMPLES, PLACES)), 0)
    X[:, 7] = 1.0001 * X[:, 3]
    truth = np.zeros(PLACES)
    truth[3] = 0.5
    found = deviants(problem(1, truth, X), 1.0)
    (named,) = found.apart
    assert {named, *found.instead[named]} == {3, 7}


def test_a_place_that_would_need_a_value_beyond_its_bounds_is_none_to_name():
    """All alike but one: that it is larger, or that any other is far smaller, explains the same."""
    rng = np.random.default_rng(0)
    X = np.repeat(np.cumsum(rng.standard_normal((SAMPLES, 1)), 0), PLACES, 1)
    X[:, 0] = np.cumsum(rng.standard_normal(SAMPLES))
    truth = np.zeros(PLACES)
    truth[0] = 4.0
    bounds = np.zeros(PLACES), np.full(PLACES, np.inf)
    found = deviants(problem(1, truth, X, bounds), 1.0)
    assert found.apart == (0,)
    assert found.instead[0] == ()


def test_places_that_all_do_the_same_cannot_be_told_from_what_they_share():
    """Every pin of a regular scissor turns by the same angle."""
    column = np.cumsum(np.random.default_rng(0).standard_normal((SAMPLES, 1)), 0)
    truth = np.zeros(PLACES)
    truth[3] = 5.0
    found = deviants(problem(1, truth, np.repeat(column, PLACES, 1)), 1.0)
    assert found.apart == ()
    assert np.all(np.isinf(found.least))


def test_noise_that_remembers_does_not_pass_for_a_deviation():
    """Misfit of a wrong law is smooth in time, as deviations are."""
    named = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        clean = problem(seed, np.zeros(PLACES))
        slow = rng.standard_normal(SAMPLES)
        for t in range(1, SAMPLES):
            slow[t] += 0.8 * slow[t - 1]
        seen = replace(clean, r=slow)
        named += bool(deviants(seen, 1.0).apart)
    assert named <= 12  # white noise of the same size would be taken for one in nearly every draw
