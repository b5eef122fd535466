"""Each peer against the closed forms of mechanics."""

import numpy as np
import pytest


def test_a_small_swing_takes_the_pendulum_period_of_huygens(linkages, simulate):
    length, mass, swing = 0.2, 0.1, 0.02
    inertia = (length**2 + 0.01**2) * mass / 12 + mass * length**2 / 4
    period = 2 * np.pi * np.sqrt(inertia / (mass * 9.81 * length / 2)) * (1 + swing**2 / 16)
    drawn = linkages.pendulum()
    motion = simulate(drawn, 3.0, 1e-3, initial_joint_positions={"j": swing})
    q, t = motion.joint_positions["j"], motion.time_s
    k = np.flatnonzero(q[:-1] * q[1:] < 0)
    crossings = t[k] + q[k] / (q[k] - q[k + 1]) * (t[k + 1] - t[k])
    assert crossings[-1] - crossings[0] == pytest.approx(
        period / 2 * (len(crossings) - 1), rel=1e-5
    )  # h = 1 ms of a period of 0.73 s: (2π h / T)² / 12 = 6e-6


def test_energy_of_an_ideal_double_pendulum_stays(linkages, simulate):
    motion = simulate(linkages.double_pendulum(), 2.0, 5e-4, output_step_s=0.01)
    total = motion.kinetic_j + motion.potential_j
    assert np.ptp(total) < 2e-4 * motion.kinetic_j.max()  # Exudyn's second order at 0.5 ms: 7e-5


def test_a_slider_follows_its_crank_by_the_law_of_cosines(linkages, simulate):
    crank, rod, start = 0.05, 0.15, 1.0
    motion = simulate(linkages.slider_crank(crank, rod, start), 0.5, 5e-4, output_step_s=0.01)
    angle = start + motion.joint_positions["j1"]
    slide = crank * np.cos(angle) + np.sqrt(rod**2 - (crank * np.sin(angle)) ** 2)
    assert np.ptp(angle) > 1.0
    drawn = crank * np.cos(start) + np.sqrt(rod**2 - (crank * np.sin(start)) ** 2)
    # MuJoCo's welds give way by 2e-8 m at this step.
    np.testing.assert_allclose(motion.joint_positions["slide"], slide - drawn, atol=1e-7)
    np.testing.assert_allclose(motion.position_m["slider"][:, 0], slide, atol=1e-7)
    assert motion.position_m["slider"][0, 0] == pytest.approx(drawn, abs=1e-12)


def test_dry_friction_stops_a_sliding_mass_after_half_m_v_squared_over_force(linkages, simulate):
    mass, speed, friction = 0.5, 1.0, 1.0
    rub = linkages.effect("f", "coulomb_friction", ["slide"], friction_force_n=friction)
    motion = simulate(linkages.sliding_mass(effects=[rub]), 1.0, 1e-4, initial_joint_velocities={"slide": speed})
    assert motion.joint_positions["slide"][-1] == pytest.approx(mass * speed**2 / (2 * friction), abs=1e-6)
    assert abs(motion.joint_velocities["slide"][-1]) < 1e-6


def test_viscous_friction_lets_a_mass_coast_as_an_exponential(linkages, simulate):
    grease = linkages.effect("f", "viscous_friction", ["slide"], damping_n_s_per_m=1.0)
    motion = simulate(linkages.sliding_mass(effects=[grease]), 1.0, 1e-3, initial_joint_velocities={"slide": 1.0})
    np.testing.assert_allclose(
        motion.joint_positions["slide"], 0.5 * (1 - np.exp(-2.0 * motion.time_s)), atol=1e-6
    )  # Exudyn: (h b / m)² / 12 = 3e-7


def test_quadratic_drag_slows_a_mass_as_one_over_time(linkages, simulate):
    air = linkages.effect("f", "air_drag", ["mass"], drag_area_m2=0.5)
    rate = 0.5 * 1.225 * 0.5 / 0.5 * 2.0
    motion = simulate(linkages.sliding_mass(effects=[air]), 1.0, 1e-3, initial_joint_velocities={"slide": 2.0})
    np.testing.assert_allclose(motion.joint_velocities["slide"], 2.0 / (1 + rate * motion.time_s), atol=1e-5)


def test_a_driven_force_is_held_between_its_samples(linkages, simulate):
    push = linkages.effect("push", "effort_offset", ["slide"], force_n=1.0)
    inputs = {
        "time_s": [0.2, 0.4],
        "effect": ["push", "push"],
        "parameter": ["force_n", "force_n"],
        "value": [-2.0, 0.0],
    }
    motion = simulate(linkages.sliding_mass(effects=[push]), 0.6, 1e-3, inputs=inputs)
    # 0.5 kg: 2 m/s² for 0.2 s, then -4 m/s² for 0.2 s, then nothing.
    assert motion.joint_velocities["slide"][-1] == pytest.approx(-0.4, abs=1e-9)
    assert motion.joint_positions["slide"][-1] == pytest.approx(0.04 + 0.08 - 0.08 - 0.08, abs=5e-6)


def test_a_stop_ends_the_travel_without_a_bounce(linkages, simulate):
    stop = linkages.effect("stop", "joint_stop", ["slide"], upper=0.3)
    motion = simulate(linkages.sliding_mass(effects=[stop]), 1.0, 1e-4, initial_joint_velocities={"slide": 1.0})
    q = motion.joint_positions["slide"]
    assert q.max() == pytest.approx(0.3, abs=5e-4)  # 1 m/s sinks 0.25 mm into Exudyn's spring
    assert np.abs(motion.joint_velocities["slide"][-1]) < 0.02  # it leaves with less than 2% of its speed


def test_a_body_without_joints_falls_freely(linkages, simulate):
    stone = linkages.body("stone", (0, 0, 1), (1.0, 0, 0, 0), 0.2, (0.01, 0, 0), (1e-4, 2e-4, 2e-4))
    motion = simulate(linkages.mechanism([stone], [], gravity=(0, 0, -10.0)), 0.5, 1e-3)
    np.testing.assert_allclose(motion.position_m["stone"][:, 2], 1 - 5 * motion.time_s**2, atol=1e-9)


def test_dry_friction_in_a_closed_loop_takes_torque_times_angle(linkages, simulate):
    torque = 0.01
    rub = linkages.effect("f", "coulomb_friction", "all", friction_torque_n_m=torque)
    motion = simulate(linkages.fourbar([rub]), 0.5, 1e-4)
    turned = sum(np.abs(np.diff(q)).sum() for q in motion.joint_positions.values())
    total = motion.kinetic_j + motion.potential_j
    assert turned > 3.0
    assert total[0] - total[-1] == pytest.approx(torque * turned, rel=5e-3)  # sticking costs first order in h
