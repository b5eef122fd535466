"""What a study calls loose is no finding while it is as loose as that, and is one well beyond."""

from dataclasses import replace

import pytest

from backend.mechanism.study import Tolerance
from tests.diagnose.test_diagnosis import COARSE_S, FEW, drawing, study

__all__ = ["drawing"]  # the bar that hangs and swings, as a fixture

pytestmark = pytest.mark.timeout(600)
LOOSE = Tolerance(kind="camera_scale", on=("camera",), sd=0.005)


@pytest.mark.parametrize(("scale", "named"), [(1.005, False), (1.05, True)])
def test_a_scale_is_a_finding_only_beyond_its_tolerance(drawing, scale, named):
    from backend.diagnose.run import diagnose_study

    told = replace(study(drawing, 2, places=lambda p: scale * p), tolerances=(LOOSE,))
    report = diagnose_study(told, without=FEW, step_s=COARSE_S).report
    assert sum(place.probability for place in report.where.locations) == pytest.approx(1.0, abs=1e-9)
    if not named:
        assert report.verdict == "none"
        assert report.suspected == []
        return
    assert report.verdict == "identified"
    (cause,) = report.causes[0].effects
    assert (cause.kind, list(cause.on)) == ("camera_scale", ["camera"])
    found = cause.parameters["relative"]
    assert abs(found.value - 0.05) < 3.0 * found.sd < 0.002
    assert report.causes[0].indistinguishable_from == []
