"""A loose bar whose motion is simulated too coarsely: its interval reaches as far as a finer step would take it."""

import numpy as np
import pytest

from backend.fit.fit_study import STRIKING_S, default_step, fit_study
from backend.fit.half_step import HalfStep
from backend.model.build import build
from tests.fit.test_unstated import PLAY_M, STATED, study

PLAY = "clearance:play.radial_m"


@pytest.fixture(scope="module")
def fallen():
    return study({}, STATED)


def test_where_parts_strike_no_step_is_longer_than_half_a_millisecond(fallen):
    assert default_step(fallen, build(fallen.mechanism)) == STRIKING_S


@pytest.fixture(scope="module")
def coarse(fallen):
    return fit_study(fallen, [PLAY], profiles=False, step_s=5e-3)


def test_an_interval_allows_for_twice_what_half_the_step_changes(coarse):
    (play,) = coarse.report.parameters
    shift = HalfStep.of(coarse.residuals, coarse.solution).shift[0]
    assert abs(shift) > play.sd
    low, high = play.ci95
    assert low < PLAY_M < high
    reach = play.value - low if shift < 0 else high - play.value
    assert reach == pytest.approx(np.hypot(1.96 * play.sd, 2.0 * shift), rel=0.01)
    assert any("--step 0.0025" in warning for warning in coarse.report.warnings)


@pytest.mark.nightly
def test_a_fit_at_half_the_step_ends_where_that_was_foretold(fallen, coarse):
    finer = fit_study(fallen, [PLAY], profiles=False, step_s=2.5e-3)
    shift = HalfStep.of(coarse.residuals, coarse.solution).shift[0]
    sd = coarse.report.parameters[0].sd
    assert finer.values[PLAY] - coarse.values[PLAY] == pytest.approx(shift, abs=sd)


@pytest.mark.parametrize("step_s", [0.0, -1e-3, 1e-9])
def test_a_step_that_is_none_is_refused_with_its_experiment(fallen, step_s):
    with pytest.raises(ValueError, match=r"experiment 'fall'.*choose one above 0"):
        fit_study(fallen, [PLAY], step_s=step_s)


def test_what_would_move_is_said_in_deviations_and_what_would_not_is_left_out():
    doubt = HalfStep(1e-3, ("play", "friction"), np.array([3e-6, 1e-4]))
    (sentence,) = doubt.sentences(np.array([1e-6, 1e-3]))
    assert "play by 3e-06 (3.0 deviations)" in sentence
    assert "friction" not in sentence
    np.testing.assert_allclose(doubt.ends, [[0.0, 6e-6], [0.0, 2e-4]])
    (lost,) = HalfStep(1e-3, ("play",), np.array([np.nan])).sentences(np.array([1.0]))
    assert "No motion was found at half the step" in lost
