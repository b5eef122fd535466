"""Dry friction that gives a little before it slides (LuGre's bristles without their damping), or creeps."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from backend.model.build import build
from tests.mechanisms import bar_inertia, effect, pendulum, sliding_mass
from tests.motions import follow

MASS, LENGTH, G, ANGLE = 0.1, 0.2, 9.81, 1.0
ABOUT_PIN = bar_inertia(MASS, LENGTH)[2] + MASS * (LENGTH / 2) ** 2
LIMIT = 0.02  # N m
DURATION_S = 2.0


def friction(gives):
    return effect("dry", "coulomb_friction", ["pin"], friction_torque_n_m=LIMIT, presliding_rad=gives)


def swing(gives, step_s):
    """Angle of the bar, let go at rest, at 2 ms: it swings and is caught."""
    model = build(pendulum(ANGLE, LENGTH, MASS, [friction(gives)]))
    motion = follow(model, step_s, round(DURATION_S / step_s))
    return motion.path.q[:: round(2e-3 / step_s), 0]


def bristles(gives):
    """The same by SciPy: q, its rate and the share of the limit that the bristles bear."""

    def slope(_, y):
        q, rate, borne = y
        weight = MASS * G * LENGTH / 2 * np.sin(q + ANGLE)
        return [rate, -(weight + LIMIT * borne) / ABOUT_PIN, (rate - abs(rate) * borne) / gives]

    time_s = np.linspace(0.0, DURATION_S, round(DURATION_S / 2e-3) + 1)
    return solve_ivp(slope, (0.0, DURATION_S), np.zeros(3), t_eval=time_s, rtol=1e-9, atol=1e-11).y[0]


@pytest.mark.parametrize("gives", [2e-3, 1e-2])
def test_a_rubbing_bar_swings_as_bristles_bend(gives):
    exact = bristles(gives)
    off = [np.abs(swing(gives, step_s) - exact).max() for step_s in (2e-3, 5e-4)]
    assert off[1] < 1e-4  # rad of a swing of 1.9
    assert off[1] < 0.3 * off[0]
    assert off[1] < 0.01 * np.abs(swing(0.0, 5e-4) - exact).max()


def test_a_bar_whose_friction_sets_in_with_its_rate_creeps_down():
    onset, step_s = 0.03, 5e-4

    def slope(_, y):
        q, rate = y
        rub = LIMIT * rate / np.hypot(rate, onset)
        return [rate, -(MASS * G * LENGTH / 2 * np.sin(q + ANGLE) + rub) / ABOUT_PIN]

    time_s = np.linspace(0.0, DURATION_S, round(DURATION_S / 2e-3) + 1)
    exact = solve_ivp(slope, (0.0, DURATION_S), np.zeros(2), t_eval=time_s, rtol=1e-9, atol=1e-11, method="LSODA").y[0]
    dry = effect("dry", "coulomb_friction", ["pin"], friction_torque_n_m=LIMIT, onset_rad_per_s=onset)
    motion = follow(build(pendulum(ANGLE, LENGTH, MASS, [dry])), step_s, round(DURATION_S / step_s))
    off = np.abs(motion.path.q[:: round(2e-3 / step_s), 0] - exact).max()
    assert off < 5e-4
    assert np.abs(swing(0.0, step_s) - exact).max() > 20.0 * off


def test_a_block_under_half_of_its_friction_gives_and_comes_back():
    """u = 1 - exp(-q / p) as the bristles bend."""
    force, gives, step_s = 2.0, 1e-4, 1e-4
    dry = effect("dry", "coulomb_friction", ["rail"], friction_force_n=force, presliding_m=gives)
    pull = effect("pull", "effort_offset", ["rail"], force_n=0.5 * force)
    calm = effect("calm", "viscous_friction", ["rail"], damping_n_s_per_m=300.0)
    motion = follow(build(sliding_mass([dry, pull, calm])), step_s, 4000)
    assert motion.path.q[-1, 0] == pytest.approx(gives * np.log(2.0), rel=2e-3)
    held = follow(
        build(sliding_mass([effect("dry", "coulomb_friction", ["rail"], friction_force_n=force), pull])), step_s, 4000
    )
    assert abs(held.path.q[-1, 0]) < 0.01 * gives


def test_frictions_at_one_joint_give_by_their_share_of_the_limit():
    soft = effect("soft", "coulomb_friction", ["pin"], friction_torque_n_m=0.75 * LIMIT, presliding_rad=4e-3)
    hard = effect(
        "hard", "stribeck_friction", ["pin"],
        static_torque_n_m=0.25 * LIMIT, friction_torque_n_m=0.25 * LIMIT, presliding_rad=8e-3,
    )  # fmt: skip
    both = follow(build(pendulum(ANGLE, LENGTH, MASS, [soft, hard])), 1e-3, 1000)
    one = follow(build(pendulum(ANGLE, LENGTH, MASS, [friction(5e-3)])), 1e-3, 1000)
    np.testing.assert_allclose(both.path.q, one.path.q, atol=1e-9)
