from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from backend.fit.solve import LeastSquares, solve
from backend.fit.starts import at_once, scattered


def problem(residual, jacobian, lower, upper, scale=None, names=None, data_rows=None):
    lower, upper = np.asarray(lower, float), np.asarray(upper, float)
    scale = np.ones(lower.size) if scale is None else np.asarray(scale, float)
    names = names or [f"p{i}" for i in range(lower.size)]
    return LeastSquares(names, residual, lambda x: (residual(x), jacobian(x)), lower, upper, scale, data_rows)


def rosenbrock(lower=(-np.inf, -np.inf), upper=(np.inf, np.inf)):
    return problem(
        lambda x: np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]]),
        lambda x: np.array([[-20 * x[0], 10.0], [-1.0, 0.0]]),
        lower,
        upper,
    )


def decay(time, value, lower=(0.0, 0.0), upper=(np.inf, np.inf), data_rows=None):
    return problem(
        lambda x: x[0] * np.exp(-x[1] * time) - value,
        lambda x: np.stack([np.exp(-x[1] * time), -x[0] * time * np.exp(-x[1] * time)], 1),
        lower,
        upper,
        data_rows=data_rows,
    )


def test_the_valley_of_rosenbrock_is_walked_to_its_end():
    found = solve(rosenbrock(), np.array([-1.2, 1.0]))
    assert found.converged
    np.testing.assert_allclose(found.x, [1.0, 1.0], atol=1e-6)  # gtol 1e-9 on a curvature of order 1


def test_a_bound_in_the_way_is_met_and_named():
    # With x <= 0.5 the best is x = 0.5, y = x^2 = 0.25: known in closed form.
    found = solve(rosenbrock(upper=(0.5, np.inf)), np.array([-1.2, 1.0]))
    assert found.converged
    assert found.at_bound == (True, False)
    np.testing.assert_allclose(found.x, [0.5, 0.25], atol=1e-8)


def test_a_parameter_that_starts_on_its_bound_leaves_it_when_the_data_ask():
    time = np.linspace(0, 2, 40)
    found = solve(decay(time, 3 * np.exp(-0.7 * time)), np.array([0.0, 0.0]))
    np.testing.assert_allclose(found.x, [3.0, 0.7], rtol=1e-6)  # noise-free: solver tolerance only


def test_units_do_not_change_the_path():
    time = np.linspace(0, 2, 40)
    value = 3 * np.exp(-0.7 * time)
    plain = solve(decay(time, value), np.array([1.0, 0.1]))
    k = 2.0**20  # a power of two leaves every digit: without noise the last steps are rounding, on each machine its own
    small = problem(
        lambda x: k * x[0] * np.exp(-x[1] * time) - value,
        lambda x: np.stack([k * np.exp(-x[1] * time), -k * x[0] * time * np.exp(-x[1] * time)], 1),
        [0, 0],
        [np.inf, np.inf],
        scale=[1 / k, 1.0],
    )
    other = solve(small, np.array([1.0 / k, 0.1]))
    assert len(plain.history) == len(other.history)
    np.testing.assert_allclose(other.x, plain.x / [k, 1.0], rtol=1e-12)


def test_the_objective_never_rises_and_every_iteration_is_told():
    told = []
    found = solve(rosenbrock(), np.array([-1.2, 1.0]), progress=told.append)
    objectives = [i.objective for i in found.history]
    assert told == list(found.history)
    assert np.all(np.diff(objectives) <= 0)


def test_a_step_into_the_unsimulable_is_refused_not_fatal():
    """A residual that is NaN beyond x = 2 stands for a simulation that runs away."""

    def residual(x):
        return np.array([np.nan if x[0] > 2.0 else np.exp(3 * (x[0] - 1.9)) - 1.0])

    found = solve(problem(residual, lambda x: 3 * np.exp(3 * (x[:, None] - 1.9)), [-9], [9]), np.array([0.5]))
    assert found.converged
    assert found.x[0] == pytest.approx(1.9, abs=1e-4)


