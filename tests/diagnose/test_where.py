"""Where something lies beyond doubt, and what is asked there."""

from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest

from backend.diagnose.where import beyond_doubt
from backend.diagnose.which import Search


class Acting(NamedTuple):
    """As much of a candidate as a level asks for."""

    name: str
    places: tuple[str, ...]
    sought: bool = False


@pytest.mark.parametrize(
    ("log_z", "place"),
    [
        ({"camera": 5.0, "joint:j1": 0.0}, "camera"),
        ({"camera": 4.0, "joint:j1": 0.0}, None),
        ({"camera": 0.0, "joint:j1": 0.0}, None),
        ({"marker:a": -900.0}, "marker:a"),
        ({}, None),
    ],
    ids=["a hundred and fifty to one", "fifty to one", "as likely", "one alone", "none"],
)
def test_a_place_is_beyond_doubt_by_a_hundred_to_one(log_z, place):
    assert beyond_doubt(log_z) == place


@pytest.mark.parametrize(
    ("place", "tried"), [(None, ["spring"]), ("camera", ["spring", "tilt"]), ("joint:j1", ["spring"])]
)
def test_all_that_acts_where_the_gap_lies_is_tried_however_little_it_promises(monkeypatch, place, tried):
    gains = {"spring": 100.0, "tilt": 0.5, "scale": 0.0}  # a size that does nothing is not tried anywhere
    at = {"spring": "joint:j1", "tilt": "camera", "scale": "camera"}
    candidates = [Acting(name, (at[name],)) for name in gains]
    about = SimpleNamespace(
        early=None,
        gain=lambda c: gains[c.name],
        ranking=lambda some: sorted(((c, gains[c.name]) for c in some), key=lambda pair: -pair[1]),
    )
    subject: Any = SimpleNamespace(library=SimpleNamespace(candidates=candidates))
    search, asked = Search(subject, lambda words: None, lambda: False), []
    monkeypatch.setattr("backend.diagnose.which.containing", lambda about, free: {})
    monkeypatch.setattr("backend.diagnose.which.is_new", lambda candidate, parent: True)
    monkeypatch.setattr(search, "screen", lambda parent: about)
    monkeypatch.setattr(search, "_join", lambda parent, about, candidate, *rest: asked.append(candidate.name))
    parent: Any = SimpleNamespace(candidates=(), names=(), fitted=SimpleNamespace(chi2=1.0, r=np.zeros(1)))
    search.level([parent], 8, place=place)
    assert asked == tried
