"""An end of travel that gives way, of a law that is not ours: a damped spring behind a gap, as MuJoCo's limits are."""

from dataclasses import replace

import numpy as np
import pytest

from backend.effects.catalogue import catalogue
from tests.diagnose.test_diagnosis import COARSE_S, INERTIA, LENGTH, MASS, drawing, study

__all__ = ["drawing"]  # a fixture

pytestmark = [pytest.mark.timeout(600), pytest.mark.nightly]

END = -0.35  # rad
OMEGA = 50.0  # rad/s: a blow lasts 30 ms, and a dead one at 5 rad/s enters by 40 mrad


def damped_spring(t, q, rate):
    """Critically damped, never a pull."""
    inertia, over = MASS * LENGTH**2 + INERTIA, END - q
    return max(inertia * OMEGA * (OMEGA * over - 2.0 * rate), 0.0) if over > 0.0 else 0.0


ANGLES = (0.9, 0.5, 1.4)  # the last is held out


@pytest.fixture(scope="module")
def found(drawing):
    from backend.diagnose.run import diagnose_study

    told = study(drawing, 3, torque=damped_spring, angles=ANGLES)
    only = frozenset(set(catalogue()) - {"joint_stop"})
    return diagnose_study(told, without=only, step_s=COARSE_S)


def test_a_soft_end_of_travel_is_named_and_stands_where_it_begins_to_hold(found):
    (effect,) = found.report.causes[0].effects
    assert (effect.kind, tuple(effect.on)) == ("joint_stop", ("j1",))
    lower, stiffness = effect.parameters["lower"], effect.parameters["stiffness_n_m_per_rad"]
    assert lower.value == pytest.approx(END, abs=0.02)
    inertia = MASS * LENGTH**2 + INERTIA
    assert 0.3 < stiffness.value / (inertia * OMEGA**2) < 3.0
    rms = np.sqrt(found.best.fitted.chi2 / found.best.fitted.r.size)
    assert rms < 4.0  # noises; a rigid end leaves more than ten


def test_an_end_of_travel_is_sought_where_the_drawing_goes_from_where_it_stood_still(found):
    """A fit of the drawing may let go elsewhere, to be less wrong about what follows a blow."""
    from backend.diagnose.switch import let_go, passed

    drawn = found.baseline.fitted
    led_off = replace(drawn, x=drawn.x + 0.5)  # starts, from where the frames stand, are all that is free
    off = np.abs(passed(led_off)["j1"][:, 0] - ANGLES[:2])
    assert off == pytest.approx(0.5, abs=0.05)
    q = let_go(led_off)["j1"]
    assert q[:, 0] == pytest.approx(ANGLES[:2], abs=2e-3)
    assert q.min() < END


def test_the_gap_is_that_of_the_whole_record_where_the_drawing_follows_a_part_of_it(found):
    from backend.diagnose.judgement import gap_power

    drawn, best = found.baseline.fitted, found.best.fitted
    assert drawn.fraction < best.fraction == 1.0
    assert gap_power(best, best, 0.1) == 0.1
    assert gap_power(drawn, best, 0.1) > 1000.0  # noise variances a sample: the blow comes later
