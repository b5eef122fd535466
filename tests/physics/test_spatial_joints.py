"""Joints with several freedoms against truths of mechanics, and against the same machine drawn with hinges and slides.

The machines stand side by side in one drawing, so that one program moves them all.
"""

from typing import NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from backend.mechanism.graph import describe
from backend.mechanism.read import parse_mechanism
from backend.model.build import build
from backend.model.model import Model
from backend.model.state import drawn_pose
from backend.model.system import system
from backend.simulate.assemble import free_motions
from tests.mechanisms import (
    LEANING,
    SKEW_INERTIA,
    Z,
    attitude,
    bar,
    body,
    document,
    drawing,
    effect,
    spatial_fourbar,
)
from tests.motions import Motion, allowed, follow

LENGTH, MASS, TILT = 0.2, 0.1, 0.7
PULL = float(np.linalg.norm(LEANING))
UP = -np.array(LEANING) / PULL
SIDE = np.cross(UP, Z) / np.linalg.norm(np.cross(UP, Z))  # level
AHEAD = np.cross(SIDE, UP)  # level too
BEND = Rotation.from_rotvec([0, 0.5, 0])
GRAIN = np.full(3, 1e-9)  # moment of inertia of a part that is only there to join two others [kg m²]
NO_TURN = Rotation.identity()
ROUND = np.array([1e-4, 1e-4, 2e-4])
SLEEVE_AT, SLEEVE_AXIS = (0.05, 0, 0.02), (0.2, 0.3, 1.0)
STEP_S, STEPS = 1e-3, 660
SPIN = {  # turn rate of bodies in W at the start [rad/s]
    "bobbing": 1.5 * SIDE + 4.0 * UP - 2.0 * AHEAD,
    "puck": np.array([0, 0, 3.0]),
    "oiled": np.array([0, 0, 5.0]),
    "drive": np.array([0, 0, 10.0]),
    "driven": BEND.apply([0, 0, 10.0]),
}
SPEED = {"puck": np.array([0.5, 0.2, 0.0]), "oiled": np.array([0, 0, 0.4])}


def hanging(tilt, across):
    """Tip of a bar that hangs from the origin, tilted from the vertical towards a level direction."""
    return LENGTH * (np.sin(tilt) * across - np.cos(tilt) * UP)


