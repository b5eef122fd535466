"""The step of a diagnosis: halved where its error could be taken for a cause."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from backend.effects.catalogue import catalogue
from tests.diagnose.test_diagnosis import COARSE_S, RUB, drawing, study

__all__ = ["drawing"]  # a fixture

pytestmark = pytest.mark.timeout(600)

ONLY = frozenset(set(catalogue()) - {"coulomb_friction"})
BRAKE = 0.03  # N m s/rad
VISCOUS = frozenset(set(catalogue()) - {"viscous_friction"})


class Enough(Exception):
    """The baseline is all that is looked at."""


@pytest.mark.nightly
def test_a_step_is_halved_until_its_error_cannot_be_taken_for_a_cause(drawing, monkeypatch):
    from backend.diagnose import run
    from backend.diagnose.step_error import step_error
    from backend.diagnose.which import Search

    looked_at = []

    def screen(self, cause):
        looked_at.append((self.subject.step_s, step_error(self.subject, cause)))
        raise Enough

    monkeypatch.setattr(Search, "screen", screen)
    monkeypatch.setattr(run, "TRIFLE", 0.0)
    told = study(drawing, 1, rub=RUB, frames=24)
    for given, most, halvings in ((COARSE_S, 0.0, 0), (None, 1e9, 0), (None, 0.0, 2)):
        monkeypatch.setattr(run, "STEP_ERROR", most)
        with pytest.raises(Enough):
            run.diagnose_study(told, without=ONLY, step_s=given)
        assert looked_at[-1][0] == pytest.approx((given or looked_at[1][0]) / 2**halvings)
    (_, coarse), (_, fine) = looked_at[1:]
    # A step of second order that is halved twice errs by a sixteenth, of which the square counts.
    assert coarse / fine == pytest.approx(256.0, rel=0.3)
    assert coarse < 1.0  # of this bar nothing would have been halved


def test_slopes_about_a_motion_in_fine_steps_are_taken_in_coarse_ones(drawing):
    from backend.diagnose.finer import finer_responses
    from backend.diagnose.latent import forces
    from backend.diagnose.library import SMOOTH, library
    from backend.diagnose.screen import library_slopes
    from backend.diagnose.subject import SAME, prepare
    from backend.diagnose.which import Search

    told = study(drawing, 1, torque=braked, frames=24)
    known = library(told.mechanism, SMOOTH, without=frozenset(catalogue()) - {"viscous_friction", "length_error"})
    found = []
    for coarse in (1, 4):
        subject = prepare(told, known, COARSE_S / 4, coarse=coarse)
        fitted = Search(subject, lambda words: None, lambda: False).baseline().fitted
        assert [p.step_s for p in fitted.rough] == pytest.approx([coarse * COARSE_S / 4] * 2)
        finer = finer_responses(subject, fitted, ["j1"])
        pushes = np.concatenate(forces(subject, fitted))
        found.append((library_slopes(fitted, SAME), pushes, *finer.values()))
    assert not np.array_equal(found[0][0], found[1][0])
    for fine, rough in zip(*found, strict=True):
        assert np.linalg.norm(fine - rough) < 0.01 * np.linalg.norm(fine)


def test_an_error_of_another_order_is_not_put_back():
    from backend.diagnose.step_error import orderly

    smooth, grain = np.array([1e-4, -2e-4, 3e-4]), np.array([2e-4, 1e-4, -1e-4])
    once, twice = orderly([np.stack([smooth, 1.1 * smooth]), np.stack([smooth, 0.3 * smooth + grain])])
    np.testing.assert_array_equal(once, smooth)
    np.testing.assert_array_equal(twice, 0.0)


@pytest.mark.parametrize("much", [False, True])
def test_the_step_errs_about_the_cause_where_that_is_another_error(drawing, monkeypatch, much):
    """A bar that is braked: as drawn it swings on."""
    from backend.diagnose import run
    from backend.diagnose.step_error import apart, orderly, step_errors
    from backend.diagnose.which import Search

    monkeypatch.setattr(run, "STEP_ERROR", 0.0 if much else 1e9)
    monkeypatch.setattr(run, "ROUGH", 1e9)
    searches = []
    monkeypatch.setattr(run, "Search", lambda *given, **told: searches.append(Search(*given, **told)) or searches[-1])
    found = run.diagnose_study(study(drawing, 1, torque=braked, frames=24), without=VISCOUS, step_s=COARSE_S)
    search = searches[-1]
    (named,) = found.best.candidates
    assert named.name == "viscous_friction:j1"
    known = [p.correction for p in found.subject.fit if p.correction is not None]
    errors = [orderly(step_errors(found.subject, c.fitted)) for c in (found.best, found.baseline)]
    about = [apart(found.subject, one, known) for one in errors]
    assert (about[0] < 0.01 * about[1]) == much
    begun = search.begun.get("viscous_friction:j1")
    assert (begun is not None) == much  # where a fit with the other error ended
    assert begun is None or begun[0] == pytest.approx(BRAKE, rel=0.05)


def braked(t, q, rate):
    return -BRAKE * rate


@pytest.mark.parametrize(
    ("fraction", "at_the_end", "gap"),
    [(1.0, np.nan, 2e8), (0.5, 6e6, 2.4e9), (0.5, np.inf, 2e8)],
    ids=["whole records", "the drawing follows half", "and its motion is lost"],
)
def test_an_error_of_the_step_matters_beside_the_gap_alone(monkeypatch, fraction, at_the_end, gap):
    from backend.diagnose import run
    from backend.diagnose.standards import TRIFLE

    monkeypatch.setattr(run, "mean_square", lambda fitted, share: at_the_end)
    drawn = SimpleNamespace(fraction=fraction, r=np.empty(200), chi2=2e8)
    baseline: Any = SimpleNamespace(fitted=drawn)
    assert run.mattering(1.0, baseline) == pytest.approx(TRIFLE**2 * gap)
    assert run.mattering(1e5, baseline) == 1e5
