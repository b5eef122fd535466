"""A spring that nobody drew, resting beyond all that was filmed: about its drawn angle it would have to push."""

import numpy as np
import pytest

from backend.diagnose.library import SMOOTH, families, library
from tests.diagnose.test_diagnosis import COARSE_S, drawing, run_often, study  # noqa: F401
from tests.mechanisms import fourbar

STIFF, REST = 0.05, 1.5


@pytest.mark.nightly
@pytest.mark.timeout(600)
def test_a_spring_that_rests_beyond_every_pose_is_found(drawing):  # noqa: F811
    from backend.diagnose.run import diagnose_study

    told = study(drawing, 5, torque=lambda t, q, rate: -STIFF * (q - REST), angles=(0.9, 1.2, 0.7), frames=24)
    others = frozenset(kind for kinds in families().values() for kind in kinds) - {"torsion_spring", "viscous_friction"}
    best = diagnose_study(told, without=others, step_s=COARSE_S).report.causes[0].effects
    assert [(e.kind, e.on) for e in best] == [("torsion_spring", ("j1",))]
    for name, true in (("stiffness_n_m_per_rad", STIFF), ("rest_rad", REST)):
        found = best[0].parameters[name]
        assert found.sd is not None
        assert abs(found.value - true) < 3.0 * found.sd < true


def test_steps_along_a_springs_responses_say_where_it_rests():
    spring = next(c for c in library(fourbar(), SMOOTH).candidates if c.kind == "torsion_spring")
    expected = spring.prior_sd
    for off in ([2.0, 0.5], [0.3, -1.0], [1.0, 0.0]):
        told = np.array(off) * expected
        assert spring.offsets(spring.steps(told)) == pytest.approx(told)
    pushing = spring.offsets(np.array([-1.0, 0.5]) * expected)
    assert pushing[0] > 0.0
    assert pushing[1] == pytest.approx(3.0 * expected[1])
    assert spring.offsets(np.zeros(2)).tolist() == [0.0, 0.0]


def test_a_spring_that_would_push_gains_nothing_and_one_that_pulls_from_afar_may():
    spring = next(c for c in library(fourbar(), SMOOTH).candidates if c.kind == "torsion_spring")
    steps = np.array([[1.0, 0.0], [-1.0, 0.5], [-0.1, 1.0]]) * spring.prior_sd
    assert spring.allows(steps).tolist() == [True, False, True]