def machines():
    """Pendulums on balls, a puck, sleeves, a universal joint, Hooke's joint between two shafts, a spatial four-bar."""
    in_plane, circling = hanging(1.0, SIDE), hanging(TILT, SIDE)
    cross_x = np.cross(np.eye(3)[0], Z)  # x of the frames that `drawing` gives to an axis along z
    cross_y = np.cross(Z, cross_x)
    linkage = document(spatial_fourbar(("spherical", "universal")))
    bodies = [
        bar("on_pin", (0, 0, 0), in_plane, MASS),
        bar("on_ball", (0, 0, 0), in_plane, MASS),
        bar("circling", (0, 0, 0), circling, MASS),
        bar("bobbing", (0, 0, 0), hanging(0.9, SIDE), MASS),
        body("puck", (0, 0, 0), NO_TURN, 0.2, np.array([2e-4, 2e-4, 3e-4])),
        body("oiled", (0, 0, 0), NO_TURN, 0.2, np.array([2e-4, 2e-4, 3e-4])),
        *(body(f"sleeve{k}", (0.1, 0, 0.05), BEND, 0.2, SKEW_INERTIA, (0.02, 0.01, 0)) for k in "12"),
        body("grain", SLEEVE_AT, NO_TURN, 1e-6, GRAIN),
        *(body(f"shaft{k}", (0, 0, -0.1), NO_TURN, 0.2, 2 * SKEW_INERTIA, (0.004, 0, 0)) for k in "12"),
        *(body(f"wheel{k}", (0.02, 0, 0.1), BEND, 0.2, SKEW_INERTIA, (0, 0.01, 0.02)) for k in "12"),
        body("cross", (0, 0, 0), NO_TURN, 1e-6, GRAIN),
        body("drive", (0, 0, 0), NO_TURN, 0.2, ROUND),
        body("driven", (0, 0, 0), BEND, 0.2, ROUND),
        *[part for part in linkage["bodies"] if not part.get("fixed")],
    ]
    origin, low = (0, 0, 0), (0, 0, -0.1)
    joints = [
        ("pin", "revolute", "ground", "on_pin", origin, AHEAD),
        ("ball", "spherical", "ground", "on_ball", origin, Z),
        ("circle", "spherical", "ground", "circling", origin, Z),
        ("bob", "spherical", "ground", "bobbing", origin, Z),
        ("table", "planar", "ground", "puck", origin, Z),
        ("oil", "cylindrical", "ground", "oiled", origin, Z),
        ("both", "cylindrical", "ground", "sleeve1", SLEEVE_AT, SLEEVE_AXIS),
        ("turn", "revolute", "ground", "grain", SLEEVE_AT, SLEEVE_AXIS),
        ("slide", "prismatic", "grain", "sleeve2", SLEEVE_AT, SLEEVE_AXIS),
        ("bearing1", "revolute", "ground", "shaft1", low, Z),
        ("yokes", "universal", "shaft1", "wheel1", origin, Z),
        ("bearing2", "revolute", "ground", "shaft2", low, Z),
        ("yoke_a", "revolute", "shaft2", "cross", origin, cross_y),
        ("yoke_b", "revolute", "cross", "wheel2", origin, cross_x),
        ("in", "revolute", "ground", "drive", origin, Z),
        ("hooke", "universal", "drive", "driven", origin, Z),
        ("out", "revolute", "ground", "driven", origin, BEND.apply(Z)),
    ]
    oil = effect("film", "viscous_friction", ["oil"], damping_n_m_s_per_rad=1e-3)
    drawn = document(drawing("machines", bodies, joints, [oil], gravity=LEANING))
    drawn["joints"] += linkage["joints"]
    return bent(parse_mechanism(drawn), "hooke", BEND)


def bent(mechanism, joint, turned):
    """The drawing with B's frame of a joint turned in the world."""
    drawn = document(mechanism)
    (entry,) = [j for j in drawn["joints"] if j["id"] == joint]
    (part,) = [b for b in drawn["bodies"] if b["id"] == entry["body_b"]]
    own = attitude(part["pose"])
    frame = own.inv() * turned * own * attitude(entry["frame_b"])
    entry["frame_b"]["quaternion_wxyz"] = [float(x) for x in frame.as_quat(scalar_first=True)]
    return parse_mechanism(drawn)


class Moved(NamedTuple):
    """The machines in motion, by the drawing's names."""

    model: Model
    motion: Motion

    def slot(self, name):
        return self.model.topology.body_ids.index(name)

    def joint(self, name):
        return self.model.topology.joint_ids.index(name)

    def center(self, name):
        return self.motion.path.pose.position[:, self.slot(name)]

    def q(self, name):
        return self.motion.path.q[:, self.joint(name)]

    def force(self, name):
        return self.motion.force[:, self.joint(name)]


def conical_rate():
    """Steady turning about the vertical: (I across - I along) ω² cos θ = m g L/2, moments about the ball."""
    part = bar("circling", (0, 0, 0), hanging(TILT, SIDE), MASS)["inertial"]["inertia_kg_m2"]
    across, along = part["zz"] + MASS * (LENGTH / 2) ** 2, part["xx"]
    return np.sqrt(MASS * PULL * LENGTH / 2 / ((across - along) * np.cos(TILT)))


