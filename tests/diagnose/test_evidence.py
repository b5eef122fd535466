"""The evidence of a fit that ended where it should not have, or that never saw a start."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from backend.diagnose.adequacy import Adequacy
from backend.diagnose.fitted import Fitted, log_evidence

ROWS, SIZE = 200, 0.3


def fitted(end: float, start_seen: float = 50.0) -> Fitted:
    """A straight line of one size and one start, seen with unit noise; the fit ended at `end`."""
    rng = np.random.default_rng(0)
    t = np.linspace(0.0, 1.0, ROWS)
    J = np.stack([100.0 * t, np.full(ROWS, start_seen)], 1)
    r = J @ [SIZE - end, 0.0] + rng.standard_normal(ROWS)
    candidate = SimpleNamespace(parameters=[None])
    choice: Any = SimpleNamespace(
        parameters=[SimpleNamespace(lower=-np.inf, start=0.0)], candidates=[candidate], own=1,
        start=np.zeros(1), prior_sd=np.ones(1), sizes=np.ones(1, bool),
    )  # fmt: skip
    subject: Any = None
    ends = np.array([end, 0.0])
    return Fitted(
        subject, choice, (), ends, r, J, (slice(0, ROWS),), np.array([1.0, 0.0]), np.zeros(2, bool), "disagree", 1.0,
        0.0,
    )  # fmt: skip


def test_what_slopes_promise_where_a_fit_stuck_counts_for_nothing():
    stuck, there = fitted(0.2), fitted(SIZE)
    lost = 0.5 * (stuck.chi2 - there.chi2)
    assert lost > 100.0
    assert log_evidence(there) - log_evidence(stuck) == pytest.approx(lost, rel=0.05)


def test_a_start_that_no_sample_sees_makes_no_evidence_infinite():
    seen, unseen = log_evidence(fitted(SIZE)), log_evidence(fitted(SIZE, start_seen=0.0))
    assert np.isfinite(unseen)
    assert unseen - seen < 12.0  # a start known to 1.4e-3 instead of to ten


def test_what_a_lost_motion_leaves_is_no_smaller_for_passing_as_noise():
    lost, followed = Adequacy(0.0, 40.0, 41.0, 35.0), Adequacy(0.0, 900.0, 910.0, 4.7)
    assert lost.excess < followed.excess
    assert lost.power > followed.power
