"""What a study calls loose is no finding while it is as loose as that, and is one well beyond."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from backend.diagnose.library import SMOOTH, library
from backend.diagnose.screen import Screen
from backend.mechanism.study import Tolerance
from tests.diagnose.test_diagnosis import COARSE_S, FEW, drawing, study

__all__ = ["drawing"]  # the bar that hangs and swings, as a fixture

pytestmark = pytest.mark.timeout(600)
LOOSE = Tolerance(kind="camera_scale", on=("camera",), sd=0.005)


def test_each_number_of_a_shared_cause_begins_where_its_own_tolerances_are(drawing):
    """Both marks of a bar, loose along and across: 1 and 2 mm along, 5 and 7 mm across."""
    loose = [Tolerance(kind="marker_offset", on=("tip", "mid"), sd=0.01)]
    known = library(drawing, SMOOTH, loose)
    (shared,) = [c for c in known.candidates if c.name == "marker_offset:all"]
    held = [known.parameters[i] for i in known.nuisances]
    at = {f"{marker}.{number}": 1e-3 * mm for marker, number, mm in
          (("tip", "dx_m", 1), ("tip", "dy_m", 5), ("mid", "dx_m", 2), ("mid", "dy_m", 7))}  # fmt: skip
    values = np.array([at[p.name.partition(":")[2]] for p in held])
    choice: Any = SimpleNamespace(parameters=held, prior_sd=np.full(len(held), 0.01))
    about = Screen(
        cast("Any", SimpleNamespace(library=known)), cast("Any", SimpleNamespace(choice=choice, values=values)),
        np.zeros((3, len(known.parameters))), np.zeros(3), np.zeros(0), np.zeros((0, len(known.parameters))),
    )  # fmt: skip
    begin = {name.rpartition(".")[2]: value for name, value in about.guess(shared).items()}
    assert begin == pytest.approx({"dx_m": 1.5e-3, "dy_m": 6e-3})


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