@pytest.fixture(scope="module")
def moved():
    model = build(machines())
    wanted = np.zeros((model.topology.slots, 6))
    spins = {**SPIN, "circling": conical_rate() * UP}
    for name, spin in spins.items():
        slot = model.topology.body_ids.index(name)
        pose = np.array(model.drawn_poses[slot])
        turned = Rotation.from_quat(pose[3:], scalar_first=True)
        center = pose[:3] + turned.apply(np.array(model.drawing.center_of_mass[slot]))
        pivot = np.zeros(3)
        wanted[slot] = [*(SPEED.get(name, 0.0) + np.cross(spin, center - pivot)), *turned.inv().apply(spin)]
    plant = system(model)
    motions = free_motions(plant, drawn_pose(model, plant))
    rates = np.linalg.lstsq(motions.reshape(wanted.size, -1), wanted.ravel(), rcond=None)[0]
    return Moved(model, follow(model, STEP_S, STEPS, allowed(model, list(rates))))


def test_a_ball_pendulum_circles_at_the_rate_of_a_conical_pendulum(moved):
    rate, time = conical_rate(), moved.motion.path.time_s
    assert rate * time[-1] > 2 * np.pi
    wanted = Rotation.from_rotvec(rate * time[:, None] * UP).apply(hanging(TILT, SIDE) / 2)
    # (hω)²/24 to (hω)²/6 of corner in the rate, over the angle turned
    allowance = (STEP_S * rate) ** 2 / 6 * rate * time[-1] * LENGTH
    np.testing.assert_allclose(moved.center("circling"), wanted, atol=allowance)


def test_a_ball_pendulum_keeps_its_angular_momentum_about_the_vertical(moved):
    center, slot = moved.center("bobbing"), moved.slot("bobbing")
    pose, velocity = moved.motion.path.pose, moved.motion.path.velocity[:, slot]
    turned = Rotation.from_quat(pose.quaternion[:, slot], scalar_first=True)
    own = turned.apply(velocity[:, 3:] @ np.array(moved.model.drawing.inertia[slot]))
    about_vertical = (own + np.cross(center, MASS * velocity[:, :3])) @ UP
    assert np.ptp(center @ UP) > 0.02  # it bobs
    corner = (STEP_S * np.abs(velocity[:, 3:]).max()) ** 2
    np.testing.assert_allclose(about_vertical, about_vertical[0], rtol=corner)


def test_a_ball_pendulum_in_a_plane_swings_as_one_on_a_pin(moved):
    assert np.ptp(moved.center("on_pin"), axis=0).max() > 0.1
    # 660 steps solved to 1e-10 lengths
    np.testing.assert_allclose(moved.center("on_ball"), moved.center("on_pin"), atol=1e-8)


def test_a_puck_on_a_planar_joint_slides_and_spins_as_if_nothing_held_it(moved):
    time = moved.motion.path.time_s[:, None]
    gravity = np.array([*LEANING[:2], 0.0])
    path = SPEED["puck"] * time + 0.5 * gravity * time**2
    np.testing.assert_allclose(moved.center("puck"), path, atol=1e-8)  # the step is exact for a parabola
    # a step of θ is met as 2 sin(θ/2): (hω)²/24 of corner
    np.testing.assert_allclose(moved.q("table"), 3.0 * time[:, 0], rtol=1e-5, atol=1e-9)
    push = moved.force("table")
    np.testing.assert_allclose(push[:, 2], -0.2 * LEANING[2], rtol=1e-4)  # 2e-6 N of solver's rounding, of 0.2 N
    np.testing.assert_allclose(push[:, :2], 0.0, atol=1e-9)


def test_friction_at_a_cylindrical_joint_brakes_its_turn_and_leaves_its_slide_alone(moved):
    time = moved.motion.path.time_s
    path = 0.4 * time + 0.5 * LEANING[2] * time**2
    np.testing.assert_allclose(moved.center("oiled")[:, 2], path, atol=1e-8)
    rate = moved.motion.path.rate[:, moved.joint("oil")]
    np.testing.assert_allclose(rate, 5.0 * np.exp(-time * 1e-3 / 3e-4), rtol=2e-5)  # (hω)² / 24 and (h b / I)²


