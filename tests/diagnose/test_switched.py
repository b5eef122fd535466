"""What switches on, followed over growing shares of the records beside a smooth set that it must come near."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from backend.diagnose import switched

ROWS, DRAWN = 1000, 50.0
HARD, OPEN = 2.4, 1.05  # mean squares that a play leaves of any share, with smooth hard walls and with others


@pytest.fixture
def search(monkeypatch):
    """A library of one play, of whose walls nobody states how they rub."""
    rubbing = SimpleNamespace(name="clearance:j1", family="clearance", closer=(), leaves=OPEN)
    play = SimpleNamespace(name="clearance:j1", family="clearance", closer=(rubbing,), leaves=HARD)

    def fit(subject, choice, start, fractions, max_iterations=None, coarse=False):
        left = choice.candidates[0].leaves * ROWS
        return SimpleNamespace(choice=choice, x=start, chi2=left, r=np.zeros(ROWS), fraction=fractions[-1])

    monkeypatch.setattr(switched, "follows", lambda cause: False)
    monkeypatch.setattr(switched, "promising", lambda subject, play, *asked: (1.0, {"radial_m": 1e-3}, play))
    monkeypatch.setattr(switched, "start_of", lambda *asked: np.zeros(1))
    monkeypatch.setattr(switched, "begun_from", lambda *asked: np.zeros(2))
    monkeypatch.setattr(switched, "fit", fit)
    monkeypatch.setattr(switched, "mean_square", lambda left, share: left)
    monkeypatch.setattr(switched, "_settled", lambda search, cause: cause)
    subject = SimpleNamespace(
        library=SimpleNamespace(candidates=[play]),
        choose=lambda *members: SimpleNamespace(candidates=members, name=members[0].name),
    )
    return SimpleNamespace(
        subject=subject,
        cancelled=lambda: False,
        tell=lambda words: None,
        keep=lambda fitted: SimpleNamespace(fitted=fitted, log_z=-fitted.chi2),
    )


def leaving(left: float) -> Any:
    """A cause that leaves this mean square of every share."""
    return SimpleNamespace(fitted=left, names=(), values={})


@pytest.mark.parametrize(
    ("drawn", "rival", "left"),
    [(DRAWN, 3.0, HARD), (DRAWN, 1.1, OPEN), (1.0, 1.1, None)],
    ids=["near its rival it goes on", "far behind, its walls are opened", "what takes little off is given up"],
)
def test_play_that_falls_behind_is_tried_with_walls_as_they_come(search, drawn, rival, left):
    found = switched.switching(search, leaving(drawn), "clearance", {}, leaving(rival))
    assert [c.fitted.chi2 / ROWS for c in found] == ([] if left is None else [left])
