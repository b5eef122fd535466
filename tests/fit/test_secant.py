"""Slopes over a standard deviation: what is rough at a finer scale neither narrows intervals nor holds the answer."""

from dataclasses import replace

import numpy as np
import pytest

from backend.fit.secant import narrowed, settle, smoothed
from backend.fit.solve import LeastSquares, solve

TRUTH = np.array([2.0, 0.3])
T = np.linspace(0.0, 1.0, 400)
NOISE = 0.1
LINE = np.stack([T, np.ones_like(T)], 1)
SMOOTH = NOISE * np.sqrt(np.diag(np.linalg.inv(LINE.T @ LINE)))  # deviations of slope and offset by noise alone


def rough_problem(
    seed: int, ripple: float, bounds: tuple[float, float] = (-10.0, 10.0), fine: float = 1e-3, apart: float = 0.0
) -> LeastSquares:
    """A line through noise, with a ripple in the parameters, by default ten times finer than the data can tell; apart:
    how far its length is from that in any sample, at most, as a logarithm.
    """
    rng = np.random.default_rng(seed)
    length = fine * np.exp(np.random.default_rng([seed, 1]).uniform(-apart, apart, (2, T.size)))
    phase, seen = rng.uniform(0, 2 * np.pi, (2, T.size)), TRUTH[0] * T + TRUTH[1] + NOISE * rng.standard_normal(T.size)

    def residual(x: np.ndarray) -> np.ndarray:
        ripples = ripple * NOISE * np.sin(x[:, None] / length + phase).sum(0)
        return (x[0] * T + x[1] + ripples - seen) / NOISE

    def linearise(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        slope = ripple * NOISE / length * np.cos(x[:, None] / length + phase)
        return residual(x), np.stack([T, np.ones_like(T)], 1) / NOISE + slope.T / NOISE

    low, high = (np.full(2, bound) for bound in bounds)
    return LeastSquares(("slope", "offset"), residual, linearise, low, high, np.ones(2))


def deviations(J: np.ndarray) -> np.ndarray:
    return np.sqrt(np.diag(np.linalg.inv(J.T @ J)))


def test_the_deviations_are_those_of_the_motion_and_not_of_its_ripple():
    smooth = solve(rough_problem(0, 0.0), np.array([1.0, 0.0]))
    found = solve(rough_problem(0, 0.05), np.array([1.0, 0.0]))
    # The exact derivative sees the ripple's slope, five times that of the line.
    assert np.all(deviations(found.jacobian) < 0.3 * deviations(smooth.jacobian))
    assert deviations(smoothed(rough_problem(0, 0.05), found).jacobian) == pytest.approx(
        deviations(smooth.jacobian), rel=0.1
    )


def test_intervals_hold_the_truth_as_often_as_they_say():
    held = []
    for seed in range(60):
        problem = rough_problem(seed, 0.05)
        found = smoothed(problem, solve(problem, TRUTH + np.array([0.03, -0.02])))
        assert found.roughness is not None
        sd = np.hypot(deviations(found.jacobian), np.sqrt(np.diag(found.roughness)))
        held.append(np.abs(found.x - TRUTH) < 1.96 * sd)
    # 120 intervals of 95%, of which two in a row are correlated: 88% is three standard errors below.
    assert np.mean(held) > 0.88


@pytest.mark.parametrize("ripple", [0.0, 0.2, 1.0])
def test_intervals_hold_where_roughness_hides_slopes_over_a_deviation(ripple):
    """Over two deviations, ripples of a fifth of the noise look as steep as the line, and as high as the noise five
    times as steep: intervals by such slopes would be a fifth as wide as they should.
    """
    held, wide = [], []
    for seed in range(60):
        problem = rough_problem(seed, ripple, fine=1e-3 * np.exp(-0.05 * seed), apart=0.7)
        begin = TRUTH + np.array([0.03, -0.02])
        rest = settle(problem, begin, problem.residual(begin), 0.2 * np.ones(2))
        sd = np.sqrt(np.diag(rest.covariance))
        held.append(np.abs(rest.x - TRUTH) < 1.96 * sd)
        wide.append(sd / SMOOTH)
    assert np.mean(held) > 0.85
    assert np.all(np.median(wide, axis=0) < 1.5)
    assert np.all(np.min(wide, axis=0) > 0.7)


def test_a_bound_nearer_than_a_deviation_is_respected():
    problem = rough_problem(1, 0.0, bounds=(-10.0, 2.0))
    found = smoothed(problem, solve(problem, np.array([1.0, 0.0])))
    assert np.all(found.x <= 2.0)
    assert np.all(np.isfinite(found.jacobian))
    assert np.all(np.linalg.norm(found.jacobian, axis=0) > 1.0)


@pytest.mark.parametrize("share", [0.96, 1.04])
def test_what_is_better_is_told_from_the_residual(share):
    """The objective beside it may be in the weights of an earlier search, 4% off."""
    problem = rough_problem(1, 0.3)
    found = solve(problem, np.array([4.0, -1.0]), max_iterations=1)
    np.testing.assert_array_equal(
        smoothed(problem, replace(found, objective=share * found.objective)).x, smoothed(problem, found).x
    )


@pytest.mark.parametrize("seed", range(4))
def test_wide_differences_lead_through_roughness_in_which_narrow_ones_rest(seed):
    problem = rough_problem(seed, 1.0, fine=0.02)  # waves as wide as the data can tell, as high as the noise
    truth = 0.5 * float(np.sum(problem.residual(TRUTH) ** 2))
    rested = smoothed(problem, solve(problem, np.array([4.0, -1.0])))
    assert rested.objective > 10.0 * truth
    assert narrowed(problem, rested).objective < 1.1 * truth


def test_no_difference_reaches_farther_than_half_a_value():
    """Begun as wide as values themselves, a difference sees how the motion bends and takes it for roughness."""
    problem, asked = rough_problem(0, 0.0), []

    def residual(x: np.ndarray) -> np.ndarray:
        asked.append(x.copy())
        return problem.residual(x)

    begin = TRUTH + 0.0
    settle(replace(problem, residual=residual), begin, problem.residual(begin), np.full(2, 5.0), rounds=1)
    around = np.array(asked[:4])
    assert np.max(np.abs(around - begin), axis=0) == pytest.approx([0.5 * TRUTH[0], 0.5], rel=1e-9)
