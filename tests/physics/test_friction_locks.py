"""Mechanisms that friction at the point of contact holds, up to the load where it lets go."""

import numpy as np
import pytest

from backend.model.build import build
from tests.loose import LENGTH, drawer, loose_bar
from tests.mechanisms import effect, slider_crank
from tests.motions import follow

STEP_S, STEPS = 1e-3, 1000
DRAWER_M, FORCE_N = 0.1, 10.0


def leaning_bar(share: float, friction: float, play: float, up: bool, pin_radius_m: float = 0.02):
    """A bar that leans by a share of the angle to which friction holds it, its pin where the bar's weight puts it.

    The wall's push and friction together stand under the centre of mass and lean by atan μ from the normal at most, so
    the contact lies r sin(atan μ) beside the pin's centre at most: sin θ = 2 r sin(atan μ) / L, whatever the play.
    """
    critical = np.arcsin(2 * pin_radius_m * np.sin(np.arctan(friction)) / LENGTH)
    lean = share * critical
    side = np.arcsin(LENGTH * np.sin(lean) / (2 * pin_radius_m))
    angle = np.pi - lean if up else lean
    at = (play * np.sin(side), -play * np.cos(side))
    return loose_bar(angle, at, pin_radius_m=pin_radius_m, radial_m=play, friction_coefficient=friction)


@pytest.mark.parametrize(("share", "holds"), [(0.99, True), (1.01, False)])
@pytest.mark.parametrize("play", [1e-5, 1e-3])
@pytest.mark.parametrize("friction", [0.5, 1.0])
def test_contact_friction_holds_a_bar_up_to_the_angle_where_the_contact_stands_under_its_weight(
    friction, play, share, holds
):
    motion = follow(leaning_bar(share, friction, play, up=True), STEP_S, STEPS, halvings=6)
    # Upright, a bar beyond the limit falls; one within it creeps less than the 0.9 mrad that are missing.
    assert (np.abs(motion.path.q[-1, 0]) < 5e-4) == holds
    assert holds or np.abs(motion.path.q[-1, 0]) > 0.5


def test_a_bar_held_by_contact_friction_creeps_less_than_a_micrometre_a_second():
    motion = follow(leaning_bar(0.5, 0.5, 5e-4, up=False, pin_radius_m=0.004), 2 * STEP_S, STEPS, halvings=6)
    assert LENGTH * np.abs(motion.path.q[-1, 0] - motion.path.q[STEPS // 2, 0]) < 1e-6


@pytest.mark.parametrize(("share", "wedges"), [(0.99, False), (1.01, True)])
@pytest.mark.parametrize("play", [1e-4, 1e-3])
@pytest.mark.parametrize("arm", [0.05, 0.2])
def test_a_drawer_wedges_where_friction_exceeds_half_its_length_over_the_lever_of_the_pull(arm, play, share, wedges):
    """N L = F a at either wall and 2 μ N >= F: μ = L / 2a (the tilt shortens L and a alike)."""
    motion = follow(drawer(share * DRAWER_M / (2 * arm), arm, DRAWER_M, play, FORCE_N), STEP_S, 200)
    travel = motion.path.pose.position[:, 0, 0]
    if wedges:
        assert 0 <= travel[-1] < 1e-6  # creeps at 3.5 µm/s
    else:
        assert travel[-1] == pytest.approx(play, rel=0.02)  # the end of its play, less the walls' tilt and barrier
    np.testing.assert_allclose(motion.path.wall[5].sum(), 2 * FORCE_N * arm / DRAWER_M, rtol=1e-4)


@pytest.mark.parametrize("rail_n", [20.0, 2000.0])
def test_friction_far_beyond_the_drive_holds_a_loop_and_shares_its_drive(rail_n):
    """Held so stiffly, a rounding of places is more impulse than a step may be off by."""
    crank = effect("crank", "coulomb_friction", ["main"], friction_torque_n_m=0.2)
    rail = effect("rail", "coulomb_friction", ["slide"], friction_force_n=rail_n)
    push = effect("push", "applied_torque", ["crank"], torque_n_m=0.2, axis=[0, 0, 1])
    motion = follow(build(slider_crank(effects=[crank, rail, push])), STEP_S, 200, halvings=6)
    assert motion.path.halvings.max() == 0
    assert motion.path.iterations[5:].max() <= 3
    assert np.abs(motion.path.rate[5:]).max() < 5e-6
    assert np.abs(motion.path.q[-1] - motion.path.q[5]).max() < 1e-6
