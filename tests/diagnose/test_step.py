"""The step of a diagnosis: halved where its error could be taken for a cause."""

import pytest

from backend.effects.catalogue import catalogue
from tests.diagnose.test_diagnosis import COARSE_S, RUB, drawing, study

__all__ = ["drawing"]  # a fixture

pytestmark = pytest.mark.timeout(600)

ONLY = frozenset(set(catalogue()) - {"coulomb_friction"})


class Enough(Exception):
    """The baseline is all that is looked at."""


def test_a_step_is_halved_until_its_error_cannot_be_taken_for_a_cause(drawing, monkeypatch):
    from backend.diagnose import run
    from backend.diagnose.which import Search

    looked_at = []

    def screen(self, cause):
        looked_at.append((self.subject.step_s, self.step_error(cause)))
        raise Enough

    monkeypatch.setattr(Search, "screen", screen)
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
