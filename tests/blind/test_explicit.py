"""Exudyn with explicit steps, where every pin is loose: statics, blows, and the same engine's implicit steps."""

import numpy as np
import pytest

from backend.blind.exudyn_contact import Walls


@pytest.fixture
def explicit(simulate_exudyn):
    def run(drawn, duration_s, step_s, **more):
        return simulate_exudyn(drawn, duration_s, step_s, explicit=True, **more)

    return run


def test_a_pin_dropped_in_its_hole_rests_as_deep_as_the_wall_is_soft(linkages, explicit):
    motion = explicit(linkages.loose_pin(radial_m=1e-3, stiffness_n_per_m=1e5), 0.15, 1e-5, output_step_s=0.01)
    depth = 0.1 * 9.81 / 1e5
    np.testing.assert_allclose(motion.position_m["pin"][-1], [0.0, -1e-3 - depth, 0.0], atol=1e-9)


@pytest.mark.parametrize("restitution", [0.4, 0.8])
def test_a_bouncing_pin_keeps_the_square_of_its_restitution(linkages, explicit, restitution):
    drawn = linkages.loose_pin(mass=1e-3, radial_m=1e-3, restitution=restitution, stiffness_n_per_m=1e6)
    v = explicit(drawn, 0.0148, 2e-7, output_step_s=2e-6).velocity_m_per_s["pin"][:, 1]
    assert 1 - (v.max() / v.min()) ** 2 == pytest.approx(1 - restitution**2, rel=0.02)


def test_a_spinning_pin_climbs_its_hole_to_the_angle_of_friction_and_is_braked_there(linkages, explicit):
    play, radius, mass, friction, stiffness, spin = 1e-3, 0.004, 0.1, 0.3, 1e6, 50.0
    angle = np.arctan(friction)
    reach = play + mass * 9.81 * np.cos(angle) / stiffness
    place = (-reach * np.sin(angle), -reach * np.cos(angle))
    rubs = {"radial_m": play, "friction_coefficient": friction, "stiffness_n_per_m": stiffness}
    drawn = linkages.loose_pin(place, mass, radius=radius, **rubs)
    motion = explicit(drawn, 0.04, 4e-6, output_step_s=1e-3, initial_joint_velocities={"j": spin})
    np.testing.assert_allclose(motion.position_m["pin"], np.tile([*place, 0.0], (41, 1)), atol=0.01 * play)
    braking = (motion.joint_velocities["j"][0] - motion.joint_velocities["j"][-1]) / 0.04
    assert braking == pytest.approx(mass * 9.81 * np.sin(angle) * radius / 1e-5, rel=5e-3)


def scissor(linkages, *effects):
    """Two cells in the plane that a spring opens, every pin loose by half a millimetre, and what else is given."""
    loose = linkages.effect("play", "clearance", "all", radial_m=5e-4)
    drawn = linkages.scissor(2, 100.0, [loose, *effects])
    loose["on"] = [joint["id"] for joint in drawn["joints"] if joint["type"] == "revolute"]
    return drawn


def test_a_loose_scissor_opens_as_with_implicit_steps(linkages, simulate_exudyn, explicit):
    drawn = scissor(linkages, linkages.effect("drag", "viscous_friction", "all", damping_n_m_s_per_rad=0.01))
    drawn["effects"][-1]["on"] = drawn["effects"][-2]["on"]
    short = explicit(drawn, 0.08, 1e-6, output_step_s=1e-3)
    # Ten times critical, as implicit walls usually are, they let a pin sink in so slowly that bars are 0.19 mm behind.
    usual = simulate_exudyn(drawn, 0.08, 2e-5, output_step_s=1e-3, walls=Walls(damping_ratio=2.0))
    for bar, path in short.position_m.items():
        np.testing.assert_allclose(path, usual.position_m[bar], atol=1e-4)  # walls of both are damped unlike
        # Bars may be drawn at any turn.
        assert np.abs((short.quaternion_wxyz[bar] * usual.quaternion_wxyz[bar]).sum(1)).min() > 1 - 1e-6
    assert max(np.ptp(path, axis=0).max() for path in short.position_m.values()) > 0.01


def falls_on_a_rest(linkages, **contact):
    """A bar on a loose pin falls about z on a bar that lies below it in the plane."""
    falling = linkages.bar("falling", (0.0, 0.0), (0.2, 0.0))
    rest = {**linkages.bar("rest", (0.05, -0.06), (0.3, -0.06)), "fixed": True}
    meet = linkages.effect(
        "meet",
        "link_contact",
        ["falling", "rest"],
        **{f"{end}_{side}_m": [x, 0, 0] for side in "ab" for end, x in (("start", 0.0), ("end", 0.2))},
        radius_a_m=0.01,
        radius_b_m=0.01,
        **contact,
    )
    play = linkages.effect("play", "clearance", ["j"], radial_m=2e-4)
    return linkages.mechanism([falling, rest], [linkages.joint("j", linkages.GROUND, falling, (0, 0, 0))], [play, meet])


def test_links_that_touch_come_to_rest_where_implicit_steps_leave_them(linkages, simulate_exudyn, explicit):
    drawn = falls_on_a_rest(linkages)
    short = explicit(drawn, 0.16, 1e-5, output_step_s=1e-3).joint_positions["j"]
    usual = simulate_exudyn(drawn, 0.16, 4e-5, output_step_s=1e-3).joint_positions["j"]
    assert short[-1] == pytest.approx(-np.arcsin(0.2), abs=3e-3)  # its end on the rest, less the play
    np.testing.assert_allclose(short[:70], usual[:70], atol=1e-4)  # its fall
    hit = np.argmin(np.gradient(short))
    assert np.ptp(short[hit + 3 :]) < 0.04  # 5% of a blow's speed comes back, as with implicit steps
    assert abs(short[-1] - usual[-1]) < 1e-3
    with pytest.raises(ValueError, match=r'"meet".*without bounce and friction'):
        explicit(falls_on_a_rest(linkages, restitution=0.5), 0.01, 4e-6)


def test_what_explicit_steps_cannot_do_is_refused_by_name(linkages, explicit):
    with pytest.raises(ValueError, match=r'"j".*give its pin a clearance'):
        explicit(linkages.pendulum(0.3), 0.01, 2e-6)
    with pytest.raises(ValueError, match=r'"j".*write a step of'):
        explicit(linkages.loose_pin(radial_m=1e-3, stiffness_n_per_m=1e7), 0.01, 1e-5)
    with pytest.raises(ValueError, match=r'"j0".*x-y plane'):
        explicit(linkages.bennett(), 0.01, 2e-6)
