"""What a cause may leave of a gap, as no law is exact, where the drawing follows the motion and where it does not."""

from types import SimpleNamespace
from typing import Any

import pytest

from backend.diagnose import standards as module
from backend.diagnose.standards import BLOWS, SMALL, WIDE
from backend.diagnose.standards import AbstractStandards as Standards

GAP = 1000.0  # noise variances a sample


@pytest.mark.parametrize(
    ("followed", "strikes", "fraction", "whole", "share"),
    [
        (1.0, False, 1.0, 0.0, SMALL), (1.0, True, 1.0, 0.0, BLOWS),
        (0.4, False, 1.0, GAP, 0.0), (0.4, True, 1.0, GAP, SMALL), (0.4, True, 0.6, GAP, 0.0),
        (0.4, True, 1.0, float("inf"), 0.0),
    ],
    ids=["of what is smooth", "of a blow", "smooth, where the drawing loses the motion", "a blow there",
         "a blow that does not reach the end", "where the drawing has no motion to the end"],
)  # fmt: skip
def test_what_a_right_law_of_slightly_wrong_form_leaves(monkeypatch, followed, strikes, fraction, whole, share):
    monkeypatch.setattr(module, "strikes", lambda candidates: strikes)
    monkeypatch.setattr(module, "mean_square", lambda fitted, fraction: whole + 1.0)
    standards: Any = object.__new__(Standards)
    standards.search, standards.baseline = SimpleNamespace(followed=followed), SimpleNamespace(fitted=None)
    standards.at_base = SimpleNamespace(power=GAP)  # of what the drawing follows
    cause: Any = SimpleNamespace(candidates=(), fitted=SimpleNamespace(fraction=fraction))
    allowed = share**2 * min(GAP, WIDE)
    for times in (0.9, 1.1):
        left: Any = SimpleNamespace(power=times * (allowed or 1e-9))
        assert standards.slight(cause, left) == (times < 1.0 and share > 0.0)
