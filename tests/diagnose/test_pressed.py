"""A number that the data press against its bound: no longer free, so it hides nothing that moves alike."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import backend.diagnose.screen as module
from backend.diagnose.fitted import Fitted, log_evidence

ROWS = 200
T = np.linspace(0.0, 1.0, ROWS)


def ended(value: float, held: bool, *, size: bool = True, start: float = 0.0) -> Fitted:
    """A fit of one law, sin(7 t), of which 5 sigmas are left."""
    choice: Any = SimpleNamespace(
        own=1, start=np.full(1, start), ties=np.eye(2, 1), parameters=[SimpleNamespace(lower=0.0, start=start)],
        prior_sd=np.ones(1), sizes=np.array([size]), candidates=[SimpleNamespace(parameters=[None])],
    )  # fmt: skip
    subject: Any = SimpleNamespace()
    r, J = 5.0 * np.sin(7.0 * T), np.sin(7.0 * T)[:, None]
    return Fitted(
        subject, choice, (), np.array([value]), r, J, (slice(0, ROWS),), np.ones(1), np.array([held]), "converged",
        1.0, 0.0,
    )  # fmt: skip


@pytest.mark.parametrize(("held", "seen"), [(True, 1.0), (False, 0.02)])
def test_what_moves_alike_is_seen_once_a_number_rests_at_its_bound(
    held: bool, seen: float, monkeypatch: pytest.MonkeyPatch
):
    """The second effect does 1.2 times what the first does."""
    slopes = np.outer(np.sin(7.0 * T), [1.0, 1.2])
    monkeypatch.setattr(module, "library_slopes", lambda fitted: slopes)
    monkeypatch.setattr(module, "Seer", lambda *_: None)
    monkeypatch.setattr(module, "LARGE", np.inf)
    about = module.screen(SimpleNamespace(), ended(3.0, held))  # type: ignore[arg-type]
    assert np.linalg.norm(about.S[:, 1]) == pytest.approx(seen * np.linalg.norm(slopes[:, 1]), abs=0.02 * ROWS**0.5)
    assert np.any(about.S[:, 0]) == 0


def test_only_what_is_there_is_pressed():
    assert ended(3.0, True).pressed
    assert not ended(3.0, False).pressed
    assert not ended(0.0, True).pressed  # absent: friction that the data would have push


def test_a_shape_that_may_be_nothing_is_half_believed_to_be():
    """Friction that gives not at all is rigid friction, not friction at the end of its range."""
    rigid = ended(0.0, True, size=False, start=0.5)
    assert not rigid.pressed
    assert ended(0.0, True, start=0.5).pressed
    without = -0.5 * rigid.chi2  # of no number at all
    assert log_evidence(rigid) == pytest.approx(without + np.log(0.5))
