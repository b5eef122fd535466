"""An end of travel that gives way, of a law that is not ours: a damped spring behind a gap, as MuJoCo's limits are."""

import numpy as np
import pytest

from backend.effects.catalogue import catalogue
from tests.diagnose.test_diagnosis import COARSE_S, INERTIA, LENGTH, MASS, drawing, study

__all__ = ["drawing"]  # a fixture

pytestmark = pytest.mark.timeout(600)

END = -0.35  # rad
OMEGA = 50.0  # rad/s: a blow lasts 30 ms, and a dead one at 5 rad/s enters by 40 mrad


def damped_spring(t, q, rate):
    """Critically damped, never a pull."""
    inertia, over = MASS * LENGTH**2 + INERTIA, END - q
    return max(inertia * OMEGA * (OMEGA * over - 2.0 * rate), 0.0) if over > 0.0 else 0.0


def test_a_soft_end_of_travel_is_named_and_stands_where_it_begins_to_hold(drawing):
    from backend.diagnose.run import diagnose_study

    told = study(drawing, 3, torque=damped_spring, angles=(0.9, 0.5, 1.4))
    only = frozenset(set(catalogue()) - {"joint_stop"})
    found = diagnose_study(told, without=only, step_s=COARSE_S)
    (effect,) = found.report.causes[0].effects
    assert (effect.kind, tuple(effect.on)) == ("joint_stop", ("j1",))
    lower, stiffness = effect.parameters["lower"], effect.parameters["stiffness_n_m_per_rad"]
    assert lower.value == pytest.approx(END, abs=0.02)
    inertia = MASS * LENGTH**2 + INERTIA
    assert 0.3 < stiffness.value / (inertia * OMEGA**2) < 3.0
    rms = np.sqrt(found.best.fitted.chi2 / found.best.fitted.r.size)
    assert rms < 4.0  # noises; a rigid end leaves more than ten
