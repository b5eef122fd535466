"""What leaves far more than noise is joined in longer steps, and seen through in its own where it leads."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from backend.diagnose import which
from backend.diagnose.fitted import ERRING, LARGE, Seer, fit
from backend.diagnose.library import SMOOTH, library
from backend.diagnose.screen import library_slopes
from backend.diagnose.subject import SAME, prepare
from backend.diagnose.which import Search
from backend.effects.catalogue import catalogue
from tests.diagnose.test_diagnosis import COARSE_S, drawing, study

__all__ = ["drawing"]  # a fixture

pytestmark = pytest.mark.timeout(600)

BRAKE = 0.03  # N m s/rad
KINDS = "viscous_friction", "length_error", "effort_offset"


@pytest.fixture
def search(drawing) -> Search:
    told = study(drawing, 1, torque=lambda t, q, rate: -BRAKE * rate, frames=24)
    known = library(told.mechanism, SMOOTH, without=frozenset(catalogue()) - set(KINDS))
    return Search(prepare(told, known, COARSE_S / 4), lambda words: None, lambda: False)


def test_a_motion_that_misses_widely_goes_in_longer_steps_with_their_error_put_back(search):
    fitted = search.baseline().fitted
    assert fitted.chi2 > LARGE * fitted.r.size
    longer = fitted.longer
    assert longer.step_s == pytest.approx(COARSE_S)
    chosen = [longer.chosen(p, fitted.choice) for p in longer.fit]
    np.testing.assert_allclose(Seer(longer, chosen).left(fitted.x), fitted.r, atol=1e-6)
    bare = Seer(longer, [p.put_right(0.0 * p.correction) for p in chosen]).left(fitted.x)
    assert 0.0 < np.sum((bare - fitted.r) ** 2) < ERRING * fitted.chi2
    rough, fine = library_slopes(fitted), library_slopes(fitted, SAME)
    assert not np.array_equal(rough, fine)
    assert np.linalg.norm(rough - fine) < 0.01 * np.linalg.norm(fine)


def test_the_likeliest_is_seen_through_and_the_rest_is_not(search):
    baseline = search.baseline()
    singles = search.level([baseline], 8)
    by_name = {c.names: c.fitted for c in singles}
    right = by_name[("viscous_friction:j1",)]
    assert not right.in_longer_steps
    assert right.longer is None  # it leaves nothing but noise
    again = fit(search.subject, right.choice)
    assert right.chi2 == pytest.approx(again.chi2, abs=0.2)
    assert right.values == pytest.approx(again.values, rel=1e-3)
    rest = [f for f in by_name.values() if f is not right]
    assert any(f.in_longer_steps for f in rest)
    for f in rest:
        assert f.in_longer_steps == (f.chi2 > LARGE * f.r.size)
        assert f.subject is search.subject
        own = fit(search.subject, f.choice)
        assert f.chi2 == pytest.approx(own.chi2, rel=0.03)


def test_a_cause_is_seen_through_before_it_is_judged(search):
    baseline = search.baseline()
    rough = next(c for c in search.level([baseline], 8) if c.fitted.in_longer_steps)
    seen = search.seen_through(rough)
    assert not seen.fitted.in_longer_steps
    assert search.tried[rough.names] is seen
    assert search.seen_through(seen) is seen


def test_of_a_level_the_likeliest_are_finished_until_one_in_its_own_steps_leads(monkeypatch):
    def end(log_z: float, chi2: float = 1e3, longer: bool = True) -> Any:
        own: dict[str, Any] = dict(r=np.zeros(100), fraction=1.0, choice=SimpleNamespace(candidates=()))
        return SimpleNamespace(log_z=log_z, chi2=chi2, in_longer_steps=longer, **own)

    finished = []

    def finish(fitted: Any) -> Any:
        if fitted.in_longer_steps:
            finished.append(fitted.log_z)
        return end(fitted.log_z - 15.0, fitted.chi2, longer=False) if fitted.in_longer_steps else fitted

    monkeypatch.setattr(which, "log_evidence", lambda fitted: fitted.log_z)
    search: Any = object.__new__(Search)
    search._finished, search.cancelled = finish, lambda: False
    made = search._leading([[end(-30.0), end(-10.0)], [end(-20.0), end(-500.0, chi2=200.0)]])
    assert finished == [-500.0, -10.0, -20.0]  # it leaves little; it leads; and then it does
    assert [[f.log_z for f in fits] for fits in made] == [[-30.0, -25.0], [-35.0, -515.0]]
