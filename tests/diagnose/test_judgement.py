"""What a verdict rests on, from what a search found."""

from types import SimpleNamespace

import numpy as np
import pytest

from backend.diagnose.adequacy import Adequacy
from backend.diagnose.judgement import Judgement
from backend.diagnose.library import SMOOTH
from backend.diagnose.shrink import Shrinkage
from backend.diagnose.unseen import Left


@pytest.mark.parametrize(
    ("family", "slight", "ci95", "verdict"),
    [
        ("clearance", True, (0.8, 0.96), "approximate"),  # blows: few held-out motions leave open that it is most of it
        ("clearance", True, (0.8, 0.89), "unknown"),
        ("clearance", False, (0.8, 0.96), "unknown"),  # it misses the fitted motions, too
        (SMOOTH, True, (0.8, 0.96), "unknown"),
    ],
)
def test_what_strikes_may_explain_most_of_a_held_out_gap(family, slight, ci95, verdict):
    fitted = SimpleNamespace(fraction=1.0)
    best = SimpleNamespace(candidates=(SimpleNamespace(family=family, name="it"),), fitted=fitted)
    drawn = SimpleNamespace(cause=SimpleNamespace(fitted=fitted, candidates=()), adequacy=None)
    search = SimpleNamespace(left=lambda cause, scale: Left(0.0, 0.3 if cause is best else 1.0), subject=None, tried={})
    climb = SimpleNamespace(
        enough=lambda judged: False, slight=lambda cause, judged: slight, large=False,
        names_a_remainder=lambda cause, enough: False,
    )  # fmt: skip
    judgement = Judgement(None, None, search, drawn, 1.0, np.random.default_rng(0), lambda said: None, 0.0)
    shrunk = Shrinkage(1.0, 0.5, 0.1, 0.86, ci95, 0.5)
    assert judgement._verdict(best, Adequacy(0.0, 1.0, 1.0, 1.0), climb, shrunk) == verdict
