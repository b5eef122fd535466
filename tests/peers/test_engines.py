"""Our motions beside engines nobody here wrote; `python -m benchmarks.peers` prints more of them."""

from pathlib import Path

import numpy as np
import pytest

from backend.mechanism.read import read_mechanism
from backend.simulate.run import simulate
from benchmarks.scissor import scissor

SAMPLES = Path(__file__).parents[2] / "samples"
DURATION_S, STEP_S, SEEN_S = 0.5, 2.5e-4, 1e-2
TOLERANCE_RAD = 1e-4  # ours is second order: 3e-5 rad off at this step where the crank turns fastest


def drawing(name):
    return scissor(5) if name == "scissor" else read_mechanism(SAMPLES / name / "mechanism.json")


def largest_difference(ours, peer):
    every = round(SEEN_S / STEP_S)
    return max(np.abs(q[::every] - peer.joint_positions[joint]).max() for joint, q in ours.q.items())


@pytest.mark.parametrize("name", ["fourbar", "slider_crank", "scissor"])
def test_a_closed_linkage_moves_as_exudyn_and_mujoco_say(name):
    pytest.importorskip("exudyn", reason="the peer engine Exudyn is not installed")
    pytest.importorskip("mujoco", reason="the peer engine MuJoCo is not installed")
    from backend.blind.exudyn_engine import simulate_exudyn
    from backend.blind.mujoco_engine import simulate_mujoco

    mechanism = drawing(name)
    ours = simulate(mechanism, DURATION_S, STEP_S)
    exudyn = simulate_exudyn(mechanism, DURATION_S, 5e-4, output_step_s=SEEN_S, extrapolated=True)
    mujoco = simulate_mujoco(mechanism, DURATION_S, output_step_s=SEEN_S)
    assert ours.done
    assert max(np.ptp(q) for q in ours.q.values()) > 0.5  # it did move
    assert largest_difference(ours, exudyn) < TOLERANCE_RAD
    assert largest_difference(ours, mujoco) < TOLERANCE_RAD
