"""What touches and rubs, each peer alone against statics and the laws of impact."""

import numpy as np
import pytest


def test_a_pin_dropped_in_its_hole_rests_at_the_bottom_as_deep_as_the_wall_is_soft(linkages, simulate):
    drawn = linkages.loose_pin(radial_m=1e-3, stiffness_n_per_m=1e5)
    motion = simulate(drawn, 0.15, 1e-4, output_step_s=0.01)
    depth = 0.1 * 9.81 / 1e5
    np.testing.assert_allclose(motion.position_m["pin"][-1], [0.0, -1e-3 - depth, 0.0], atol=1e-9)
    assert motion.constraint_error_m.max() < 1e-12  # the play is no error


def test_a_rigid_wall_holds_a_pin_within_a_micrometre(linkages, simulate):
    motion = simulate(linkages.loose_pin(radial_m=1e-3, radius=0.0), 0.1, 1e-4, output_step_s=0.01)
    assert motion.position_m["pin"][-1, 1] == pytest.approx(-1e-3, abs=1e-6)  # Exudyn's stands for rigid: 0.1 µm


def test_a_pin_without_a_stated_play_takes_the_drawn_fit(linkages, simulate):
    drawn = linkages.loose_pin(stiffness_n_per_m=1e5)
    drawn["joints"][0]["fit"]["hole_diameter_m"] = 0.0084
    motion = simulate(drawn, 0.15, 1e-4, output_step_s=0.01)
    assert motion.position_m["pin"][-1, 1] == pytest.approx(-2e-4 - 0.1 * 9.81 / 1e5, abs=1e-8)


@pytest.mark.parametrize("stiffness", [{}, {"stiffness_n_per_m": 1e6}])
@pytest.mark.parametrize("restitution", [0.4, 0.8])
def test_a_bouncing_pin_keeps_the_square_of_its_restitution(linkages, simulate, restitution, stiffness):
    # A gram, so that the blow is over before gravity adds to it.
    drawn = linkages.loose_pin(mass=1e-3, radial_m=1e-3, restitution=restitution, **stiffness)
    motion = simulate(drawn, 0.0148, 2e-6)
    v, y = motion.velocity_m_per_s["pin"][:, 1], motion.position_m["pin"][:, 1]
    blow = int(np.argmax(v))
    assert v.min() == pytest.approx(-np.sqrt(2 * 9.81 * 1e-3), rel=2e-3)  # one step early at most
    assert y[blow] == pytest.approx(-1e-3, abs=2e-5)
    assert 1 - (v[blow] / v.min()) ** 2 == pytest.approx(1 - restitution**2, rel=0.02)


def test_an_inelastic_blow_leaves_almost_no_speed(linkages, simulate):
    motion = simulate(linkages.loose_pin(radial_m=1e-3), 0.05, 2e-5)
    v = motion.velocity_m_per_s["pin"][:, 1]
    assert v.min() < -0.138
    assert v.max() < 0.15 * -v.min()  # 5% in MuJoCo, 12% in Exudyn: its wall is met a step late


def test_a_spinning_pin_climbs_its_hole_to_the_angle_of_friction_and_is_braked_there(linkages, simulate):
    play, radius, mass, friction, stiffness, spin = 1e-3, 0.004, 0.1, 0.3, 1e6, 50.0
    angle = np.arctan(friction)
    reach = play + mass * 9.81 * np.cos(angle) / stiffness
    place = (-reach * np.sin(angle), -reach * np.cos(angle))  # friction pushes a pin that spins about +z to -x
    rubs = {"radial_m": play, "friction_coefficient": friction, "stiffness_n_per_m": stiffness}
    drawn = linkages.loose_pin(place, mass, radius=radius, **rubs)
    motion = simulate(drawn, 0.04, 4e-5, output_step_s=1e-3, initial_joint_velocities={"j": spin})
    # N = m g cos φ and μ N = m g sin φ hold the pin where it is; μ N r brakes its turn.
    np.testing.assert_allclose(motion.position_m["pin"], np.tile([*place, 0.0], (41, 1)), atol=0.01 * play)
    braking = (motion.joint_velocities["j"][0] - motion.joint_velocities["j"][-1]) / 0.04
    assert braking == pytest.approx(mass * 9.81 * np.sin(angle) * radius / 1e-5, rel=5e-3)


def test_a_loose_pin_that_rubs_must_say_so_in_its_clearance(linkages, simulate):
    drawn = linkages.loose_pin(radial_m=1e-3)
    drawn["effects"].append(linkages.effect("rub", "pin_friction", ["j"], friction_coefficient=0.1))
    with pytest.raises(ValueError, match='"j" has both clearance and pin_friction'):
        simulate(drawn, 0.1, 1e-3)