def test_a_cylindrical_joint_moves_as_a_hinge_and_a_slide_through_a_light_part(moved):
    ours, theirs = moved.center("sleeve1"), moved.center("sleeve2")
    assert np.ptp(moved.q("both")) > 1.0
    assert np.ptp(moved.q("slide")) > 0.05
    # The grain adds 1e-6 / 0.2 of mass and 1e-9 / 2e-4 of inertia to what moves.
    np.testing.assert_allclose(theirs, ours, atol=1e-4 * np.ptp(ours, axis=0).max())


def test_a_universal_joint_moves_as_two_crossed_hinges_through_a_light_cross(moved):
    ours, theirs = moved.center("wheel1"), moved.center("wheel2")
    assert np.ptp(moved.q("yoke_a")) > 0.5
    assert np.ptp(moved.q("yoke_b")) > 0.5
    np.testing.assert_allclose(theirs, ours, atol=1e-3 * np.ptp(ours, axis=0).max())  # the cross's own inertia


def test_a_bent_universal_joint_hands_on_turning_unevenly_as_hooke_found(moved):
    q_in, q_out, bend = moved.q("in"), moved.q("out"), BEND.magnitude()
    assert abs(q_in[-1]) > 2 * np.pi
    # The cross turns in A about y, the axis of the bend: tan out = tan in / cos bend from the pose drawn.
    wanted = np.arctan2(np.sin(q_in), np.cos(q_in) * np.cos(bend))
    np.testing.assert_allclose(np.exp(1j * q_out), np.exp(1j * wanted), atol=1e-8)  # closed to 1e-10 lengths
    assert np.abs(q_out - q_in).max() > 0.05


def test_a_spatial_fourbar_keeps_its_coupler_as_long_as_drawn_at_every_crank_angle(moved):
    hinge, axis = np.array([0.2, 0.05, 0.06]), np.array([0.3, 1.0, 0.2]) / np.linalg.norm([0.3, 1.0, 0.2])
    turned = moved.q("main")[:, None] * np.array(Z), moved.q("hinge")[:, None] * axis
    crank_end = Rotation.from_rotvec(turned[0]).apply([0.05, 0, 0])
    rocker_end = hinge + Rotation.from_rotvec(turned[1]).apply([-0.02, -0.03, 0.18])
    length = np.linalg.norm(rocker_end - crank_end, axis=1)
    assert np.ptp(moved.q("main")) > 1.0
    np.testing.assert_allclose(length, length[0], atol=1e-9)  # closed to 1e-10 lengths at either end


@pytest.mark.parametrize(
    ("ends", "ways"),
    [(("spherical", "spherical"), 2), (("spherical", "universal"), 1), (("universal", "spherical"), 1)],
    ids=["RSSR", "RSUR", "RUSR"],
)
def test_a_spatial_fourbar_moves_one_way_and_its_coupler_spins_between_two_balls(ends, ways):
    found = describe(spatial_fourbar(ends)).mobility
    assert found.by_count_in_space == found.by_rank == ways
    assert found.redundant_rows == 0
    assert found.by_count_in_plane is None


def test_a_bent_universal_joint_counts_as_it_stands():
    found = describe(machines())
    assert found.closes
    assert not [c for c in found.closure if c.turn_deg > 1e-9]


@pytest.mark.parametrize("kind", ["pin_friction", "viscous_friction", "joint_stop", "prescribed_motion"])
@pytest.mark.parametrize("type_", ["spherical", "universal"])
def test_an_effect_that_acts_along_a_coordinate_is_refused_where_there_is_none(kind, type_):
    drawn = document(spatial_fourbar((type_, "spherical")))
    drawn["effects"] = [effect("e", kind, ["near"]).model_dump(mode="json")]
    refusal = f'{kind} does not act at joint "near", which is {type_}; it acts at .*revolute'
    with pytest.raises(ValueError, match=refusal):
        parse_mechanism(drawn)
