"""Bodies that lie on the bed, across z, against what textbooks say of dry friction."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from backend.model.build import build
from backend.model.system import STICK_RATE
from tests.mechanisms import Z, bar, body, drawing, effect
from tests.motions import follow

G, STEP_S = 9.81, 1e-3
LENGTH, MASS, FRICTION = 0.2, 0.1, 0.3
RUB = effect("bed", "surface_friction", "all", friction_coefficient=FRICTION)


def pinned(at):
    """A bar pinned at a share of its length."""
    link = bar("link", (0, 0, 0), (LENGTH, 0, 0), MASS)
    pin = ("pin", "revolute", "ground", "link", (at * LENGTH, 0, 0), Z)
    return build(drawing("bar on the bed", [link], [pin], [RUB], gravity=(0, 0, -G)))


def block(joint="planar", slope=0.0):
    """A block that slides on the bed, or along a rail on it; gravity leans by `slope` along x."""
    part = body("block", (0, 0, 0), Rotation.identity(), MASS, np.array([2e-4, 3e-4, 4e-4]))
    held = ("held", joint, "ground", "block", (0, 0, 0), Z if joint == "planar" else (1, 0, 0))
    down = (G * np.sin(slope), 0, -G * np.cos(slope))
    return build(drawing("block on the bed", [part], [held], [RUB], gravity=down))


@pytest.mark.parametrize(
    ("at", "braking"),
    # μ m g / L per length at arm x: a torque of μ m g L / 2 on m L² / 3, and of μ m g L / 4 on m L² / 12.
    [(0.0, 3 * FRICTION * G / (2 * LENGTH)), (0.5, 3 * FRICTION * G / LENGTH)],
    ids=["about its end", "about its middle"],
)
def test_a_spinning_bar_is_braked_as_a_uniform_one(at, braking):
    spin, middle = 5.0, (0.5 - at) * LENGTH
    motion = follow(pinned(at), STEP_S, 300, np.array([[0, spin * middle, 0, 0, 0, spin]]))
    slowing = motion.path.rate[:, 0] > 0.2 * spin
    slope = np.polyfit(motion.path.time_s[slowing], motion.path.rate[slowing, 0], 1)[0]
    assert -slope == pytest.approx(braking, rel=3e-3)  # it is 10 mm wide: w² / L² = 0.25% more inertia
    assert motion.path.q[-1, 0] == pytest.approx(spin**2 / (2 * braking), rel=3e-3)
    assert np.abs(motion.path.rate[-1, 0]) < 1e-9


@pytest.mark.parametrize("joint", ["planar", "prismatic"])
def test_a_block_slides_until_its_energy_is_spent(joint):
    speed = 0.8
    motion = follow(block(joint), STEP_S, 400, np.array([[speed, 0, 0, 0, 0, 0]]))
    gone = motion.path.pose.position[-1, 0] - motion.path.pose.position[0, 0]
    assert gone[0] == pytest.approx(speed**2 / (2 * FRICTION * G), rel=1e-5)  # the last step is not a whole one
    np.testing.assert_allclose(gone[1:], 0.0, atol=1e-9)  # what the solver leaves in 400 steps
    assert np.abs(motion.path.velocity[-1]).max() < 1e-9


def test_a_block_on_a_tilted_bed_creeps_less_than_a_micrometre_a_second():
    slope = 0.8 * np.arctan(FRICTION)
    model = block(slope=slope)
    motion = follow(model, STEP_S, 400)
    used = np.tan(slope) / FRICTION
    creep = np.diff(motion.path.pose.position[200::100, 0, 0]) / (100 * STEP_S)
    # The regularised law holds with u / √(u² + v²) of its limit.
    law = STICK_RATE * float(model.scale.length_m) * used / np.sqrt(1 - used**2)
    np.testing.assert_allclose(creep, law, rtol=1e-2)
    assert (creep < 1e-6).all()


def test_a_block_on_a_steeper_bed_slides_down():
    slope = 1.5 * np.arctan(FRICTION)
    motion = follow(block(slope=slope), STEP_S, 400)
    fall = G * (np.sin(slope) - FRICTION * np.cos(slope))
    gone = motion.path.pose.position[-1, 0, 0] - motion.path.pose.position[0, 0, 0]
    assert gone == pytest.approx(0.5 * fall * motion.path.time_s[-1] ** 2, rel=1e-4)


def test_energy_only_goes_on_the_bed():
    motion = follow(pinned(0.0), STEP_S, 300, np.array([[0, 0.5, 0, 0, 0, 5.0]]))
    assert np.max(np.diff(motion.energy)) <= 1e-9 * motion.energy[0]  # rounding
    assert motion.energy[-1] < 1e-9 * motion.energy[0]


def test_a_bed_needs_joints_that_turn_about_one_direction():
    link, other = bar("link", (0, 0, 0), (LENGTH, 0, 0)), bar("other", (LENGTH, 0, 0), (2 * LENGTH, 0, 0))
    pins = [
        ("pin", "revolute", "ground", "link", (0, 0, 0), Z),
        ("skew", "revolute", "link", "other", (LENGTH, 0, 0), (0, 1, 1)),
    ]
    with pytest.raises(ValueError, match="'bed': joints 'pin' and 'skew' turn about axes 45 degrees apart"):
        build(drawing("skew", [link, other], pins, [RUB]))


def test_a_slide_beside_pins_leaves_the_camera_square_to_the_motion():
    crank, slider = bar("crank", (0, 0, 0), (LENGTH, 0, 0)), bar("slider", (LENGTH, 0, 0), (2 * LENGTH, 0, 0))
    joints = [
        ("pin", "revolute", "ground", "crank", (0, 0, 0), Z),
        ("slide", "prismatic", "crank", "slider", (LENGTH, 0, 0), (1, 0, 0)),
    ]
    np.testing.assert_allclose(build(drawing("slide", [crank, slider], joints)).view_axis, Z, atol=1e-12)
