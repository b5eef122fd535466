"""Slopes by differences, for walls that rub, are those of the motion where it is smooth."""

import numpy as np
import pytest

from tests.diagnose.test_diagnosis import COARSE_S, drawing, study

__all__ = ["drawing"]  # a fixture

pytestmark = pytest.mark.timeout(600)


def test_differences_are_the_exact_slopes_of_a_smooth_motion(drawing):
    from backend.diagnose.fitted import start_of
    from backend.diagnose.library import SMOOTH, library
    from backend.diagnose.seer import Seer
    from backend.diagnose.subject import prepare
    from backend.effects.catalogue import catalogue

    told = study(drawing, 2, lambda t, q, rate: -4e-3 * rate)
    other = frozenset(set(catalogue()) - {"viscous_friction", "mass_error"})
    subject = prepare(told, library(drawing, SMOOTH, told.tolerances, other), COARSE_S)
    choice = subject.choose(*(c for c in subject.library.candidates if c.name == "viscous_friction:j1"))
    seer = Seer(subject, [subject.chosen(p, choice) for p in subject.fit])
    x = start_of(subject, choice)
    x[0] += choice.prior_sd[0]
    r, J = seer(x)
    wide = np.full(x.size, np.inf)
    found = seer.across(x, np.zeros_like(J), choice.prior_sd, -wide, wide)
    assert np.array_equal(seer.left(x), r)
    assert np.abs(found - J).max(0) == pytest.approx(0.0, abs=2e-3 * np.abs(J).max(0).min())
    assert not np.any(found[seer.rows[0], -1])  # another run's start


def test_a_motion_with_loose_pins_is_the_same_by_the_program_that_makes_no_slopes(drawing):
    from backend.diagnose.fitted import start_of
    from backend.diagnose.library import library
    from backend.diagnose.seer import Seer
    from backend.diagnose.subject import prepare
    from backend.effects.catalogue import catalogue

    told = study(drawing, 2, lambda t, q, rate: -4e-3 * rate)
    other = frozenset(set(catalogue()) - {"clearance", "camera_scale"})
    subject = prepare(told, library(drawing, "clearance", told.tolerances, other), COARSE_S)
    choice = subject.choose(
        *(c for c in subject.library.candidates if c.name in ("clearance:j1", "camera_scale:camera"))
    )
    seer = Seer(subject, [subject.chosen(p, choice).first(0.3) for p in subject.fit], 0.3)
    assert all(p.loose for p in seer.probes)
    x = start_of(subject, choice)
    x[: choice.own] += choice.prior_sd[: choice.own]
    subject.put_back([np.full(p.data.time_s.size, 1e-4) for p in (*subject.fit, *subject.held_out)])
    left, (r, _) = seer.left(x), seer(x)
    np.testing.assert_allclose(left, r, rtol=1e-6, atol=1e-6 * np.abs(r).max())
