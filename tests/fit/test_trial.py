"""A bad joint that throws the fit of shared values so far off that no slope at its end leads to it."""

from dataclasses import replace

import numpy as np
import pytest

from backend.fit.residual import Residuals
from backend.fit.solve import LeastSquares
from backend.fit.sparse import Sparse
from backend.fit.trial import brought
from tests.fit.test_sparse import fitted, seen_by_encoders
from tests.mechanisms import Z, bar, drawing, effect

DAMPING, BAD, TIMES = 2e-3, "pin2", 30.0  # N m s/rad
STEP_S, SAMPLES, SIGMA_RAD = 5e-3, 400, 1e-3
TRIED = "another value tried at"
LINKS = ((0.2, 0.0), (0.17, 0.3), (0.23, -0.2), (0.15, 0.4))  # m, rad from the level


def falling_chain(damping):
    """Four uneven links let go near the level: they fall, fold and whip."""
    ends = np.cumsum([(0, 0), *(length * np.array([np.cos(turn), np.sin(turn)]) for length, turn in LINKS)], axis=0)
    ends = np.column_stack([ends, np.zeros(len(ends))])
    bars = [bar(f"link{i}", ends[i], ends[i + 1], 0.05) for i in range(len(LINKS))]
    above = ["ground", *(f"link{i}" for i in range(len(LINKS)))]
    pins = [(f"pin{i}", "revolute", above[i], above[i + 1], ends[i], Z) for i in range(len(LINKS))]
    drag = [effect(f"v_{id}", "viscous_friction", [id], damping_n_m_s_per_rad=damping) for id, *_ in pins]
    return drawing("chain", bars, pins, drag)


@pytest.fixture(scope="module")
def seen():
    return seen_by_encoders(falling_chain(2 * DAMPING), DAMPING, SAMPLES, STEP_S, SIGMA_RAD)


@pytest.mark.nightly
def test_a_joint_that_throws_the_shared_fit_off_is_found_by_trial(seen):
    said = []
    result = fitted(seen(1, **{BAD: TIMES}), step_s=STEP_S, progress=lambda share, words: said.append(words))
    (found,) = result.report.deviations
    assert found.name == f"viscous_friction:{BAD}.damping_n_m_s_per_rad"
    assert found.could_be == ()
    assert found.difference == pytest.approx((TIMES - 1) * DAMPING, abs=3.5 * found.sd)
    assert result.uncertainty.chi_square_per_point < 1.1  # 1600 samples: 1 +- 0.035
    tried = [next(word for word in words.split() if word.startswith("pin")) for words in said if TRIED in words]
    assert [name.rstrip(",") for name in tried] == ["pin0", "pin1", "pin2", "pin3"]


def test_nothing_is_tried_where_shared_values_explain_the_data(seen):
    said = []
    report = fitted(seen(2), step_s=STEP_S, progress=lambda share, words: said.append(words)).report
    assert report.deviations == ()
    assert said
    assert not any(TRIED in words for words in said)


@pytest.mark.parametrize("seed", [2, 3, 4])
def test_noise_larger_than_stated_costs_trials_and_gives_no_name(seen, seed):
    study, said = seen(seed), []
    (run,) = study.experiments
    stated = replace(run, joint_positions=run.joint_positions.assign(sigma=0.2 * SIGMA_RAD))
    report = fitted(
        replace(study, experiments=(stated,)), step_s=STEP_S, progress=lambda share, words: said.append(words)
    ).report
    assert any(TRIED in words for words in said)
    assert report.deviations == ()
    assert len(report.parameters) == 1