def test_a_clearance_without_a_number_or_a_fit_is_refused(linkages, simulate):
    with pytest.raises(ValueError, match='"j" has no fit'):
        simulate(linkages.loose_pin(radius=0.0), 0.1, 1e-3)


def test_a_rectangular_hole_is_refused_by_name(linkages, simulate):
    with pytest.raises(ValueError, match="round holes only"):
        simulate(linkages.loose_pin(radial_m=1e-3, shape="rectangle"), 0.1, 1e-3)


def test_mujoco_refuses_friction_on_a_rigid_wall(linkages, simulate_mujoco):
    with pytest.raises(ValueError, match=r'"j".*no clearance with friction_coefficient on a rigid wall'):
        simulate_mujoco(linkages.loose_pin(radial_m=1e-3, friction_coefficient=0.1), 0.1, 1e-3)


def test_a_bar_on_the_bed_slides_v_squared_over_two_mu_g(linkages, simulate):
    friction, speed = 0.3, 0.5
    rub = linkages.effect("bed", "surface_friction", ["mass"], friction_coefficient=friction)
    drawn = linkages.sliding_mass(effects=[rub])
    motion = simulate(drawn, 0.2, 1e-4, output_step_s=0.01, initial_joint_velocities={"slide": speed})
    assert motion.joint_positions["slide"][-1] == pytest.approx(speed**2 / (2 * friction * 9.81), rel=1e-3)
    assert abs(motion.joint_velocities["slide"][-1]) < 1e-4


def test_a_bar_that_turns_on_the_bed_is_braked_at_its_quarter_points(linkages, simulate):
    length, mass, friction, spin = 0.2, 0.1, 0.3, 5.0
    rub = linkages.effect("bed", "surface_friction", "all", friction_coefficient=friction)
    drawn = {**linkages.pendulum(0.0, length, mass, [rub]), "gravity_m_per_s2": [0.0, 0.0, -9.81]}
    motion = simulate(drawn, 0.1, 1e-4, output_step_s=0.01, initial_joint_velocities={"j": spin})
    square = (length**2 + 0.01**2) / 12
    # Pads at length/2 ± (√3/2) √square carry half the weight each; the pin is at one end.
    braking = friction * mass * 9.81 * length / 2 / (mass * (square + length**2 / 4))
    np.testing.assert_allclose(motion.joint_velocities["j"], spin - braking * motion.time_s, rtol=1e-3)


def test_the_bed_must_lie_across_every_axis(linkages, simulate):
    drawn = linkages.bennett()
    drawn["effects"] = [linkages.effect("bed", "surface_friction", "all", friction_coefficient=0.1)]
    with pytest.raises(ValueError, match="turn about different axes"):
        simulate(drawn, 0.1, 1e-3)


def test_pin_friction_brakes_with_radius_times_load(linkages, simulate):
    disc = linkages.body("disc", (0, 0, 0), (1.0, 0, 0, 0), 0.1, (0, 0, 0), (1e-4, 1e-4, 1e-4))
    hinge = {**linkages.joint("j", linkages.GROUND, disc, (0, 0, 0)), "fit": {"pin_diameter_m": 0.02}}
    rub = linkages.effect("rub", "pin_friction", ["j"], friction_coefficient=0.2)
    motion = simulate(
        linkages.mechanism([disc], [hinge], [rub]), 0.1, 1e-4, output_step_s=0.01, initial_joint_velocities={"j": 5.0}
    )
    braking = 0.2 * 0.01 * 0.1 * 9.81 / 1e-4
    np.testing.assert_allclose(motion.joint_velocities["j"], 5.0 - braking * motion.time_s, atol=1e-3)


@pytest.mark.parametrize(("share", "held"), [(0.98, True), (1.02, False)])
def test_pin_friction_holds_a_bar_up_to_two_mu_r_over_its_length(linkages, simulate, share, held):
    length, friction, radius = 0.2, 0.5, 0.02
    rub = linkages.effect("rub", "pin_friction", ["j"], friction_coefficient=friction)
    drawn = linkages.pendulum(np.arcsin(share * 2 * friction * radius / length), length, effects=[rub])
    drawn["joints"][0]["fit"] = {"pin_diameter_m": 2 * radius}
    motion = simulate(drawn, 0.3, 2e-4, output_step_s=0.1)
    # 2% more than friction holds turns it by ½ · 3 g sin θ/(2 L) · 2% t² = 0.007 rad; creep stays far below.
    assert (abs(motion.joint_positions["j"][-1]) < 1e-3) == held


