"""An unknown law gets no credit for what first order promises and no fit brings."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from backend.diagnose import overpromise as module
from backend.diagnose.cause import Cause
from backend.diagnose.fitted import Fitted, log_evidence
from backend.diagnose.overpromise import overpromise

ROWS = 400
T = np.linspace(0.0, 1.0, ROWS)
SLOPES = 100.0 * np.stack([np.sin(3.0 * T), np.sin(3.0 * T + 0.02)], 1)
"""Of two laws that move a mechanism nearly alike."""


def candidate(i: int) -> Any:
    return SimpleNamespace(
        name=f"law{i}",
        parameters=[None],
        log_odds=0.0,
        ties=lambda count: np.eye(count)[:, [i]],
    )


LAWS = [candidate(0), candidate(1)]
SUBJECT: Any = SimpleNamespace(
    library=SimpleNamespace(candidates=LAWS),
    choose=lambda: SimpleNamespace(parameters=[], prior_sd=np.zeros(0), start=np.zeros(0), own=0),
)


def ended(law: int, value: float, left: np.ndarray) -> Cause:
    """A fit of one law that ended at a value and left so much."""
    choice: Any = SimpleNamespace(
        parameters=[SimpleNamespace(name=f"size{law}", lower=-np.inf, start=0.0)],
        candidates=(LAWS[law],), own=1, start=np.zeros(1), prior_sd=np.ones(1), sizes=np.ones(1, bool),
    )  # fmt: skip
    made = Fitted(
        SUBJECT, choice, (), np.array([value]), left, SLOPES[:, [law]], (slice(0, ROWS),), np.ones(1),
        np.zeros(1, bool), "converged", 1.0, 0.0,
    )  # fmt: skip
    return Cause(made, log_evidence(made))


@pytest.mark.parametrize("bent", [0.0, 0.4])
def test_what_the_second_law_promises_about_the_motion_of_the_first(bent: float, monkeypatch: pytest.MonkeyPatch):
    """The truth is the second law. What its motion bends away from first order, only the fit of it knows."""
    monkeypatch.setattr(module, "library_slopes", lambda fitted, within, present: SLOPES)
    noise = np.random.default_rng(3).standard_normal(ROWS)
    bends = bent * np.sin(12.0 * T)
    seen = SLOPES[:, 1] + noise
    first = float(SLOPES[:, 0] @ seen / (SLOPES[:, 0] @ SLOPES[:, 0]))
    best = ended(0, first, seen - first * SLOPES[:, 0])
    other = ended(1, 1.0, noise + bends)
    promised = 0.5 * (np.sum((noise + bends) ** 2) - np.sum(noise**2))
    assert overpromise(best, [best, other], 1.0) == pytest.approx(promised, abs=1.0)