def test_slopes_of_an_exploding_motion_end_a_search_and_not_the_program():
    # One number's slope is beyond what can be squared; the other's is as ever.
    wild = problem(lambda x: np.array([x[0] - 2.0, x[0] - 2.0]), lambda x: np.array([[1.0, 1e200], [1.0, -1e200]]),
                   (-np.inf, -np.inf), (np.inf, np.inf))  # fmt: skip
    found = solve(wild, np.array([0.0, 0.0]))
    assert found.x[0] == pytest.approx(2.0, abs=1e-6)


def test_a_start_that_cannot_be_simulated_says_so():
    found = solve(problem(lambda x: x * np.nan, lambda x: np.eye(1), [0], [1]), np.array([0.5]))
    assert not found.converged
    assert "not finite at the starting values" in found.message


def test_iterations_that_run_out_are_named():
    found = solve(rosenbrock(), np.array([-1.2, 1.0]), max_iterations=2)
    assert not found.converged
    assert "still improving" in found.message


def test_a_fit_stops_when_told_to():
    found = solve(rosenbrock(), np.array([-1.2, 1.0]), cancelled=lambda: True)
    assert found.status == "cancelled"


def test_a_staircase_ends_the_search_without_calling_it_a_failure():
    """A simulation with sticking is a smooth curve plus tiny steps; the slope inside a step misleads."""

    def residual(x):
        return np.array([x[0] - 1.0 + 1e-6 * np.sign(np.sin(1e7 * x[0])), 1.0])

    found = solve(problem(residual, lambda x: np.array([[1.0], [0.0]]), [-5], [5]), np.array([3.0]))
    assert found.converged
    assert found.x[0] == pytest.approx(1.0, abs=1e-5)  # ten stairs


@pytest.mark.parametrize("loss", ["soft_l1", "huber", "student"])
def test_a_robust_loss_shrugs_off_outliers_that_drag_least_squares(loss):
    rng = np.random.default_rng(3)
    time = np.linspace(0, 3, 200)
    value = (2 * np.exp(-time) + 0.01 * rng.standard_normal(200)) / 0.01
    value[::20] += 300.0  # one sample in twenty, 300 sigmas off
    whitened = decay(time, value)
    plain = solve(whitened, np.array([100.0, 0.5]))
    robust = solve(whitened, np.array([100.0, 0.5]), loss=loss)
    truth = np.array([200.0, 1.0])
    assert np.abs(plain.x / truth - 1).max() > 0.03
    assert np.abs(robust.x / truth - 1).max() < 0.01  # about three sd of the clean samples


def test_a_robust_loss_leaves_priors_alone():
    only_prior = problem(lambda x: np.array([0.0, x[0] - 50.0]), lambda x: np.array([[0.0], [1.0]]), [-99], [99])
    with_prior = LeastSquares(
        only_prior.names, only_prior.residual, only_prior.linearise, only_prior.lower, only_prior.upper,
        only_prior.scale, data_rows=1,
    )  # fmt: skip
    found = solve(with_prior, np.array([0.0]), loss="student")
    assert found.x[0] == pytest.approx(50.0, abs=1e-6)


def test_quasi_newton_agrees_with_levenberg_marquardt():
    time = np.linspace(0, 2, 40)
    value = 3 * np.exp(-0.7 * time) + 0.1 * np.cos(9 * time)
    lm = solve(decay(time, value), np.array([1.0, 0.1]))
    bfgs = solve(decay(time, value), np.array([1.0, 0.1]), optimiser="lbfgsb", max_iterations=200)
    assert bfgs.converged
    np.testing.assert_allclose(bfgs.x, lm.x, rtol=1e-3)  # L-BFGS-B stops on a relative change of 1e-11
    assert bfgs.history[-1].objective <= 1.0001 * lm.objective


def test_bounds_that_contradict_each_other_are_refused():
    with pytest.raises(ValueError, match=r"friction: lower bound 2 is not below upper bound 1"):
        problem(lambda x: x, lambda x: np.eye(1), [2.0], [1.0], names=["friction"])


