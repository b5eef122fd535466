"""Libraries for drawings that hold effects, drives and tolerances already: each was an error, or a silent one, once."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from backend.diagnose.library import SMOOTH, library
from backend.diagnose.subject import _drivable
from backend.fit.free import free_parameters
from backend.mechanism.apart import set_apart
from backend.mechanism.read import parse_mechanism
from backend.mechanism.study import Tolerance
from backend.model.build import build
from backend.model.system import system
from tests.mechanisms import document, double_pendulum, drawing, effect, fourbar, pendulum, slider_crank


def candidates(mechanism, family=SMOOTH, **given):
    return {c.name: c for c in library(mechanism, family, **given).candidates}


def test_an_effect_on_several_places_is_one_at_each():
    drawn = slider_crank(effects=[
        effect("rub", "coulomb_friction", "all", friction_torque_n_m=0.01, friction_force_n=0.2),
        effect("loose", "clearance", ["main", "wrist"], radial_m=1e-4),
        effect("drag", "linear_drag", "all", n_s_per_m=0.1),
        effect("lean", "gravity_tilt", ["world"], roll_rad=0.1),
    ])  # fmt: skip
    apart = {e.id: e for e in set_apart(drawn, but={"drag"}).effects}
    joints = ("main", "crankpin", "wrist", "slide")
    assert set(apart) == {*(f"rub@{j}" for j in joints), "loose@main", "loose@wrist", "drag", "lean"}
    assert apart["rub@slide"].parameters == {"friction_force_n": 0.2}
    assert apart["rub@main"].parameters == {"friction_torque_n_m": 0.01}
    assert apart["drag"].on == "all"
    (alone,) = set_apart(pendulum(effects=[effect("rub", "viscous_friction", "all")])).effects
    assert (alone.id, alone.on) == ("rub", ("pin",))


@pytest.mark.parametrize(
    ("on", "shared"),
    [
        ("all", {"clearance:all"}),
        (["j1", "j2"], {"clearance:j1+j2", "clearance:j3+j4"}),
        (["j1"], {"clearance:all-j1"}),
    ],
)
def test_drawn_play_is_a_cause_where_it_stands_and_stays_while_another_is_tried(on, shared):
    drawn = set_apart(fourbar([effect("loose", "clearance", on, radial_m=2e-4)]))
    known = library(drawn, "clearance")
    system(build(drawn, known.added))  # never two clearances at one joint
    plays = {c.name: c for c in known.candidates if c.kind == "clearance"}
    assert {c.name for c in plays.values() if len(c.on) == 1} == {f"clearance:j{i}" for i in range(1, 5)}
    assert {c.name for c in plays.values() if len(c.on) > 1} == shared
    neutral = {p.name: value for p, value in zip(known.parameters, known.neutral, strict=True)}
    assert plays["clearance:j1"].parameters[0].start == 2e-4
    assert neutral["clearance:j1.radial_m"] == 2e-4
    assert neutral["clearance:j4.radial_m"] < (1e-3 if on == "all" else 1e-6)


def test_drawn_play_begins_at_the_fit_of_its_joint():
    parts = document(fourbar())
    parts["effects"] = [{"id": "loose", "kind": "clearance", "on": "all", "parameters": {}}]
    for joint in parts["joints"]:
        joint["fit"]["radial_clearance_m"] = 3e-4 if joint["id"] == "j2" else 1e-4
    (play,) = [c for c in library(set_apart(parse_mechanism(parts)), "clearance").candidates if c.on == ("j2",)
               and c.kind == "clearance"]  # fmt: skip
    assert play.parameters[0].start == 3e-4


def test_friction_drawn_everywhere_may_be_less_than_drawn_at_one_joint():
    drawn = set_apart(fourbar([effect("damped", "viscous_friction", "all", damping_n_m_s_per_rad=0.01)]))
    rub = candidates(drawn)["viscous_friction:j2"]
    assert [p.start for p in rub.parameters] == [0.01]
    assert not rub.one_sided.any()


def test_friction_drawn_at_some_joints_may_be_wrong_at_all_of_them_at_once():
    drawn = set_apart(fourbar([effect("damped", "viscous_friction", ["j2", "j3"], damping_n_m_s_per_rad=0.01)]))
    shared = {c.name: c for c in candidates(drawn).values() if c.kind == "viscous_friction" and len(c.on) > 1}
    assert {name: c.on for name, c in shared.items()} == {
        "viscous_friction:j1+j4": ("j1", "j4"), "viscous_friction:j2+j3": ("j2", "j3"),
    }  # fmt: skip
    assert [c.parameters[0].start for c in shared.values()] == [0.0, 0.01]
    assert len({c.parameters[0].name for c in shared.values()}) == 2
    alone = set_apart(fourbar([effect("damped", "viscous_friction", ["j2"], damping_n_m_s_per_rad=0.01)]))
    assert candidates(alone)["viscous_friction:all-j2"].on == ("j1", "j3", "j4")


def test_what_a_tolerance_alone_names_is_no_part_of_all():
    loose = [
        Tolerance(kind="length_error", on=("ground",), sd=0.01),
        Tolerance(kind="camera_scale", on=("knee",), sd=0.01),
    ]
    found = candidates(fourbar(), tolerances=loose)
    assert found["length_error:all"].on == ("crank", "coupler", "rocker")  # with the ground it were the whole picture's
    assert {"length_error:ground", "camera_scale:camera", "camera_scale:knee"} <= set(found)
    assert "camera_scale:all" not in found


def test_a_marker_and_a_joint_of_one_name_are_two_places():
    parts = document(fourbar())
    parts["markers"][0]["id"] = "j3"
    parts["bodies"][0]["id"] = "world"
    for joint in parts["joints"]:
        for side in ("body_a", "body_b"):
            joint[side] = "world" if joint[side] == "ground" else joint[side]
    found = candidates(parse_mechanism(parts))
    assert found["marker_offset:j3"].places == ("marker:j3",)
    assert found["viscous_friction:j3"].places == ("joint:j3",)
    assert found["gravity_tilt:world"].places == ("world",)
    assert found["camera_scale:camera"].places == ("camera",)


def test_while_one_link_is_tried_the_others_do_not_bend():
    known = library(double_pendulum(), "link_flexibility")
    bends = [c for c in known.candidates if c.kind == "link_flexibility"]
    assert [c.on for c in bends] == [("upper",), ("lower",), ("upper", "lower")]
    for c in bends:
        stiffness = next(i for i, p in zip(c.takes, c.parameters, strict=True) if p.unit == "N m/rad")
        assert all(known.neutral[i] > 1e6 for i in stiffness)
        assert c.parameters[0].start < 1e3


@pytest.mark.parametrize("kind", ["center_of_mass_error", "inertia_error"])
def test_a_tolerance_of_a_link_leaves_the_others_to_bend(kind):
    known = library(double_pendulum(), "link_flexibility", [Tolerance(kind=kind, on=["upper"], sd=1e-3)])
    assert {c.on for c in known.candidates if c.kind == "link_flexibility"} == {("lower",)}
    assert known.nuisances


def test_joints_that_turn_and_joints_that_slide_have_shared_causes_of_their_own():
    axes = [("a", "revolute", (0, 0, 1)), ("b", "revolute", (0, 0, 1)), ("c", "prismatic", (1, 0, 0)),
            ("d", "prismatic", (0, 1, 0))]  # fmt: skip
    links = [document(pendulum())["bodies"][1] | {"id": f"link{i}"} for i in range(4)]
    ends = ["ground", *(link["id"] for link in links)]
    joints = [(id, type, ends[i], ends[i + 1], (0.1 * i, 0, 0), axis) for i, (id, type, axis) in enumerate(axes)]
    found = [c for c in library(drawing("chain", links, joints), SMOOTH).candidates if c.kind == "viscous_friction"]
    assert len({c.name for c in found}) == len(found) == 6


def test_a_joint_whose_effort_is_on_record_may_have_an_offset_beside_it():
    drawn = pendulum(effects=[effect("motor", "effort_offset", ["pin"], torque_n_m=0.0)])
    (offset,) = [c for c in library(drawn, SMOOTH, driven=frozenset({"motor"})).candidates if c.kind == "effort_offset"]
    assert offset.parameters[0].addresses[0][0] != "motor"
    (plain,) = [c for c in library(drawn, SMOOTH).candidates if c.kind == "effort_offset"]
    assert plain.parameters[0].addresses[0][0] == "motor"


def test_a_spring_whose_length_is_on_record_may_be_stiffer_than_drawn():
    ends = {"anchor_a_m": [0.1, 0, 0], "anchor_b_m": [0.1, 0, 0.2], "free_length_m": 0.05, "stiffness_n_per_m": 100}
    drawn = pendulum(effects=[effect("rope", "extension_spring", ["link", "ground"], **ends)])
    assert "spring_stiffness_error:rope" in candidates(drawn, driven=frozenset({"rope"}))


def test_a_push_is_in_the_unit_of_the_first_joint_that_moves_by_itself_whatever_is_on_record():
    drawn = slider_crank(effects=[effect("hold", "prescribed_motion", ["main", "crankpin", "wrist"], q=0.0)])
    (push,) = candidates(drawn, driven=frozenset({"hold"}))["release_velocity:world"].parameters
    assert push.parameter == "m_per_s"


def test_unknown_forces_show_where_a_drive_leaves_a_freedom():
    def shows(drawn):
        told: Any = SimpleNamespace(mechanism=drawn)
        return _drivable(told)

    assert shows(fourbar([effect("drive", "prescribed_motion", ["j1"], q=0.0)])) == ()
    assert shows(double_pendulum([effect("drive", "prescribed_motion", ["shoulder"], q=0.0)])) == ("elbow",)
    assert set(shows(fourbar())) == {j.id for j in fourbar().joints}


@pytest.mark.parametrize("on", ["all", ["coil"]])
def test_springs_at_several_joints_keep_their_errors_and_tolerances(on):
    drawn = set_apart(fourbar([
        effect("coil", "torsion_spring", ["j1", "j2"], stiffness_n_m_per_rad=0.1),
        effect("soft", "spring_stiffness_error", on, relative=-0.2),
    ]))  # fmt: skip
    build(drawn)
    (one,) = free_parameters(drawn, ["spring_stiffness_error:coil"]).parameters
    assert (one.name, one.start, len(one.addresses)) == ("spring_stiffness_error:coil.relative", -0.2, 2)
    loose = [Tolerance(kind="spring_stiffness_error", on=("coil",), sd=0.05)]
    known = library(drawn, SMOOTH, loose)
    assert {known.parameters[i].addresses[0][0] for i in known.nuisances} == {"soft@coil@j1", "soft@coil@j2"}
    assert "spring_stiffness_error:coil@j1" in {c.name for c in known.candidates}


def test_where_no_joint_can_be_pushed_no_push_is_a_cause():
    parts = document(pendulum())
    parts["joints"][0]["type"] = "spherical"
    assert not any(c.kind == "release_velocity" for c in library(parse_mechanism(parts), SMOOTH).candidates)
    assert any(c.kind == "release_velocity" for c in library(pendulum(), SMOOTH).candidates)


def test_neutral_values_are_finite():
    for family in (SMOOTH, "clearance", "joint_stop", "link_flexibility"):
        assert np.all(np.isfinite(library(fourbar(), family).neutral))


def test_pins_that_are_all_loose_are_one_cause_with_walls_alike():
    known = library(fourbar(), "clearance")
    (play,) = [c for c in known.candidates if c.name == "clearance:all"]
    assert play.on == ("j1", "j2", "j3", "j4")
    assert [p.name for p in play.parameters] == ["clearance:all.radial_m"]
    assert play.closer
    for walls in play.closer:
        names = [[known.parameters[i].name for i in take] for take in walls.takes]
        assert [p.parameter for p in walls.parameters] == [one[0].rpartition(".")[2] for one in names]
        assert all(len(one) == 4 and len({n.rpartition(".")[2] for n in one}) == 1 for one in names)


def test_joints_do_not_all_end_their_travel_at_one_angle():
    assert all(len(c.on) == 1 for c in library(fourbar(), "joint_stop").candidates if c.kind == "joint_stop")