def test_mujoco_counts_a_springs_pull_among_what_a_pin_carries(linkages, simulate_exudyn, simulate_mujoco):
    rub = linkages.effect("rub", "pin_friction", "all", friction_coefficient=0.3)
    drawn = linkages.scissor(2, 100.0, [rub])
    for joint in drawn["joints"]:
        joint["fit"] = {"pin_diameter_m": 0.008}
    exudyn, mujoco, free = (
        simulate_exudyn(drawn, 0.06, 2e-4, output_step_s=0.01),
        simulate_mujoco(drawn, 0.06, 2e-4, output_step_s=0.01),
        simulate_mujoco({**drawn, "effects": drawn["effects"][:1]}, 0.06, 2e-4, output_step_s=0.01),
    )
    q = mujoco.joint_positions["centre0"]
    apart, braked = (np.abs(other.joint_positions["centre0"] - q).max() for other in (exudyn, free))
    assert apart < 0.03 * braked  # MuJoCo rubs with the last step's load


def test_a_bar_that_falls_on_a_rail_rests_where_the_two_touch(linkages, simulate):
    motion = simulate(linkages.roller(height=0.001), 0.06, 2e-5, output_step_s=0.01)
    assert motion.position_m["bar"][-1, 1] == pytest.approx(0.03, abs=1e-6)  # 0.1 µm of Exudyn's wall
    assert motion.velocity_m_per_s["bar"][:, 1].max() < 0.15 * np.sqrt(2 * 9.81 * 0.001)


def test_a_bar_bounces_off_a_rail_by_its_restitution(linkages, simulate):
    motion = simulate(linkages.roller(height=0.005, mass=0.01, restitution=0.6), 0.045, 1e-5)
    v = motion.velocity_m_per_s["bar"][:, 1]
    assert v.max() / -v.min() == pytest.approx(0.6, rel=0.01)


def test_a_round_bar_rolls_down_a_slanting_rail_at_two_thirds_of_the_slope(linkages, simulate):
    slope = 0.2
    motion = simulate(linkages.roller(slope, friction_coefficient=0.5), 0.1, 1e-4, output_step_s=0.01)
    travel = motion.position_m["bar"][:, 0]
    np.testing.assert_allclose(travel, 0.5 * 9.81 * np.sin(slope) * 2 / 3 * motion.time_s**2, atol=1e-4)
    np.testing.assert_allclose(-0.01 * motion.joint_positions["j"], travel, atol=1e-4)


def test_a_round_bar_slides_where_friction_is_less_than_a_third_of_the_slope(linkages, simulate):
    slope, friction = 0.4, 0.1
    motion = simulate(linkages.roller(slope, friction_coefficient=friction), 0.1, 1e-4, output_step_s=0.01)
    along = 9.81 * (np.sin(slope) - friction * np.cos(slope))
    np.testing.assert_allclose(motion.position_m["bar"][:, 0], 0.5 * along * motion.time_s**2, atol=2e-4)


def test_a_bar_that_falls_on_a_post_comes_to_rest_there(linkages, simulate):
    motion = simulate(linkages.falls_on(post=False), 0.3, 4e-5, output_step_s=1e-3)
    q, rate = motion.joint_positions["j"], motion.joint_velocities["j"]
    assert abs(rate[-1]) < 1e-2
    hit = np.abs(rate).argmax()
    # MuJoCo gives back 5% (damping twice critical), Exudyn 4%: its wall cannot pull.
    assert np.abs(q[hit:] - q[-1]).max() < 0.012


def test_bars_that_cross_in_space_part_alike_in_both_engines(linkages, simulate_exudyn, simulate_mujoco):
    drawn = linkages.falls_on(post=True)
    exudyn = simulate_exudyn(drawn, 0.25, 4e-5, output_step_s=1e-3)
    mujoco = simulate_mujoco(drawn, 0.25, 2e-5, output_step_s=1e-3)
    for hinge in ("j", "foot"):
        assert np.ptp(exudyn.joint_positions[hinge]) > 0.1
        # 4 to 5% of the blow comes back in either.
        np.testing.assert_allclose(exudyn.joint_positions[hinge], mujoco.joint_positions[hinge], atol=2e-3)


def test_mujoco_refuses_a_stiffness_between_links(linkages, simulate_mujoco):
    with pytest.raises(ValueError, match=r'"touch".*no link_contact with stiffness_n_per_m'):
        simulate_mujoco(linkages.roller(stiffness_n_per_m=1e5), 0.1, 1e-3)


def test_capsules_must_be_drawn(linkages, simulate):
    drawn = linkages.roller()
    del drawn["effects"][0]["parameters"]["end_b_m"]
    with pytest.raises(ValueError, match='"touch" lacks end_b_m'):
        simulate(drawn, 0.1, 1e-3)
