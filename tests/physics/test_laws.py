"""What every motion keeps: energy, momentum, closed joints, and the order of the step."""

import numpy as np
import pytest

from backend.model.build import build
from tests.mechanisms import bennett, double_pendulum, fourbar, free_body, free_pair
from tests.motions import allowed, follow

NODES = 10_000
STEP_S = 1e-3
LINKAGES = {"double pendulum": double_pendulum, "fourbar": fourbar, "bennett": bennett}


@pytest.fixture(scope="module", params=LINKAGES)
def linkage(request):
    return build(LINKAGES[request.param]())


@pytest.fixture(scope="module")
def ten_seconds(linkage):
    return follow(linkage, STEP_S, NODES)


def test_ten_undamped_seconds_keep_energy_within_a_thousandth_of_the_motion(ten_seconds):
    energy = ten_seconds.energy
    assert np.abs(energy - energy[0]).max() <= 1e-3 * ten_seconds.kinetic.max()  # a symplectic step oscillates as h²


def test_energy_does_not_drift_in_ten_seconds(ten_seconds):
    energy = ten_seconds.energy
    drift = energy[-50:].mean() - energy[0]
    assert abs(drift) <= 1e-4 * ten_seconds.kinetic.max()  # the last 50 nodes still ride on the oscillation


def test_joints_stay_closed_within_a_nanometre(ten_seconds):
    assert not ten_seconds.path.lost.any()
    assert ten_seconds.open_m.max() <= 1e-9


def test_halving_the_step_quarters_the_error(linkage):
    ends = [follow(linkage, STEP_S / halved, NODES).path.pose.position[1000 * halved] for halved in (1, 2, 4)]
    coarse, fine = np.linalg.norm(ends[0] - ends[1]), np.linalg.norm(ends[1] - ends[2])
    assert np.log2(coarse / fine) == pytest.approx(2.0, abs=0.1)


TUMBLING = np.array([0.3, -0.2, 0.5, 4.0, -7.0, 5.0])


def test_an_asymmetric_body_tumbling_freely_keeps_its_momentum():
    motion = follow(build(free_body()), STEP_S, 2000, TUMBLING[None])
    size = np.abs(motion.momentum).max(0)
    # Momentum at a node comes from central differences, which cut a corner of h² |w|² / 8 = 1e-5.
    np.testing.assert_allclose(motion.momentum[:, :3], motion.momentum[:1, :3].repeat(2001, 0), atol=1e-12)
    assert np.abs(motion.momentum[:, 3:] - motion.momentum[0, 3:]).max() < 3e-5 * size[3:].max()
    assert np.abs(motion.energy - motion.energy[0]).max() < 1e-4 * motion.kinetic.max()


def test_the_momentum_of_a_tumbling_body_does_not_drift():
    momentum = follow(build(free_body()), STEP_S, 2000, TUMBLING[None]).momentum[:, 3:]
    early, late = momentum[1:400].mean(0), momentum[-400:].mean(0)
    assert np.linalg.norm(late - early) < 1e-5 * np.linalg.norm(early)


def test_two_bodies_on_a_hinge_keep_their_common_momentum():
    model = build(free_pair())
    motion = follow(model, STEP_S, 1000, allowed(model, [0.2, 0.1, -0.3, 2.0, 1.0, -1.5, 3.0]))
    assert np.ptp(motion.path.q) > 0.5  # the hinge works, so each body changes its own momentum
    size = np.linalg.norm(motion.momentum[0, 3:])
    drift = motion.momentum[:, :3] - motion.momentum[0, :3]
    assert np.abs(drift).max() < 2e-8  # N s: a step leaves 1e-10 lengths of displacement, m 1e-10 L / h = 1e-9
    assert np.abs(motion.momentum[:, 3:] - motion.momentum[0, 3:]).max() < 3e-5 * size
