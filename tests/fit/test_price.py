"""Which way a fit takes its derivatives."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from backend.fit.price import cheapest, step_s
from backend.fit.residual import Residuals
from backend.fit.run import Run

LONG_S = 4000 * step_s(47, strikes=False)  # four seconds of 23 cells at 1 ms


def test_few_unknowns_come_with_every_simulation():
    assert cheapest(3, 2, LONG_S, strikes=False) == "together"
    assert cheapest(3, 2, 0.1 * LONG_S, strikes=True) == "together"


def test_many_unknowns_of_a_long_motion_are_fitted_by_gradients():
    assert cheapest(68, 0, LONG_S, strikes=False) == "adjoint"
    assert cheapest(68, 67, 0.1 * LONG_S, strikes=False) == "adjoint"  # profiles cost more than the search


def test_programs_that_would_not_pay_are_not_compiled():
    assert cheapest(20, 0, 1e-3, strikes=False) == "together"


def test_where_parts_strike_slopes_are_taken_forwards():
    assert cheapest(68, 67, LONG_S, strikes=True) == "forward"
    runs: Any = [SimpleNamespace(unknowns=0, strikes=True)]
    with pytest.raises(ValueError, match="may strike each other have no derivatives backwards in time"):
        _ = Residuals([], np.zeros(0), runs, way="adjoint").derivatives


@pytest.mark.parametrize("places", [6, 40])
def test_slopes_of_shared_values_are_those_of_their_places_together(monkeypatch, places):
    """Every place by itself where few share, along what they share where that spares enough."""
    few, taken = 2, []
    rng = np.random.default_rng(places)
    slope, ties = rng.standard_normal((5, places + 4)), np.eye(places, few, k=0)
    ties[2:, 1] = 1.0

    def linearised(setting, addresses, step_s, x, directions):
        taken.append(len(directions))
        return slope @ np.asarray(x), slope @ np.asarray(directions).T, np.zeros(5, bool)

    monkeypatch.setattr("backend.fit.run.linearised", linearised)
    given: Any = (
        SimpleNamespace(release=SimpleNamespace(at_rest=False)),
        SimpleNamespace(time_s=np.zeros(5), release_s=0.0, column=0),
        None, SimpleNamespace(motions=np.zeros((1, 6, 2))), (), 1e-3, ties,
    )  # fmt: skip
    run = Run(*given)
    run.__dict__["setting"] = None
    _, J = run.predict(np.ones(few), np.ones(4))
    np.testing.assert_allclose(J, np.concatenate([slope[:, :places] @ ties, slope[:, places:]], 1), atol=1e-12)
    assert taken == [places + 4 if places == 6 else 8]
