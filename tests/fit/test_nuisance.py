"""Intervals that allow for numbers of which only the range is known: a line whose data hold a third term."""

import numpy as np
import pytest

from backend.fit.identifiability import Z95
from backend.fit.nuisance import Look, allowing, secants
from backend.fit.solve import LeastSquares, solve

T = np.linspace(0.0, 1.0, 100)
LINE = np.stack([np.ones_like(T), T], 1)


def fitted(seen: np.ndarray):
    """Offset and slope of a line through samples of unit noise, and their deviations."""

    def linearise(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return LINE @ x - seen, LINE

    problem = LeastSquares(
        ("offset", "slope"), lambda x: linearise(x)[0], linearise, np.full(2, -1e3), np.full(2, 1e3), np.ones(2)
    )
    return solve(problem, np.zeros(2)), np.sqrt(np.diag(np.linalg.inv(LINE.T @ LINE)))


def alike(*columns: np.ndarray) -> list[Look]:
    """What two looks agree on."""
    return [Look(column, column) for column in columns]


def test_what_the_data_cannot_see_widens_the_interval_by_all_it_can_do_and_on_its_side_alone():
    solution, sd = fitted(np.random.default_rng(0).standard_normal(T.size))
    found = allowing(solution, alike(5.0 * T), sd, sd)  # the model's slope grows by 5, so the fitted one falls
    assert found.shift[:, 0] == pytest.approx([0.0, -5.0], abs=1e-9)
    assert found.ends[0] == pytest.approx([-Z95 * sd[0], Z95 * sd[0]])
    assert found.ends[1] == pytest.approx([-5.0 - Z95 * sd[1], Z95 * sd[1]])
    assert found.gain == pytest.approx(0.0, abs=1e-9)


def test_what_the_data_rule_out_widens_nothing():
    solution, sd = fitted(np.random.default_rng(1).standard_normal(T.size))
    found = allowing(solution, alike(100.0 * (T + np.sin(20.0 * T))), sd, sd)
    assert found.shift[1, 0] < -50.0
    assert np.abs(found.ends / (Z95 * sd[:, None])).max() < 1.2


def test_what_the_data_show_is_allowed_for_and_told():
    column = 5.0 * T + 3.0 * np.sin(20.0 * T)
    solution, sd = fitted(0.7 * column + np.random.default_rng(2).standard_normal(T.size))
    found = allowing(solution, alike(column, np.cos(40.0 * T)), sd, sd)
    assert found.gain > 50.0
    assert found.gains[0] > 0.9 * found.gain > 10.0 * found.gains[1]
    assert solution.x[1] + found.ends[1, 0] < 0.0 < solution.x[1]  # the slope is the nuisance's alone


def test_what_widens_the_deviations_makes_the_data_say_less_of_the_nuisance():
    solution, sd = fitted(np.random.default_rng(3).standard_normal(T.size))
    column = 5.0 * T + 2.0 * np.sin(20.0 * T)
    trusted, doubted = (allowing(solution, alike(column), times * sd, sd) for times in (1.0, 8.0))
    assert trusted.shift[1, 0] == doubted.shift[1, 0] < -3.0
    beyond_noise = (found.ends[1, 0] + times * Z95 * sd[1] for found, times in ((trusted, 1.0), (doubted, 8.0)))
    little, much = beyond_noise
    assert much < 2.0 * little < 0.0


def test_a_secant_reaches_as_far_as_the_data_do_not_rule_out():
    solution, _ = fitted(np.random.default_rng(6).standard_normal(T.size))
    asked: list[float] = []

    def change(share: float) -> np.ndarray:
        asked.append(share)
        return 300.0 * share**2 * np.sin(20.0 * T)

    whole = pytest.approx(300.0 * np.sin(20.0 * T))
    far, near = secants(change, solution, 1.0)
    assert far.column == whole
    assert far.again == pytest.approx(0.5 * far.column)
    assert asked[-1] < 0.1
    assert np.linalg.norm(asked[-2] * near.column) < 4.0
    assert [look.column for look in secants(change, solution, 1e4)] == [whole, whole]


def test_a_motion_that_is_lost_on_the_way_is_looked_for_nearer():
    solution, _ = fitted(np.zeros(T.size))
    far, near = secants(lambda share: np.where(share > 0.2, np.nan, share) * T, solution, 1.0)
    for seen in (*far, *near):
        assert seen == pytest.approx(T)
    assert secants(lambda share: np.full(T.size, np.nan), solution, 1.0) is None


def test_a_value_that_the_data_do_not_bound_stays_unbounded():
    solution, sd = fitted(np.random.default_rng(4).standard_normal(T.size))
    found = allowing(solution, alike(T), np.array([np.inf, sd[1]]), sd)
    assert np.all(np.isinf(found.ends[0]))
    assert np.all(np.isfinite(found.ends[1]))


def test_intervals_hold_the_truth_whatever_the_nuisance_was_and_those_of_noise_do_not():
    rng = np.random.default_rng(5)
    column = 4.0 * T + 0.5 * np.sin(20.0 * T)
    held, of_noise = [], []
    for t in np.linspace(0.0, 1.0, 200):
        solution, sd = fitted(LINE @ [1.0, 2.0] + t * column + rng.standard_normal(T.size))
        low, high = (solution.x[1] + allowing(solution, alike(column), sd, sd).ends[1]).tolist()
        held.append(low < 2.0 < high)
        of_noise.append(abs(solution.x[1] - 2.0) < Z95 * sd[1])
    assert np.mean(held) > 0.93  # three standard errors below 0.95 is 0.90
    assert np.mean(of_noise) < 0.6


def test_a_fork_that_no_two_looks_share_says_nothing_of_the_nuisance():
    rng = np.random.default_rng(7)
    held, trusting = [], []
    for t in np.linspace(0.0, 1.0, 200):
        smooth, real, *forks = (4.0 * T, *rng.standard_normal((3, T.size)))
        solution, sd = fitted(LINE @ [1.0, 2.0] + t * smooth + real)
        once, twice = (smooth + fork for fork in forks)
        ends = [allowing(solution, [look], sd, sd).ends[1] for look in (Look(once, twice), Look(once, once))]
        inside = [float(low) < 2.0 - solution.x[1] < float(high) for low, high in ends]
        held.append(inside[0])
        trusting.append(inside[1])
    assert np.mean(held) > 0.93
    assert np.mean(trusting) < 0.6
