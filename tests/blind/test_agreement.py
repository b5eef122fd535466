"""Two engines that share nothing but the drawing, against each other and against their own finer steps."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest


def apart(one, other):
    """Largest difference of any joint angle or travel [rad or m]."""
    return max(np.abs(one.joint_positions[j] - other.joint_positions[j]).max() for j in one.joint_positions)


@pytest.mark.parametrize("name", ["pendulum", "double_pendulum", "fourbar", "slider_crank"])
def test_both_engines_see_the_same_motion(linkages, simulate_exudyn, simulate_mujoco, name):
    drawn = getattr(linkages, name)()
    exudyn = simulate_exudyn(drawn, 0.5, 5e-4, output_step_s=0.01, extrapolated=True)
    mujoco = simulate_mujoco(drawn, 0.5, 1e-4, output_step_s=0.01)
    assert apart(exudyn, mujoco) < 1e-6  # MuJoCo's soft welds: 2e-7
    for body, p in exudyn.position_m.items():
        np.testing.assert_allclose(mujoco.position_m[body], p, atol=1e-6)
        q = exudyn.quaternion_wxyz[body]
        np.testing.assert_allclose(mujoco.quaternion_wxyz[body], q, atol=1e-6)


def test_both_engines_carry_bennetts_loop_round_its_folded_pose(linkages, simulate_exudyn, simulate_mujoco):
    drawn = linkages.bennett()
    exudyn = simulate_exudyn(drawn, 1.0, 2.5e-4, output_step_s=0.01)
    mujoco = simulate_mujoco(drawn, 1.0, 1e-4, output_step_s=0.01)
    assert np.ptp(mujoco.joint_positions["j0"]) > np.pi
    assert apart(exudyn, mujoco) < 2e-4  # Exudyn's second order at 0.25 ms: 4e-5


@pytest.mark.parametrize(
    ("name", "step_s", "extrapolated"),
    [
        ("fourbar", 1e-3, True),
        ("slider_crank", 5e-4, True),
        ("scissor5", 2e-3, True),
        ("scissor10", 1e-3, False),
    ],
)
def test_halving_exudyns_step_hardly_moves_a_joint(linkages, simulate_exudyn, name, step_s, extrapolated):
    drawn = linkages.scissor(int(name[7:])) if name.startswith("scissor") else getattr(linkages, name)()
    coarse, fine = (
        simulate_exudyn(drawn, 1.0, h, output_step_s=0.01, extrapolated=extrapolated) for h in (step_s, step_s / 2)
    )
    assert max(np.ptp(q) for q in fine.joint_positions.values()) > 0.2
    assert apart(coarse, fine) < 1e-5
    # A straight extrapolation leaves the curved set of closed poses by its own correction squared.
    assert fine.constraint_error_m.max() < (1e-8 if extrapolated else 1e-10)


def test_exudyns_error_falls_by_four_when_its_step_is_halved(linkages, simulate_exudyn):
    drawn = linkages.fourbar()
    truth, coarse, fine = (
        simulate_exudyn(drawn, 0.5, h, output_step_s=0.01, extrapolated=more)
        for h, more in ((5e-4, True), (1e-3, False), (5e-4, False))
    )
    assert apart(coarse, truth) / apart(fine, truth) == pytest.approx(4.0, rel=0.05)


def test_rows_left_out_of_a_scissor_are_not_missed(linkages, simulate_exudyn):
    drawn = linkages.scissor(3)
    left_out, ignored = (
        simulate_exudyn(drawn, 0.3, 1e-3, output_step_s=0.01, redundant_rows=rows) for rows in ("left out", "ignored")
    )
    assert apart(left_out, ignored) < 1e-9  # Newton's tolerance of 1e-10


def cases(linkages):
    """Each kind of effect where its sign or its reaction could be wrong."""
    effect = linkages.effect
    spring = effect("s", "torsion_spring", ["j"], stiffness_n_m_per_rad=0.3, rest_rad=0.2)
    grease = effect("g", "viscous_friction", "all", damping_n_m_s_per_rad=0.002)
    lean = effect("l", "effort_offset", ["j"], torque_n_m=0.05)
    twist = effect("t", "applied_torque", ["link"], torque_n_m=0.1, axis=[0, 0, 1])
    between = effect("p", "applied_force", ["coupler", "rocker"], force_n=0.5, direction=[1, 1, 0])
    between["parameters"]["point_m"] = [0.1, 0.05, 0.0]
    drag = effect("d", "linear_drag", "all", n_s_per_m=0.2)
    closing = effect("c", "torsion_spring", ["j4"], stiffness_n_m_per_rad=0.5, rest_rad=-0.3)
    closing_stop = effect("e", "joint_stop", ["j4"], lower=-0.4, upper=0.4)
    return {
        "springs, grease and an offset at a hinge": linkages.pendulum(0.5, effects=[spring, grease, lean]),
        "a torque on a body": linkages.pendulum(0.5, effects=[twist]),
        "a force between two moving bodies": linkages.fourbar([between]),
        "drag on every body of a loop": linkages.fourbar([drag]),
        "a torsion spring at the joint that closes a loop": linkages.fourbar([closing]),
        "a stop at the joint that closes a loop": linkages.fourbar([closing_stop]),
        "dry friction in a loop": linkages.fourbar([effect("f", "coulomb_friction", "all", friction_torque_n_m=0.01)]),
    }


@pytest.mark.parametrize(
    ("case", "tolerance"),
    [
        ("springs, grease and an offset at a hinge", 1e-6),
        ("a torque on a body", 1e-6),
        ("a force between two moving bodies", 5e-6),
        ("drag on every body of a loop", 5e-6),
        ("a torsion spring at the joint that closes a loop", 5e-6),
        ("a stop at the joint that closes a loop", 2e-2),  # two soft stops, each with its own law
        ("dry friction in a loop", 1e-3),  # each reversal of a joint costs Exudyn about 2e-4
    ],
)
def test_an_effect_means_the_same_to_both(linkages, simulate_exudyn, simulate_mujoco, case, tolerance):
    drawn = cases(linkages)[case]
    smooth = tolerance < 1e-4
    exudyn = simulate_exudyn(drawn, 0.5, 5e-4, output_step_s=0.01, extrapolated=smooth)
    mujoco = simulate_mujoco(drawn, 0.5, 1e-4, output_step_s=0.01)
    ideal = simulate_mujoco({**drawn, "effects": []}, 0.5, 1e-4, output_step_s=0.01)
    assert apart(exudyn, mujoco) < tolerance
    assert apart(mujoco, ideal) > 10 * tolerance


def test_the_scissor_that_is_timed_moves_like_the_one_that_is_drawn(linkages, simulate_mujoco):
    import mujoco

    path = Path(__file__).parents[2] / "benchmarks" / "mujoco_scissor.py"
    spec = importlib.util.spec_from_file_location("mujoco_scissor", path)
    timed = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(timed)
    model = timed.scissor(4, 1e-4, "RK4")
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=2000)
    drawn = simulate_mujoco(linkages.scissor(4, timed.STIFFNESS_N_PER_M), 0.2, 1e-4, output_step_s=0.1)
    assert abs(data.qpos[1]) > 0.1
    # One closes each cell with a point, the other with a weld, each soft in its own way.
    assert data.qpos[1] == pytest.approx(drawn.joint_positions["centre0"][-1], abs=2e-5)
    assert data.qpos[0] == pytest.approx(drawn.joint_positions["root"][-1], abs=2e-5)
