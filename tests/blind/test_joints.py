"""Joints of more than one freedom: each peer against free flight, and both against each other."""

import numpy as np
import pytest

from backend.blind.poses import rotation_matrix


def stone(linkages, type, q_W=(1.0, 0.0, 0.0, 0.0), gravity=(1.0, -2.0, -3.0)):
    b = linkages.body("stone", (0, 0, 0), (1.0, 0, 0, 0), 0.2, (0, 0, 0), (1e-4, 1e-4, 1e-4))
    return linkages.mechanism([b], [linkages.joint("j", linkages.GROUND, b, (0, 0, 0), q_W, type)], gravity=gravity)


@pytest.mark.parametrize(("type", "free"), [("cylindrical", (0, 0, 1)), ("planar", (1, 1, 0))])
def test_a_body_falls_where_its_joint_lets_it_and_spins_on(linkages, simulate, type, free):
    motion = simulate(stone(linkages, type), 0.2, 1e-3, initial_joint_velocities={"j": 10.0})
    fall = 0.5 * motion.time_s[:, None] ** 2 * np.array([1.0, -2.0, -3.0]) * np.array(free)
    np.testing.assert_allclose(motion.position_m["stone"], fall, atol=1e-8)
    np.testing.assert_allclose(motion.joint_positions["j"], 10.0 * motion.time_s, atol=1e-5)  # (ω h)² / 12 of the angle
    assert motion.constraint_error_m.max() < 1e-9


def test_a_slide_along_a_cylinder_follows_its_leaning_axis(linkages, simulate):
    axis = np.array([0.6, 0.0, 0.8])
    drawn = stone(linkages, "cylindrical", linkages.towards(axis))
    motion = simulate(drawn, 0.2, 1e-3)
    pull = axis @ [1.0, -2.0, -3.0]
    np.testing.assert_allclose(motion.position_m["stone"], 0.5 * motion.time_s[:, None] ** 2 * pull * axis, atol=1e-8)


def test_a_bar_released_from_a_ball_joint_swings_as_from_a_hinge_across_its_plane(linkages, simulate):
    hinged = linkages.pendulum(0.5)
    ball = {**hinged, "joints": [{**hinged["joints"][0], "type": "spherical"}]}
    one, other = (simulate(drawn, 0.5, 5e-4, output_step_s=0.01) for drawn in (hinged, ball))
    assert np.ptp(one.joint_positions["j"]) > 0.9
    np.testing.assert_allclose(other.marker_position_m["tip"], one.marker_position_m["tip"], atol=1e-7)


@pytest.mark.parametrize("type", ["spherical", "cylindrical", "planar", "universal", "revolute"])
def test_both_engines_carry_a_spatial_chain_alike(linkages, simulate_exudyn, simulate_mujoco, type):
    drawn = linkages.two_links(type)
    exudyn = simulate_exudyn(drawn, 0.3, 5e-4, output_step_s=0.01, extrapolated=True)
    mujoco = simulate_mujoco(drawn, 0.3, 1e-4, output_step_s=0.01)
    for body in ("upper", "lower"):
        # Exudyn's second order, extrapolated.
        np.testing.assert_allclose(exudyn.position_m[body], mujoco.position_m[body], atol=2e-6)
    total = mujoco.kinetic_j + mujoco.potential_j
    assert np.ptp(total) < 1e-6 * mujoco.kinetic_j.max()


@pytest.mark.parametrize("swapped", [False, True])
def test_a_universal_joint_keeps_its_cross_square(linkages, simulate, swapped):
    drawn = linkages.two_links("universal")
    joint = drawn["joints"][1]
    if swapped:  # the same joint seen from the other body, so that the tree reaches body_a from body_b
        for one, other in (("body_a", "body_b"), ("frame_a", "frame_b")):
            joint[one], joint[other] = joint[other], joint[one]
    motion = simulate(drawn, 0.3, 5e-4, output_step_s=0.01)
    R_WA, R_WB = (
        rotation_matrix(motion.quaternion_wxyz[joint[body]])
        @ rotation_matrix(np.array(joint[frame]["quaternion_wxyz"]))
        for body, frame in (("body_a", "frame_a"), ("body_b", "frame_b"))
    )
    square = np.einsum("ti,ti->t", R_WA[:, :, 1], R_WB[:, :, 0])
    assert np.abs(square).max() < 1e-9
    turned = np.einsum("ti,ti->t", R_WA[:, :, 2], R_WB[:, :, 2])
    assert turned.min() < 0.9  # it bends