@pytest.mark.nightly
def test_a_name_that_simulations_do_not_bear_out_is_not_added(seen, monkeypatch):
    """As where parts strike and slopes promise too much: from the second round on they would add the wrong pin."""
    by_slopes, wrong = Sparse._name, 0

    def promised(self, search, solution, apart):
        named = by_slopes(self, search, solution, apart)
        if not apart:
            return named
        values = named.values.copy()
        values[self._candidates().index(wrong)] *= 3.0
        more = tuple(sorted({*named.apart, wrong}))
        return replace(
            named, apart=more, values=values, instead={wrong: ()} | named.instead, due={wrong: 10.0} | named.due
        )

    monkeypatch.setattr(Residuals, "strikes", property(lambda self: True))
    monkeypatch.setattr(Sparse, "_name", promised)
    said = []
    report = fitted(
        seen(1, **{BAD: TIMES}), step_s=STEP_S, derivatives="forward",
        progress=lambda share, words: said.append(words),
    ).report  # fmt: skip
    assert any("what slopes would add" in words for words in said)
    assert [found.name for found in report.deviations] == [f"viscous_friction:{BAD}.damping_n_m_s_per_rad"]
    assert not any("still changed" in warning for warning in report.warnings)


def places(seed, deviation, columns=4, samples=200):
    """Linear residuals, with a noise of 1, of a value shared by all (few) and of each place's own (full), their slopes,
    and what is seen where the last place deviates from the others' 1.
    """
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((samples, columns)) + np.arange(samples)[:, None] / samples
    seen = A.sum(1) + deviation * A[:, -1] + rng.standard_normal(samples)

    def problem(residual, size):
        wide = np.full(size, 1e3)
        return LeastSquares([""] * size, residual, lambda x: (residual(x), A), -wide, wide, np.ones(size))

    full = problem(lambda x: A @ x - seen, columns)
    return problem(lambda x: A.sum(1) * x[0] - seen, 1), full, A.sum(1)[:, None], A, seen


def weighed(few, full, J, value, shared=1.0):
    return brought(few, np.array([shared]), J, full, lambda x: np.repeat(x, full.lower.size), 3, value)


@pytest.mark.parametrize("seed", range(4))
def test_a_place_brings_what_least_squares_say_and_what_is_shared_gives_way(seed):
    few, full, J, A, seen = places(seed, 2.0)
    without = np.linalg.lstsq(J, seen)[1][0]
    best, left = np.linalg.lstsq(np.column_stack([A[:, :3].sum(1), A[:, 3]]), seen)[:2]
    # The place goes along where the shared value gives way: its deviation stays.
    assert weighed(few, full, J, 1.0 + best[1] - best[0]) == pytest.approx(without - left[0], rel=1e-6)


def test_a_better_shared_value_is_nothing_that_a_place_brings():
    few, full, J, _, _ = places(1, 0.0)
    assert abs(weighed(few, full, J, 1.5, shared=1.5)) < 10.0  # a chi-square of one, 3.2 sigmas


def test_a_place_whose_slope_promises_what_no_simulation_keeps_brings_nothing():
    few, full, J, _, _ = places(1, 2.0)
    stiff = replace(full, residual=lambda x: full.residual(np.append(x[:3], 1.0 - abs(x[3] - 1.0))))
    assert weighed(few, stiff, J, 3.0) < 0.0


@pytest.mark.parametrize(
    ("when", "strikes"),
    [("slopes of each place", True), ("slopes over the distance", True), (TRIED, False), ("fitting a value at", False)],
)
def test_a_search_for_what_deviates_ends_within_a_simulation_of_being_cancelled(seen, when, strikes, monkeypatch):
    """Slopes where parts strike, and trials, take two simulations a place."""
    simulated, ended = Residuals.residual, []

    def residual(self, *asked, **how):
        ended.extend([1] if ended else [])
        return simulated(self, *asked, **how)

    monkeypatch.setattr(Residuals, "strikes", property(lambda self: strikes))
    monkeypatch.setattr(Residuals, "residual", residual)
    result = fitted(
        seen(1, **{BAD: TIMES}), step_s=STEP_S, derivatives="forward", cancelled=lambda: bool(ended),
        progress=lambda share, words: ended.extend([0] if when in words and not ended else []),
    )  # fmt: skip
    assert sum(ended) <= 1
    assert result.solution.status == "cancelled"
    assert result.report.deviations == ()
    assert len(result.report.parameters) == 1 or when != TRIED
