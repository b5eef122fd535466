"""A block on a rail, against what textbooks say about it."""

import numpy as np
import pytest

from backend.effects.air_drag import AIR_DENSITY_KG_PER_M3
from tests.motions import crossings, follow

MASS, G = 0.5, 9.81
STEP_S, STEPS = 1e-3, 2000
POST_M = 0.3
SOLVED = MASS * 1e-10 * 0.1 / STEP_S**2  # N: the error of a step's displacement that the solver leaves, over h²


def pushed(speed):
    return np.array([[speed, 0, 0, 0, 0, 0]])


def test_coulomb_friction_stops_a_block_after_the_distance_that_its_energy_buys(sliding):
    friction, speed = 1.5, 2.0
    motion = follow(sliding(coulomb_friction=friction), STEP_S, STEPS, pushed(speed))
    assert motion.path.q[-1, 0] == pytest.approx(0.5 * MASS * speed**2 / friction, rel=1e-4)
    moving = motion.path.time_s[motion.path.rate[:, 0] > 1e-3]
    assert moving[-1] == pytest.approx(MASS * speed / friction, abs=2 * STEP_S)


def test_viscous_friction_slows_a_block_exponentially(sliding):
    motion = follow(sliding(viscous_friction=1.0), STEP_S, STEPS, pushed(2.0))
    expected = 2.0 * np.exp(-1.0 / MASS * motion.path.time_s)
    np.testing.assert_allclose(
        motion.path.rate[:, 0], expected, atol=1e-5
    )  # (b h / m)² / 2 of the speed, by central differences


def test_a_stuck_block_creeps_less_than_a_micrometre_a_second(sliding):
    pull = {"applied_force": {"force_n": 1.0}}
    motion = follow(sliding(coulomb_friction=2.0, **pull), STEP_S, STEPS)
    assert np.abs(motion.path.q[-1, 0] - motion.path.q[STEPS // 2, 0]) / (STEP_S * STEPS / 2) < 1e-6


def test_a_steady_force_gives_a_steady_acceleration(sliding):
    for force in ({"effort_offset": 0.7}, {"applied_force": {"force_n": 0.7}}):
        motion = follow(sliding(**force), STEP_S, STEPS)
        np.testing.assert_allclose(motion.path.q[:, 0], 0.5 * 0.7 / MASS * motion.path.time_s**2, atol=1e-9)


def test_a_block_on_a_spring_swings_at_its_own_frequency(sliding):
    stiffness = 40.0
    spring = {"stiffness_n_per_m": stiffness, "free_length_m": POST_M - 0.02}
    motion = follow(sliding(extension_spring=spring), STEP_S, STEPS)
    times = crossings(motion.path.time_s, 0.02 - motion.path.q[:, 0])
    assert motion.path.q.max() == pytest.approx(0.04, rel=1e-5)
    assert np.diff(times).mean() == pytest.approx(2 * np.pi * np.sqrt(MASS / stiffness), rel=1e-5)  # (w h)² / 24


def test_a_damper_beside_the_spring_makes_the_swing_die_away(sliding):
    stiffness, damping, stretch = 40.0, 1.5, 0.02
    spring = {"stiffness_n_per_m": stiffness, "free_length_m": POST_M - stretch, "damping_n_s_per_m": damping}
    motion = follow(sliding(extension_spring=spring), STEP_S, STEPS)
    decay = damping / (2 * MASS)
    rate = np.sqrt(stiffness / MASS - decay**2)
    t = motion.path.time_s
    expected = stretch * (1 - np.exp(-decay * t) * (np.cos(rate * t) + decay / rate * np.sin(rate * t)))
    np.testing.assert_allclose(motion.path.q[:, 0], expected, atol=1e-5 * stretch)  # (w h)² / 24 per radian, 18 rad


def test_falling_blocks_reach_the_speed_at_which_drag_carries_their_weight(sliding):
    falling = (G, 0.0, 0.0)
    slow = follow(sliding(falling, linear_drag=4.0), 2e-3, STEPS)
    assert slow.path.rate[-1, 0] == pytest.approx(MASS * G / 4.0, rel=1e-9)
    fast = follow(sliding(falling, air_drag=0.5), 2e-3, STEPS)
    assert fast.path.rate[-1, 0] == pytest.approx(np.sqrt(2 * MASS * G / (AIR_DENSITY_KG_PER_M3 * 0.5)), rel=1e-4)


def test_the_rail_carries_the_weight_across_it(sliding):
    motion = follow(sliding((0.0, -G, 0.0)), STEP_S, STEPS)
    np.testing.assert_allclose(motion.force[:, 0], np.tile([0, MASS * G, 0], (STEPS + 1, 1)), atol=2 * SOLVED)
