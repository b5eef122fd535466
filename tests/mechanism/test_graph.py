"""Facts of well-known mechanisms that need no simulation."""

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backend.mechanism.check import check_json, check_text
from backend.mechanism.constraints import (
    HELD,
    drawn,
    jacobian,
    residual,
    rotation,
    rotation_vector,
    rows,
    size_m,
)
from backend.mechanism.graph import describe
from backend.mechanism.mobility import rank_at
from backend.mechanism.read import parse_mechanism


def report(document):
    return describe(parse_mechanism(document))


def test_a_pendulum_turns_and_has_no_loop(drawings):
    found = report(drawings.pendulum())
    assert (found.mobility.by_rank, found.mobility.by_count_in_space, found.mobility.by_count_in_plane) == (
        1,
        1,
        1,
    )
    assert found.loops == ()
    assert found.mobility.redundant_rows == 0
    assert found.ok


def test_a_fourbar_has_one_loop_and_three_rows_too_many_in_space(drawings):
    found = report(drawings.fourbar())
    assert {*found.loops[0].bodies} == {"ground", "crank", "coupler", "rocker"}
    assert len(found.loops) == 1
    assert found.mobility.by_count_in_space == -2  # 6 x 3 - 5 x 4
    assert found.mobility.by_count_in_plane == 1  # 3 x 3 - 2 x 4
    assert found.mobility.by_rank == 1
    assert found.mobility.redundant_rows == 3
    assert sum(found.mobility.redundant_by_joint.values()) == 3
    assert found.closes


def test_a_loop_names_joints_that_connect_its_neighbouring_bodies(drawings):
    mechanism = parse_mechanism(drawings.scissor(4))
    assert all(len(loop.joints) == 4 for loop in describe(mechanism).loops)  # one cell each, none around two
    fixed = {body.id for body in mechanism.bodies if body.fixed}
    for loop in describe(mechanism).loops:
        assert len(loop.bodies) == len(loop.joints) == len(set(loop.joints))
        for at, id in enumerate(loop.joints):
            ends = {mechanism.joint(id).body_a, mechanism.joint(id).body_b}
            assert ends - fixed == {loop.bodies[at], loop.bodies[(at + 1) % len(loop.bodies)]} - fixed


def test_a_slider_crank_moves_one_way(drawings):
    found = report(drawings.slider_crank())
    assert found.mobility.by_count_in_plane == found.mobility.by_rank == 1
    assert found.mobility.by_count_in_space == -2
    assert found.mobility.redundant_rows == 3
    slide = next(joint for joint in found.closure if joint.joint == "S")
    assert slide.q == pytest.approx(0.05 * math.cos(0.7) + math.sqrt(0.15**2 - (0.05 * math.sin(0.7)) ** 2))


@pytest.mark.parametrize("cells", [2, 3, 7])
def test_a_scissor_has_three_redundant_rows_for_each_cell_beyond_the_first(drawings, cells):
    found = report(drawings.scissor(cells))
    assert len(found.loops) == cells - 1
    assert found.mobility.by_rank == found.mobility.by_count_in_plane == 1
    assert found.mobility.by_count_in_space == 4 - 3 * cells
    assert found.mobility.redundant_rows == 3 * (cells - 1)
    assert sum(found.mobility.redundant_by_joint.values()) == 3 * (cells - 1)
    assert {*found.mobility.redundant_by_joint.values()} == {3}  # each loop repeats its three out-of-plane rows


def test_bennetts_linkage_moves_although_the_count_forbids_it(drawings):
    found = report(drawings.bennett())
    assert found.mobility.by_count_in_space == -2
    assert found.mobility.by_count_in_plane is None
    assert found.mobility.redundant_rows == 3
    assert found.mobility.by_rank == 1
    assert found.closes
    assert max(joint.gap_mm for joint in found.closure) < 1e-9  # the hand-written loop closes to rounding


def test_a_bennett_linkage_with_a_wrong_twist_is_locked(drawings):
    document = drawings.bennett()
    # One axis leant by 0.2 rad about its own x in both bodies: the loop still meets, and nothing moves.
    q = document["joints"][2]["frame_a"]["quaternion_wxyz"]
    c, s = math.cos(0.1), math.sin(0.1)
    w, x, y, z = q
    leant = [w * c - x * s, x * c + w * s, y * c + z * s, z * c - y * s]
    document["joints"][2]["frame_a"]["quaternion_wxyz"] = leant
    document["joints"][2]["frame_b"]["quaternion_wxyz"] = leant
    assert report(document).mobility.by_rank == 0


