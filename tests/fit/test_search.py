"""Which parts of the records a search fits, one after the other, and the way back where the whole leads astray."""

from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from backend.fit.checkpoint import Checkpoint
from backend.fit.pace import Pace
from backend.fit.retrace import RETRACED, way_ahead
from backend.fit.search import LOST, NEAREST, Search
from backend.fit.solve import LeastSquares


def parts(miss, horizons=(0.1, 0.35)) -> list[float]:
    """The parts fitted, where after a part that ends at `done` a record to `until` is missed by miss(done, until)."""
    fitted = [0.0]
    residuals = SimpleNamespace(strikes=False, miss=lambda x, until: miss(fitted[-1], until))

    class Told(Search):
        def _stage(self, x, fraction, *rest, **more):
            fitted.append(fraction)
            return SimpleNamespace(status="converged", x=x, objective=0.0)

        def at_full_length(self, x, words=""):
            fitted.append(1.0)

    pace: Any = SimpleNamespace(enter=lambda *a: None)
    Told(residuals, "lm", "linear", 5, None, pace, None).through(np.zeros(1), horizons)  # type: ignore[arg-type]
    return fitted[1:]


def test_a_motion_that_is_followed_takes_no_more_parts_than_asked():
    assert parts(lambda done, until: 0.1 * LOST) == [0.1, 0.35, 1.0]


def test_a_spinning_wheel_is_followed_by_parts_over_which_it_stays_within_a_turn():
    found = parts(lambda done, until: LOST * 3.0 * (until - done))
    assert found[:2] == [0.1, 0.35]
    assert found[-1] == 1.0
    assert all(3.0 * (b - a) <= 1.0 for a, b in pairwise(found[2:]))
    assert len(found) > 3


def test_a_wrong_form_that_never_follows_gets_no_more_parts():
    assert parts(lambda done, until: 2.0 * LOST) == [0.1, 0.35, 1.0]


def test_where_nothing_short_of_all_is_followed_the_parts_end():
    found = parts(lambda done, until: 0.0 if until <= done else 9.0)
    assert 3 < len(found) < 11
    assert min(b / a for a, b in pairwise(found[1:])) > NEAREST * 0.99


@pytest.mark.parametrize("horizons", [(), (0.5,)])
def test_fewer_parts_may_be_asked(horizons):
    assert parts(lambda done, until: 0.0, horizons) == [*horizons, 1.0]


class Forking:
    """A record of a motion that forks ever more often: sample k moves with the value, and beside that by a wave whose
    length in the value falls, and whose height grows to many times the noise.
    """

    strikes = True
    TRUTH, NOISE, SAMPLES = 1.0, 0.01, 400

    def __init__(self, seed: int):
        rng = np.random.default_rng(seed)
        self.spread, self.share = 1.0, np.arange(1, self.SAMPLES + 1) / self.SAMPLES
        self.phase = rng.uniform(0.0, 2 * np.pi, self.SAMPLES)
        self.seen = self.motion(self.TRUTH)[0] + self.NOISE * rng.standard_normal(self.SAMPLES)

    def motion(self, value: float) -> tuple[np.ndarray, np.ndarray]:
        """Samples and their exact slopes."""
        height, pace = 0.3 * self.share**3, 2e3**self.share
        turn = pace * (value - self.TRUTH) + self.phase
        return value * self.share + height * np.sin(turn), self.share + height * pace * np.cos(turn)

    def rows(self, fraction: float = 1.0) -> Any:
        return SimpleNamespace(motion=round(fraction * self.SAMPLES))

    def problem(self, fraction: float = 1.0, anchor: Any = None) -> LeastSquares:
        n = self.rows(fraction).motion

        def linearise(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            at, slope = self.motion(float(x[0]))
            return (at - self.seen)[:n] / (self.NOISE * self.spread), slope[:n, None] / (self.NOISE * self.spread)

        low, high, one = np.zeros(1), np.full(1, 3.0), np.ones(1)
        return LeastSquares(("value",), lambda x: linearise(x)[0], linearise, low, high, one)

    alone = problem

    def evaluate(self, x: np.ndarray, fraction: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
        return self.problem(fraction).linearise(x)

    def misfit(self, x: np.ndarray, fraction: float = 1.0) -> float:
        return self.spread * float(np.sqrt(np.mean(self.evaluate(x, fraction)[0] ** 2)))

    def learn_spread(self, x: np.ndarray, fraction: float = 1.0) -> float:
        self.spread = max(self.misfit(x, fraction), 1.0)
        return self.spread

    def miss(self, x: np.ndarray, fraction: float = 1.0) -> float:
        return 0.0


def searched(residuals: Forking, cancelled: Any = None, told: Any = lambda share, words: None) -> Search:
    made: Any = residuals
    return Search(made, "lm", "linear", 40, Checkpoint(None, ""), Pace(told, 1.0), cancelled)


@pytest.mark.parametrize("seed", range(5))
def test_a_motion_that_forks_is_followed_from_its_beginning_by_differences(seed):
    residuals = Forking(seed)
    search = searched(residuals)
    led_astray = search.through(np.array([1.3]), (0.1,))
    assert residuals.misfit(led_astray.x) > 3.0
    found = search.retraced(led_astray)
    assert found.message == RETRACED
    assert found.roughness is not None
    assert residuals.misfit(found.x) < 0.5 * residuals.misfit(led_astray.x)
    off, sd = abs(float(found.x[0]) - residuals.TRUTH), float(np.sqrt(found.roughness[0, 0]))
    assert off < 0.03, (off, sd)


def test_a_smooth_motion_is_not_gone_through_again():
    residuals = Forking(0)
    residuals.phase = np.zeros(residuals.SAMPLES)
    residuals.motion = lambda value: (value * residuals.share, residuals.share)  # type: ignore[method-assign]
    residuals.seen = residuals.share + residuals.NOISE * np.random.default_rng(0).standard_normal(residuals.SAMPLES)
    search = searched(residuals)
    assert search.retraced(search.through(np.array([1.3]), (0.1,))).message != RETRACED


def test_following_again_can_be_cancelled_and_leaves_the_end_that_was_there():
    residuals, enough = Forking(0), []
    search = searched(residuals, lambda: bool(enough))
    led_astray = search.through(np.array([1.3]), (0.1,))
    enough.append(True)
    broken = search.retraced(led_astray)
    assert broken.status == "cancelled"
    np.testing.assert_array_equal(broken.x, led_astray.x)


def test_every_simulation_on_the_way_is_told():
    told: list[str] = []
    search = searched(Forking(0), told=lambda share, words: told.append(words))
    search.retraced(search.through(np.array([1.3]), (0.1,)))
    assert len([words for words in told if words.startswith("following the first 100%")]) > 3


def test_the_way_ahead_is_a_few_times_as_long_as_whole_records():
    assert way_ahead(1.0) == 1.0
    assert 5.0 < way_ahead(0.1) < 7.0  # of a row whose parts are each a fifth longer
