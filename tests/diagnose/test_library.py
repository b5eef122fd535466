"""The library of causes: whatever the effects' files declare, at every place, and nothing that was left out."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from backend.diagnose.heard import alike, heard
from backend.diagnose.library import LOAD, SMOOTH, families, library
from backend.diagnose.switch import SHARES, openings
from backend.effects.catalogue import catalogue
from backend.mechanism.study import Tolerance
from tests.mechanisms import bennett, double_pendulum, effect, fourbar, scissor

EXPECTED = [k for k, e in catalogue().items() if any(d.expected is not None for d in e.declarations().values())]


def test_every_effect_that_says_how_large_it_may_be_is_a_cause_at_once():
    kinds = {k for family in families().values() for k in family}
    assert kinds == set(EXPECTED) - {"gravity", "link_contact"}


@pytest.mark.parametrize("kind", ["coulomb_friction", "camera_scale"])
def test_an_effect_left_out_is_no_candidate_anywhere(kind):
    found = library(fourbar(), SMOOTH, without=frozenset({kind}))
    assert all(c.kind != kind for c in found.candidates)
    assert any(c.kind == kind for c in library(fourbar(), SMOOTH).candidates)


def test_a_cause_stands_at_each_place_and_at_all_of_them_together():
    found = {c.name for c in library(fourbar(), SMOOTH).candidates}
    joints = [j.id for j in fourbar().joints]
    assert {f"viscous_friction:{j}" for j in joints} | {"viscous_friction:all"} <= found


def test_bars_are_not_all_off_balance_to_the_same_side():
    found = {c.name for c in library(fourbar(), SMOOTH).candidates}
    assert "mass_error:all" in found
    assert "center_of_mass_error:all" not in found
    assert {f"center_of_mass_error:{b}" for b in ("crank", "coupler", "rocker")} <= found


def test_an_axis_leans_where_rigid_parts_can_follow():
    def leans(drawn):
        return {c.on for c in library(drawn, SMOOTH).candidates if c.kind == "joint_axis_error" and len(c.on) == 1}

    assert leans(double_pendulum()) == {(j.id,) for j in double_pendulum().joints}
    assert leans(fourbar()) == leans(bennett()) == set()
    assert leans(scissor(2)) == {("root",)}  # in no loop


def test_causes_that_change_the_structure_stand_apart():
    assert {"clearance", "joint_stop", "link_flexibility", LOAD} <= set(families())
    stops = [c for c in library(fourbar(), "joint_stop").candidates if c.kind == "joint_stop"]
    assert len(stops) == 2 * len(fourbar().joints)  # each end by itself


def test_a_drawn_end_of_travel_is_tried_where_it_is_drawn_too():
    drawn = fourbar([effect("end", "joint_stop", [fourbar().joints[0].id], lower=-0.6)])
    known = library(drawn, "joint_stop")
    lower, upper = [c for c in known.candidates if c.kind == "joint_stop" and c.on == (drawn.joints[0].id,)]
    subject: Any = SimpleNamespace(neutral=np.array(known.neutral), size_of=lambda joint: 1.0)
    passed = {drawn.joints[0].id: np.array([[0.3, 0.5, -0.5], [0.2, 0.6, -0.6]])}
    found = [next(iter(values.values())) for values in openings(subject, lower, passed)]
    assert found == pytest.approx([*(0.2 - 0.8 * share for share in SHARES), -0.6])
    assert [next(iter(v.values())) for v in openings(subject, upper, passed)] == pytest.approx(
        [0.3 + 0.3 * share for share in SHARES]
    )


def test_what_a_drawing_leaves_loose_is_a_finding_only_well_beyond_it():
    loose = Tolerance(kind="length_error", on="all", sd=0.02)
    found = library(fourbar(), SMOOTH, [loose])
    assert found.nuisances
    causes = [c for c in found.candidates if c.kind == "length_error"]
    assert causes
    assert all(c.prior_sd.min() >= 0.06 for c in causes)


def test_every_kind_is_as_likely_as_the_next_wherever_it_may_act():
    found = library(fourbar(), SMOOTH).candidates
    kinds = {c.kind for c in found}
    for kind in kinds:
        assert sum(c.share for c in found if c.kind == kind) == pytest.approx(len(found) / len(kinds))


def test_a_joint_reaches_the_bodies_that_it_joins_but_not_the_ground():
    joint = fourbar().joints[0]
    (friction,) = [c for c in library(fourbar(), SMOOTH).candidates if c.name == f"viscous_friction:{joint.id}"]
    moving = {f"body:{b.id}" for b in fourbar().bodies if not b.fixed and b.id in (joint.body_a, joint.body_b)}
    assert friction.reach == {f"joint:{joint.id}"} | moving


def test_dry_friction_brings_how_far_it_gives_where_a_joint_of_its_type_has_that():
    (rub,) = [c for c in library(fourbar(), SMOOTH).candidates if c.name == "coulomb_friction:j1"]
    assert [p.parameter for p in rub.parameters] == ["friction_torque_n_m", "presliding_rad"]
    (shaped,) = rub.closer
    assert [p.parameter for p in shaped.parameters] == ["friction_torque_n_m", "presliding_rad", "onset_rad_per_s"]
    assert rub.sizes.tolist() == [True, False]
    assert shaped.sizes.tolist() == [True, False, False]
    (next_,) = [c for c in library(fourbar(), SMOOTH).candidates if c.name == "coulomb_friction:j2"]
    assert [p.name for p in next_.shaped_as(shaped).parameters][-1] == "coulomb_friction:j2.onset_rad_per_s"
    assert next_.shaped_as(rub) is next_
    assert rub.allows(np.array([0.1, -1.0]))
    assert not rub.allows(np.array([-0.1, 1.0]))  # friction does not drive


def test_a_drawn_friction_stands_as_it_is_drawn():
    drawn = fourbar([effect("dry", "coulomb_friction", ["j1"], friction_torque_n_m=0.01)])
    found = library(drawn, SMOOTH)
    at = {p.name: (p.start, value) for p, value in zip(found.parameters, found.neutral, strict=True)}
    own = [p.name for p in found.parameters if p.kind == "coulomb_friction" and p.addresses[0][0] == "dry"]
    assert {name.rpartition(".")[2]: at[name] for name in own} == {
        "friction_torque_n_m": (0.01, 0.01), "presliding_rad": (0.0, 0.0), "onset_rad_per_s": (0.0, 0.0),
    }  # fmt: skip


def test_a_number_that_moves_nothing_to_first_order_is_not_free_beside_one_that_does():
    found = library(fourbar(), SMOOTH)
    loudness = np.ones(len(found.parameters))
    silent = next(i for i, p in enumerate(found.parameters) if p.name == "gravity_tilt:world.roll_rad")
    loudness[silent] = 1e-9
    tilt = {c.name: c for c in heard(found, loudness).candidates}["gravity_tilt:world"]
    assert [p.parameter for p in tilt.parameters] == ["pitch_rad"]
    assert tilt.ties(loudness.size).sum() == 1.0
    others = [c for c in heard(found, loudness).candidates if c.kind != "gravity_tilt"]
    assert others == [c for c in found.candidates if c.kind != "gravity_tilt"]
    beside = {c.name: c for c in alike(library(fourbar(), "clearance"), heard(found, loudness)).candidates}
    assert beside["gravity_tilt:world"].parameters == tilt.parameters
    assert any(c.kind == "clearance" for c in beside.values())


@pytest.mark.parametrize("kind", ["camera_tilt", "lens_distortion"])
def test_where_a_camera_aims_stays_free_although_it_moves_nothing_before_there_is_a_tilt(kind):
    found = library(fourbar(), SMOOTH)
    loudness = np.array([0.0 if "aim" in p.name else 1.0 for p in found.parameters])
    of_it = {c.name: c for c in heard(found, loudness).candidates}[f"{kind}:camera"]
    assert {"aim_right_m", "aim_down_m"} < {p.parameter for p in of_it.parameters}
    assert of_it.prior_sd.min() > 0.0


def test_which_row_a_clock_speaks_of_tells_its_slope_before_there_is_a_rolling_shutter():
    found = library(fourbar(), SMOOTH)
    rolling = next(c for c in found.candidates if c.kind == "rolling_shutter")
    size, shape = rolling.proportional
    assert [rolling.parameters[i].parameter for i in (size, shape)] == ["readout_s", "stamped_row"]
    assert {name.rpartition(".")[2] for name in rolling.told} == {"readout_s", "stamped_row"}
    late = rolling.offsets(np.array([0.0, -1.0]))  # a clock that is late altogether: a readout of rows all on one side
    assert late[size] > 0.0
    assert rolling.steps(late)[shape] == pytest.approx(-1.0)


def test_how_far_off_a_leaning_camera_stands_is_free_once_its_tilt_came_out_best():
    tilt = next(c for c in library(fourbar(), SMOOTH).candidates if c.kind == "camera_tilt")
    (shaped,) = tilt.closer
    assert {p.parameter for p in shaped.parameters} - {p.parameter for p in tilt.parameters} == {"distance_m"}
    (distance,) = (p for p in shaped.parameters if p.parameter == "distance_m")
    assert distance.start > distance.prior_sd > 0.0


def test_where_a_spring_rests_stays_free_although_it_moves_nothing_before_there_is_a_spring():
    found = library(fourbar(), SMOOTH)
    loudness = np.array([0.0 if p.parameter == "rest_rad" else 1.0 for p in found.parameters])
    spring = next(c for c in heard(found, loudness).candidates if c.kind == "torsion_spring" and len(c.on) == 1)
    assert [p.parameter for p in spring.parameters] == ["stiffness_n_m_per_rad", "rest_rad"]
    loudness = np.array([50.0 if p.parameter == "rest_rad" else 1.0 for p in found.parameters])  # it hardly moves
    spring = next(c for c in heard(found, loudness).candidates if c.kind == "torsion_spring" and len(c.on) == 1)
    assert [p.parameter for p in spring.parameters] == ["stiffness_n_m_per_rad", "rest_rad"]
    assert spring.sizes.tolist() == [True, False]


def test_where_nothing_moves_every_number_stays():
    found = library(fourbar(), SMOOTH)
    assert heard(found, np.zeros(len(found.parameters))) == found


@pytest.mark.parametrize(("moving", "shared"), [(("rocker",), False), (("rocker", "coupler"), True)])
def test_what_one_place_alone_can_show_is_that_places_own(moving, shared):
    """Of bodies that are told how to move nobody sees the inertia."""
    found = library(fourbar(), SMOOTH)
    silent = [p.kind == "inertia_error" and not set(p.on) & set(moving) for p in found.parameters]
    names = {c.name for c in heard(found, np.where(silent, 0.0, 1.0)).candidates if c.kind == "inertia_error"}
    assert {f"inertia_error:{body}" for body in moving} <= names
    assert ("inertia_error:all" in names) == shared
