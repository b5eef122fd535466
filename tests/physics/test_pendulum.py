"""A bar on a pin, against what textbooks say about it."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import ellipk

from backend.model.build import build
from tests.mechanisms import PIN_RADIUS_M, bar_inertia, effect, pendulum
from tests.motions import crossings, follow

MASS, LENGTH, G = 0.1, 0.2, 9.81
ABOUT_PIN = bar_inertia(MASS, LENGTH)[2] + MASS * (LENGTH / 2) ** 2
OWN_RATE = np.sqrt(MASS * G * LENGTH / 2 / ABOUT_PIN)  # rad/s of small swings
STEP_S, STEPS = 1e-3, 2000
CORNER = 1e-5  # a second-order step of 1 ms shifts a period by (w h)² / 24 = 6e-6
SOLVED = 2 * MASS * 1e-10 * LENGTH / STEP_S**2  # N: the error of a step's displacement that the solver leaves, over h²


def period(motion, angle):
    return np.diff(crossings(motion.path.time_s, motion.path.q[:, 0] + angle)).mean()


def spun(rate):
    """The velocity of the bar at a turn rate, hanging straight down."""
    return np.array([[rate * LENGTH / 2, 0, 0, 0, 0, rate]])


def test_small_swings_have_the_period_of_the_compound_pendulum(swinging):
    angle = 1e-3
    assert period(follow(swinging(angle), STEP_S, STEPS), angle) == pytest.approx(2 * np.pi / OWN_RATE, rel=CORNER)


@pytest.mark.parametrize("angle", [0.01, 0.1, 1.0])
def test_steps_of_a_tenth_of_a_millisecond_keep_energy_as_well_as_their_order_says(swinging, angle):
    motion = follow(swinging(angle), 0.1 * STEP_S, STEPS)
    # A guess within the tolerance was taken as it was: it lagged behind, and a swing of 0.1 rad gained 0.7% in 4 s.
    assert np.ptp(motion.energy) < 0.03 * CORNER * motion.kinetic.max()  # (hω)² / 4 at most


@pytest.mark.parametrize("angle", [1.0, 2.5])
def test_large_swings_have_the_period_of_the_elliptic_integral(swinging, angle):
    expected = 4 * ellipk(np.sin(angle / 2) ** 2) / OWN_RATE
    motion = follow(swinging(angle), 2e-3, STEPS)
    assert period(motion, angle) == pytest.approx(expected, rel=6 * CORNER)  # 2 ms, and faster at the bottom


def test_a_rotor_behind_the_pin_slows_the_swing(swinging):
    angle, rotor = 1e-3, 0.5 * ABOUT_PIN
    motion = follow(swinging(angle, rotor_inertia=rotor), STEP_S, STEPS)
    assert period(motion, angle) == pytest.approx(np.sqrt(1.5) * 2 * np.pi / OWN_RATE, rel=CORNER)


def test_a_torsion_spring_alone_swings_about_its_rest_angle(swinging):
    stiffness, rest = 0.05, 0.2
    model = swinging(weight=False, torsion_spring={"stiffness_n_m_per_rad": stiffness, "rest_rad": rest})
    motion = follow(model, STEP_S, STEPS)
    assert motion.path.q.max() == pytest.approx(2 * rest, rel=CORNER)
    assert period(motion, -rest) == pytest.approx(2 * np.pi * np.sqrt(ABOUT_PIN / stiffness), rel=CORNER)


def test_viscous_friction_slows_a_turning_bar_exponentially(swinging):
    damping = 2e-3
    motion = follow(swinging(0.0, weight=False, viscous_friction=damping), STEP_S, STEPS, spun(5.0))
    expected = 5.0 * np.exp(-damping * motion.path.time_s / ABOUT_PIN)
    np.testing.assert_allclose(motion.path.rate[:, 0], expected, atol=5.0 * CORNER)


def test_a_damper_that_turns_as_the_bar_swings_brakes_it_as_its_equation_says():
    damping, post = 2.0, np.array([0.1, 0.0])
    ends = {"anchor_a_m": [LENGTH, 0, 0], "anchor_b_m": [*post, 0.0]}
    model = build(
        pendulum(1.0, effects=[effect("damper", "extension_spring", ["link"], **ends, damping_n_s_per_m=damping)])
    )

    def fall(_, state):
        angle, rate = state
        tip, along = LENGTH * np.array([[np.sin(angle), -np.cos(angle)], [np.cos(angle), np.sin(angle)]])
        lever = along @ (tip - post) / np.linalg.norm(tip - post)
        torque = -MASS * G * LENGTH / 2 * np.sin(angle) - damping * lever**2 * rate
        return rate, torque / ABOUT_PIN

    motion = follow(model, STEP_S, 400)
    wanted = solve_ivp(fall, (0, 0.4), (1.0, 0.0), t_eval=motion.path.time_s, rtol=1e-9, atol=1e-11).y[0]
    # Second order; with the rate of the step before taken along that step's direction it was first, 7e-4 off.
    np.testing.assert_allclose(1.0 + motion.path.q[:, 0], wanted, atol=5e-5)


def test_a_steady_torque_gives_a_steady_acceleration(swinging):
    for torque in ({"effort_offset": 0.01}, {"applied_torque": {"torque_n_m": 0.01}}):
        motion = follow(swinging(weight=False, **torque), STEP_S, STEPS)
        expected = 0.5 * (0.01 / ABOUT_PIN) * motion.path.time_s**2
        np.testing.assert_allclose(motion.path.q[:, 0], expected, atol=3 * CORNER * expected[-1])


def test_coulomb_friction_stops_a_turning_bar_after_the_time_and_angle_of_a_steady_torque(swinging):
    torque, rate = 0.01, 5.0
    motion = follow(swinging(0.0, weight=False, coulomb_friction=torque), STEP_S, STEPS, spun(rate))
    time = ABOUT_PIN * rate / torque
    turning = motion.path.rate[:, 0] > 1e-2
    assert motion.path.time_s[turning][-1] == pytest.approx(time, abs=2 * STEP_S + 1e-2 * ABOUT_PIN / torque)
    # The last step may end anywhere inside itself: deceleration x h² / 2, and the creep of a sticking joint.
    slack = torque / ABOUT_PIN * STEP_S**2 + 1e-4 * motion.path.time_s[-1]
    assert motion.path.q[-1, 0] == pytest.approx(0.5 * rate * time, abs=slack)


def test_a_bar_held_by_coulomb_friction_creeps_less_than_a_micrometre_a_second(swinging):
    weight = 0.5 * MASS * G * LENGTH * np.sin(0.5)
    motion = follow(swinging(0.5, coulomb_friction=2.0 * weight), STEP_S, STEPS)
    tip = LENGTH * np.abs(motion.path.q[-1, 0] - motion.path.q[STEPS // 2, 0]) / (STEP_S * STEPS / 2)
    assert tip < 1e-6


def test_a_bar_that_friction_cannot_hold_falls(swinging):
    weight = 0.5 * MASS * G * LENGTH * np.sin(0.5)
    motion = follow(swinging(0.5, coulomb_friction=0.9 * weight), STEP_S, STEPS)
    assert np.abs(motion.path.q).max() > 0.05


@pytest.mark.parametrize(("share", "holds"), [(0.97, True), (1.03, False)])
def test_pin_friction_holds_the_bar_up_to_the_angle_where_its_moment_arm_fits_the_pin(swinging, share, holds):
    friction = 0.3
    critical = np.arcsin(2 * friction * PIN_RADIUS_M / LENGTH)  # m g sin(θ) L/2 = μ r m g
    motion = follow(swinging(share * critical, pin_friction=friction), STEP_S, STEPS)
    # A held pin creeps below 1e-3 rad/s; 3% too much weight for two seconds moves it a hundred times further.
    assert (np.abs(motion.path.rate).max() < 1e-3) == holds


def test_a_hanging_bar_pulls_its_pin_with_its_weight(swinging):
    motion = follow(swinging(0.0), STEP_S, STEPS)
    np.testing.assert_allclose(motion.force[:, 0], np.tile([0, MASS * G, 0], (STEPS + 1, 1)), atol=SOLVED)
    np.testing.assert_allclose(motion.torque, 0.0, atol=SOLVED * LENGTH)


def test_the_pin_of_a_spinning_bar_pulls_it_to_the_centre(swinging):
    rate = 6.0
    motion = follow(swinging(0.0, weight=False), STEP_S, STEPS, spun(rate))
    angle = motion.path.q[:, 0] - np.pi / 2
    centre = -np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], -1)
    pull = MASS * rate**2 * LENGTH / 2
    np.testing.assert_allclose(motion.force[:, 0], pull * centre, atol=2 * CORNER * pull)


def test_a_push_across_the_bar_is_shared_between_acceleration_and_the_pin(swinging):
    push = 0.2  # at the centre of mass, along x
    motion = follow(swinging(0.0, weight=False, applied_force={"force_n": push}), 1e-4, STEPS)
    turn = push * (LENGTH / 2) / ABOUT_PIN
    assert motion.path.rate[10, 0] == pytest.approx(turn * 1e-3, rel=1e-6)
    pin = MASS * turn * LENGTH / 2 - push
    assert motion.force[0, 0, 0] == pytest.approx(pin, rel=1e-6)


def test_the_pin_carries_the_torque_of_its_friction(swinging):
    torque = 0.01
    motion = follow(swinging(0.0, weight=False, coulomb_friction=torque), STEP_S, STEPS, spun(5.0))
    assert motion.torque[100, 0, 2] == pytest.approx(-torque, rel=1e-6)
