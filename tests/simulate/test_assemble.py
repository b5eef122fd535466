"""Closing loops that are drawn a little open, and refusing those that cannot close."""

import equinox as eqx
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from backend.mechanism.read import parse_mechanism
from backend.model.build import build
from backend.model.state import drawn_pose
from backend.model.system import system
from backend.simulate.assemble import closed, free_motions, worst_gap
from backend.simulate.run import assembled, simulate
from backend.simulate.spectrum import rank
from tests.mechanisms import bar, bennett, document, double_pendulum, drawing, fourbar, scissor, slider_crank


def shifted(mechanism, body, by):
    """The drawing with one body's pose moved, its joints' frames where they were."""
    drawn = document(mechanism)
    (moved,) = [b for b in drawn["bodies"] if b["id"] == body]
    moved["pose"]["position_m"] = [float(x) for x in np.add(moved["pose"]["position_m"], by)]
    return parse_mechanism(drawn)


@pytest.fixture(scope="module")
def open_fourbar():
    """A four-bar whose coupler is drawn a millimetre beside its pins."""
    model = build(shifted(fourbar(), "coupler", (0.0006, -0.0008, 0.0)))
    return model, eqx.filter_jit(system)(model)


def test_a_loop_drawn_a_millimetre_open_is_told_so(open_fourbar):
    model, plant = open_fourbar
    gap = worst_gap(plant, drawn_pose(model, plant))
    assert gap.offset_m == pytest.approx(1e-3, rel=1e-9)
    assert gap.joint in ("j2", "j3")


def test_a_loop_drawn_a_millimetre_open_is_closed_nearby(open_fourbar):
    model, plant = open_fourbar
    drawn = drawn_pose(model, plant)
    pose = eqx.filter_jit(closed)(plant, drawn)
    assert worst_gap(plant, pose).offset_m < 1e-12
    assert np.abs(np.asarray(pose.position - drawn.position)).max() < 2e-3


def test_a_loop_that_no_pose_can_close_is_refused_with_joint_size_and_remedy():
    drawn = document(fourbar())
    (coupler,) = [j for j in drawn["joints"] if j["id"] == "j3"]
    coupler["frame_a"]["position_m"] = [0.9, 0.0, 0.0]  # a coupler longer than all other bars together
    model = build(parse_mechanism(drawn))
    plant = eqx.filter_jit(system)(model)
    with pytest.raises(ValueError, match=r"joint 'j\d' cannot be closed: \d.* mm and .* check the pin positions"):
        assembled(model, plant)


@pytest.mark.parametrize(
    ("drawn", "ways"),
    [(double_pendulum, 2), (fourbar, 1), (slider_crank, 1), (bennett, 1), (lambda: scissor(4), 2)],
    ids=["double pendulum", "fourbar", "slider-crank", "bennett", "scissor"],
)
def test_a_mechanism_moves_in_as_many_ways_as_its_rank_leaves(drawn, ways):
    model = build(drawn())
    plant = eqx.filter_jit(system)(model)
    assert free_motions(plant, drawn_pose(model, plant)).shape == (model.topology.slots, 6, ways)


def test_rank_is_read_from_the_largest_gap_of_the_spectrum():
    assert rank(np.array([3.0, 1.0, 0.5])) == 3
    assert rank(np.array([3.0, 1.0, 1e-12])) == 2
    assert rank(np.array([3.0, 1e-3, 2e-4, 1e-14])) == 3  # a nearly singular pose is not a redundant one
    assert rank(np.zeros(3)) == 0


@pytest.mark.parametrize(("duration", "step"), [(-1.0, 1e-3), (1.0, 0.0), (float("nan"), 1e-3)])
def test_a_duration_or_step_that_is_not_positive_is_refused(duration, step):
    with pytest.raises(ValueError, match="give a positive number of seconds"):
        simulate(fourbar(), duration, step)


def test_parts_turned_far_about_axes_that_lean_are_closed_at_once():
    """An arm about an axis that leans by 25 degrees, a bar that hangs from it: spatial turns do not commute."""
    lean = Rotation.from_rotvec([-0.436, 0.0, 0.0])
    arm, hang = bar("arm", (0, 0, 0), (0.22, 0, 0)), bar("hang", (0.22, 0, 0), (0.22, 0, -0.28))
    joints = [
        ("yaw", "revolute", "ground", "arm", (0, 0, 0), lean.apply([0.0, 0.0, 1.0])),
        ("hinge", "revolute", "arm", "hang", (0.22, 0, 0), (1.0, 0.0, 0.0)),
    ]
    model = build(drawing("leaning", [arm, hang], joints))
    plant = eqx.filter_jit(system)(model)
    pose = drawn_pose(model, plant)
    for motion in np.moveaxis(np.asarray(free_motions(plant, pose)), -1, 0):
        for size in (0.1, 0.2, 0.4):
            turned = eqx.filter_jit(closed)(plant, pose, size * motion)
            assert worst_gap(plant, turned).offset_m < 1e-11
            assert np.abs(np.asarray(turned.position - pose.position)).max() > 0.1 * size * 0.2