def test_a_flat_parallelogram_gains_a_freedom_at_its_change_point(drawings):
    found = report(drawings.fourbar(ground=0.08, crank=0.03, coupler=0.08, rocker=0.03, angle=0.0))
    assert found.mobility.by_rank == 2
    assert found.mobility.by_count_in_plane == 1


def test_a_loop_that_cannot_close_names_the_link_that_is_too_long(drawings):
    document = drawings.fourbar(ground=0.08, crank=0.02, coupler=0.14, rocker=0.03)
    found = report(document)
    assert not found.ok
    (sentence,) = found.errors
    assert "cannot close: coupler 140 mm is longer than" in sentence
    for term in ("ground 80", "crank 20", "rocker 30", 'Shorten "coupler" by at least 10 mm', '"B" and "C"'):
        assert term in sentence


def test_a_slightly_open_loop_is_a_warning_with_the_gap_in_millimetres(drawings):
    found = report(drawings.fourbar(miss=0.0005))
    assert found.ok
    assert found.closes
    assert found.mobility.pose == "assembled"
    assert found.mobility.by_rank == 1
    assert any('joint "C"' in text and "0.5 mm" in text for text in found.warnings)


def test_a_loop_drawn_far_open_is_an_error_even_if_it_could_close(drawings):
    found = report(drawings.fourbar(miss=0.02))
    assert not found.ok
    assert '"C"' in found.errors[0]
    assert "20 mm" in found.errors[0]


def test_two_joints_that_contradict_each_other_never_close(drawings):
    document = drawings.pendulum()
    elsewhere = drawings.frame([0.05, 0, 0])
    document["joints"].append(drawings.joint("j2", "ground", "link1", elsewhere, drawings.frame([0.056, 0, 0])))
    found = report(document)
    assert not found.closes
    assert "Loop" in found.errors[0]
    assert "6 mm" in found.errors[0]


def test_a_free_body_falls_and_is_warned_about(drawings):
    document = drawings.pendulum()
    document["bodies"].append(drawings.body("stone"))
    found = report(document)
    assert found.ok
    assert found.floating == (("stone",),)
    assert found.mobility.by_rank == 7
    assert any("stone" in text for text in found.warnings)


def test_two_fixed_bodies_are_one_ground(drawings):
    document = drawings.fourbar()
    document["bodies"].append({**drawings.body("wall", fixed=True)})
    document["joints"][3]["body_a"] = "wall"
    document["joints"].append(drawings.joint("idle", "ground", "wall"))
    found = report(document)
    assert len(found.loops) == 1
    assert found.mobility.by_rank == 1
    assert any('"idle"' in text for text in found.warnings)


def test_a_joint_drawn_outside_its_limits_is_warned_about(drawings):
    document = drawings.pendulum()
    document["joints"][0]["limits"] = {"lower": 0.1}
    assert any("outside its limits 0.1 to inf" in text for text in report(document).warnings)


@pytest.mark.parametrize(("gravity", "idle"), [((0, 0, -9.8), True), ((0, -9.8, 0), False), ((0, 0, 0), False)])
def test_gravity_along_all_axes_is_told_and_is_no_warning(drawings, gravity, idle):
    found = report({**drawings.fourbar(), "gravity_m_per_s2": list(gravity)})
    assert found.gravity_idle is idle
    assert found.warnings == ()
    assert ("nothing falls, as on a table" in check_text(found)) is idle


def test_effects_of_contact_are_read_without_a_warning(drawings):
    document = drawings.scissor(2)
    for joint in document["joints"]:
        joint["fit"] = {"pin_diameter_m": 0.008, "hole_diameter_m": 0.0081}
    radii = {"radius_a_m": 0.005, "radius_b_m": 0.005}
    document["effects"] = [
        {"id": "play", "kind": "clearance", "on": "all", "parameters": {"shape": "rectangle"}},
        {"id": "meet", "kind": "link_contact", "on": ["up1", "down1"], "parameters": radii},
        {"id": "bed", "kind": "surface_friction", "on": "all", "parameters": {"friction_coefficient": 0.2}},
    ]
    found = report(document)
    assert found.ok
    assert found.warnings == ()
    assert "3 effects" in check_text(found)


