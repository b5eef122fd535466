"""What a run refuses, with the number and the remedy."""

import pytest

from backend.model.build import build
from backend.model.system import system
from backend.simulate.run import simulate
from backend.simulate.standing import check_ends
from tests.mechanisms import effect, pendulum


def test_more_steps_than_a_machine_can_hold_are_refused_at_once():
    with pytest.raises(ValueError, match=r"1e\+18 steps; choose them so that 1 to 2e\+06"):
        simulate(pendulum(), 1e6, 1e-12)


def test_a_duration_shorter_than_a_step_is_refused():
    with pytest.raises(ValueError, match=r"0.001 s in steps of 0.1 s is 0.01 steps"):
        simulate(pendulum(), 1e-3, 0.1)


def test_a_path_that_begins_away_from_the_drawing_is_refused():
    (joint,) = pendulum().joints
    driven = pendulum(effects=[effect("drive", "prescribed_motion", [joint.id], q=0.5)])
    with pytest.raises(ValueError, match=r"'drive'.*begins at 0.5 rad, the drawing stands at"):
        simulate(driven, 0.1)


def test_a_joint_drawn_beyond_a_rigid_end_is_refused_and_one_pressed_into_a_soft_end_is_not():
    ends = {"lower": 0.5, "upper": 1.0}
    with pytest.raises(ValueError, match=r"'ends': joint 'pin' is drawn at .*, beyond its end of travel at 0.5 rad"):
        simulate(pendulum(effects=[effect("ends", "joint_stop", ["pin"], **ends)]), 0.1)
    soft = pendulum(effects=[effect("ends", "joint_stop", ["pin"], **ends, stiffness_n_m_per_rad=10.0)])
    model = build(soft)
    check_ends(model, system(model))


def test_pin_friction_on_all_asks_for_every_pins_size():
    drawn = pendulum(effects=[effect("rub", "pin_friction", "all", friction_coefficient=0.1)])
    bare = drawn.model_copy(update={"joints": tuple(j.model_copy(update={"fit": None}) for j in drawn.joints)})
    with pytest.raises(ValueError, match=r"needs the pin's size; draw the joint with fit.pin_diameter_m"):
        simulate(bare, 0.1)
