"""Which parts of the records a search fits, one after the other."""

from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from backend.fit.search import LOST, NEAREST, Search


def parts(miss, horizons=(0.1, 0.35)) -> list[float]:
    """The parts fitted, where after a part that ends at `done` a record to `until` is missed by miss(done, until)."""
    fitted = [0.0]
    residuals = SimpleNamespace(miss=lambda x, until: miss(fitted[-1], until))

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
