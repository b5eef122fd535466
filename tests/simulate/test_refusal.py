"""What a simulation would refuse is known before one is begun, by the same rules."""

import pandas as pd
import pytest

from backend.mechanism.read import parse_mechanism
from backend.mechanism.study import Experiment, Release, Study
from backend.simulate.refusal import refusals, study_refusals
from backend.simulate.run import simulate
from tests.mechanisms import document, double_pendulum, effect, pendulum


def askew(effects):
    """A double pendulum whose elbow turns about another axis than its shoulder."""
    drawn = document(double_pendulum(effects))
    for frame in ("frame_a", "frame_b"):
        drawn["joints"][1][frame]["quaternion_wxyz"] = [2**-0.5, 2**-0.5, 0.0, 0.0]
    return parse_mechanism(drawn)


def bare(effects):
    """A pendulum whose pin's size nobody drew."""
    drawn = pendulum(effects=effects)
    return drawn.model_copy(update={"joints": tuple(j.model_copy(update={"fit": None}) for j in drawn.joints)})


REFUSED = {
    "a bed across no axis": (
        askew([effect("bed", "surface_friction", "all", friction_coefficient=0.2)]),
        "'shoulder' and 'elbow' turn about axes 90 degrees apart",
    ),
    "a pin of no size": (
        bare([effect("rub", "pin_friction", ["pin"], friction_coefficient=0.2)]),
        "draw the joint with fit.pin_diameter_m",
    ),
    "a link that bends about no axis": (
        askew([effect("bend", "link_flexibility", [document(double_pendulum())["bodies"][1]["id"]])]),
        "give `axis`, in the body's axes",
    ),
    "a path that begins elsewhere": (
        pendulum(effects=[effect("crank", "prescribed_motion", ["pin"], q=1.0)]),
        "begins at 1 rad, the drawing stands at",
    ),
    "an end beyond the pose": (
        pendulum(effects=[effect("ends", "joint_stop", ["pin"], lower=0.5, upper=1.0)]),
        "beyond its end of travel at 0.5 rad",
    ),
}


@pytest.mark.parametrize("fault", REFUSED)
def test_what_simulate_refuses_is_told_in_the_same_words(fault):
    drawn, term = REFUSED[fault]
    (said,) = refusals(drawn)
    assert term in said
    with pytest.raises(ValueError) as refusal:  # noqa: PT011
        simulate(drawn, 0.1)
    assert str(refusal.value) == said


def test_what_can_be_let_go_is_not_refused():
    assert refusals(pendulum(effects=[effect("crank", "prescribed_motion", ["pin"], q=0.0)])) == []


def study(drawn, **given):
    positions = pd.DataFrame({"time_s": [0.0, 1.0], "joint": "pin", "q": [1.0, 1.0], "sigma": 1e-3})
    return Study(drawn, (Experiment("e1", "fit", Release(time_s=0.0), joint_positions=positions, **given),))


def test_a_study_may_begin_where_its_record_does():
    assert study_refusals(study(REFUSED["a path that begins elsewhere"][0])) == []
    (said,) = study_refusals(study(REFUSED["a pin of no size"][0]))
    assert "fit.pin_diameter_m" in said


def test_a_record_of_what_takes_none_is_told_of_its_experiment():
    drawn = pendulum(effects=[effect("oil", "viscous_friction", ["pin"])])
    row = pd.DataFrame({"time_s": [0.0], "effect": "oil", "parameter": "damping_n_m_s_per_rad", "value": [0.1]})
    (said,) = study_refusals(study(drawn, inputs=row))
    assert said.startswith("experiment 'e1': 'oil.damping_n_m_s_per_rad' takes no recorded input")