@settings(max_examples=20, deadline=None)
@given(
    vector=st.tuples(*[st.floats(-2, 2)] * 3),
    shift=st.tuples(*[st.floats(-3, 3)] * 3),
    scale=st.sampled_from([1e-3, 1.0, 1e3]),
)
def test_moving_and_scaling_the_world_leaves_mobility_as_it_is(drawings, vector, shift, scale):
    document = drawings.bennett()
    R = rotation(np.array(vector))
    half = np.linalg.norm(vector) / 2
    q = [math.cos(half), *(0.5 * np.sinc(half / np.pi) * np.array(vector))]
    for body in document["bodies"]:
        body["pose"] = {"position_m": list(shift), "quaternion_wxyz": [float(x) for x in q]}
    for joint in document["joints"]:
        for side in ("frame_a", "frame_b"):
            joint[side]["position_m"] = [scale * x for x in joint[side]["position_m"]]
    mechanism = parse_mechanism(document)
    assert drawn(mechanism).rotations[0] == pytest.approx(R, abs=1e-12)
    # Centres of mass stay where they are, so only the joints may set the scale of this one.
    found = rank_at(mechanism, list(mechanism.joints), drawn(mechanism), 0.1 * scale)
    assert found.mobility == 1


def test_the_text_is_for_people_and_the_json_for_programs(drawings):
    found = report(drawings.scissor(3))
    text = check_text(found)
    assert "1 by rank" in text
    assert "1 by count in the plane (Grübler)" in text
    assert "6 of 35 constraint rows" in text
    data = json.loads(json.dumps(check_json(found), allow_nan=False))
    assert data["ok"] is True
    assert data["mobility"]["redundant_rows"] == 6


@pytest.mark.parametrize("type", sorted(HELD))
def test_the_constraint_jacobian_is_the_derivative_of_the_gaps(drawings, type):
    rng = np.random.default_rng(7)
    at_a, at_b = (drawings.frame(rng.normal(size=3), np.array(q) / np.linalg.norm(q)) for q in rng.normal(size=(2, 4)))
    bodies = [drawings.body("ground", fixed=True), drawings.body("a"), drawings.body("b")]
    mechanism = parse_mechanism(drawings.document(type, bodies, [drawings.joint("j", "a", "b", at_a, at_b, type)]))
    joints, moving = list(mechanism.joints), np.array([1, 2])
    # The turn's derivative is exact where the turn is zero: align the frames, then slide along the free axes.
    R_WA, R_WB = mechanism.joints[0].frame_a.rotation(), mechanism.joints[0].frame_b.rotation()
    place = drawn(mechanism)
    place.rotations[2] = R_WA @ R_WB.T
    place.positions[2] = np.array(at_a["position_m"]) - place.rotations[2] @ np.array(at_b["position_m"])
    free = [axis for axis in range(3) if axis not in HELD[type][0]]
    place.positions[2] += R_WA[:, free] @ np.full(len(free), 0.3)
    length, h = 0.7, 1e-6
    exact = jacobian(mechanism, joints, place, length)
    columns = []
    for column in range(12):
        step = np.zeros((2, 6))
        step.flat[column] = h
        step[:, :3] *= length
        ahead = residual(mechanism, joints, place.moved(moving, step), length)
        behind = residual(mechanism, joints, place.moved(moving, -step), length)
        columns.append((ahead - behind) / (2 * h))
    assert exact.shape == (rows(joints[0]), 12)
    assert exact == pytest.approx(np.array(columns).T, abs=1e-8)  # central differences: h² + rounding / h


@given(st.tuples(*[st.floats(-1.8, 1.8)] * 3))
def test_a_rotation_vector_survives_its_matrix(vector):
    assert rotation_vector(rotation(np.array(vector))) == pytest.approx(np.array(vector), abs=1e-7)


def test_half_a_turn_is_told_from_none():
    for axis in np.eye(3):
        assert np.linalg.norm(rotation_vector(rotation(np.pi * axis))) == pytest.approx(np.pi)


def test_the_size_of_a_drawing_is_that_of_its_joints_and_centres(drawings):
    assert size_m(parse_mechanism(drawings.pendulum())) == pytest.approx(0.05)