def swing(time, phase):
    """A clock with one unknown rate: the misfit of a long record has a minimum at every whole turn."""
    return problem(
        lambda x: np.sin(x[0] * time) - phase, lambda x: (time * np.cos(x[0] * time))[:, None], [0.0], [20.0]
    )


def test_the_best_of_several_starts_wins():
    time = np.linspace(0, 40, 2000)
    whole = swing(time, np.sin(6.0 * time))
    starts = scattered(np.array([5.5]), np.array([0.5]), whole.lower, whole.upper, 40, [True])
    every = at_once([partial(solve, whole, x) for x in starts])
    found = min(every, key=lambda end: end.objective)
    assert abs(every[0].x[0] - 6.0) > 0.01  # the first start alone is caught in a neighbouring valley
    assert len(every) == 41
    assert found.x[0] == pytest.approx(6.0, abs=1e-6)


def test_a_search_ends_with_the_step_that_brings_less_than_was_asked():
    time = np.linspace(0, 2, 40)
    value = 3 * np.exp(-0.7 * time) + 0.1 * np.random.default_rng(0).standard_normal(40)
    to_the_end, enough = (solve(decay(time, value), np.array([1.0, 0.1]), ftol=f) for f in (1e-12, 1e-2))
    assert enough.converged
    assert enough.evaluations < to_the_end.evaluations
    assert enough.objective < 1.01 * to_the_end.objective


def traced(plain):
    """The same problem that can trace back, and how often its Jacobian was asked for."""
    asked = []

    def linearise(x):
        asked.append(x)
        return plain.linearise(x)

    return replace(plain, linearise=linearise, trace_back=lambda x, w: plain.linearise(x)[1].T @ w), asked


@pytest.mark.parametrize("loss", ["linear", "huber"])
def test_slopes_that_are_kept_lead_where_fresh_ones_do(loss):
    time = np.linspace(0, 2, 40)
    value = 3 * np.exp(-0.7 * time) + 0.1 * np.cos(9 * time)
    start = np.array([2.8, 0.6])
    fresh = solve(decay(time, value), start, loss=loss, ftol=1e-12)
    problem, asked = traced(decay(time, value))
    kept = solve(problem, start, loss=loss, ftol=1e-12)
    assert kept.converged
    np.testing.assert_allclose(kept.x, fresh.x, rtol=1e-5)  # an objective within 1e-12, near its flat bottom
    np.testing.assert_allclose(kept.jacobian, decay(time, value).linearise(kept.x)[1])  # the end has its own
    assert len(asked) < len(kept.history)


def test_slopes_that_foretell_badly_are_taken_anew():
    problem, asked = traced(rosenbrock())
    found = solve(problem, np.array([-1.2, 1.0]))
    assert found.converged
    np.testing.assert_allclose(found.x, [1.0, 1.0], atol=1e-6)
    assert len(asked) > 5  # around a bend of the valley


def test_a_bound_is_met_with_kept_slopes():
    found = solve(traced(rosenbrock(upper=(0.5, np.inf)))[0], np.array([-1.2, 1.0]))
    np.testing.assert_allclose(found.x, [0.5, 0.25], atol=1e-6)
    assert found.at_bound == (True, False)


def test_a_search_with_kept_slopes_stops_when_told_to():
    problem, _ = traced(decay(np.linspace(0, 2, 40), 3 * np.exp(-0.7 * np.linspace(0, 2, 40))))
    told = []
    found = solve(problem, np.array([2.0, 0.1]), progress=told.append, cancelled=lambda: len(told) > 2)
    assert found.status == "cancelled"
    assert found.x is told[-1].parameters
    np.testing.assert_allclose(found.jacobian, problem.linearise(found.x)[1])


def test_quasi_newton_takes_gradients_where_it_may():
    time = np.linspace(0, 2, 40)
    problem, asked = traced(decay(time, 3 * np.exp(-0.7 * time)))
    found = solve(problem, np.array([1.0, 0.1]), optimiser="lbfgsb", max_iterations=200)
    np.testing.assert_allclose(found.x, [3.0, 0.7], rtol=1e-3)
    assert len(asked) == 2  # where it begins and where it ends
