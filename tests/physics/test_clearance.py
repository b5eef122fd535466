"""A pin in a hole that is too wide for it, against what mechanics says about it."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from backend.model.state import Start, drawn_pose
from backend.model.system import system
from backend.simulate import giving
from backend.simulate.equations import Motion as Carried
from backend.simulate.piece import Piece
from backend.simulate.rollout import depart
from backend.simulate.step import step
from tests.loose import LENGTH, MASS, G, loose_ball, loose_bar
from tests.mechanisms import bar_inertia
from tests.motions import Motion, crossings, follow

STEP_S, STEPS, SPEED = 1e-3, 1000, 0.5
CENTRE = LENGTH / 2
GYRATION_SQUARE = bar_inertia(MASS, LENGTH)[2] / MASS


def fly(model, step_s: float = STEP_S, velocity=None) -> Motion:
    """One program for every bar."""
    return follow(model, step_s, STEPS, velocity, halvings=6)


def rebound(restitution: float, stiffness: float, step_s: float, phase: float) -> float:
    """Share of its speed that a weightless ball keeps when it strikes its hole; it flies 6 steps and a share first."""
    play = SPEED * step_s * (6 + phase)
    ball = loose_ball(radial_m=play, restitution=restitution, stiffness_n_per_m=stiffness)
    motion = fly(ball, step_s, np.array([[0, -SPEED, 0, 0, 0, 0]]))
    assert not motion.path.lost.any()
    height, speed = motion.path.pose.position[:, 0, 1], motion.path.velocity[:, 0, 1]
    turned = np.argmax(speed > -1e-2 * SPEED)
    away = turned + np.argmax(height[turned:] > -0.6 * play)
    return speed[away] / SPEED


@pytest.mark.parametrize("step_s", [1e-3, 1e-4])
@pytest.mark.parametrize("restitution", [0.3, 0.5, 0.8, 1.0])
def test_a_pin_leaves_a_rigid_hole_with_its_share_of_the_speed(restitution, step_s):
    for phase in (0.1, 0.6):  # where in a step it strikes
        assert rebound(restitution, 1e10, step_s, phase) == pytest.approx(restitution, rel=0.01)


def test_a_pin_stays_where_it_strikes_a_hole_that_gives_nothing_back():
    play = 6.4 * SPEED * STEP_S
    motion = fly(loose_ball(radial_m=play), STEP_S, np.array([[0, -SPEED, 0, 0, 0, 0]]))
    assert np.abs(motion.path.velocity[10:, 0]).max() < 2e-3 * SPEED  # the barrier's energy
    assert motion.path.pose.position[-1, 0, 1] == pytest.approx(-play, abs=2e-3 * SPEED * STEPS * STEP_S)


def test_a_piece_of_a_step_drives_a_part_out_of_its_wall_at_the_pace_of_whole_steps():
    ball = loose_ball(radial_m=6.6 * SPEED * STEP_S, restitution=0.8)
    plant = system(ball)
    flight, free = jnp.array([[0.0, -SPEED, 0.0, 0.0, 0.0, 0.0]]), giving.none(plant.contacts.count, 0)

    @functools.partial(jax.jit, static_argnums=1)
    def on(motion: Carried, cuts: int) -> Carried:
        piece = Piece(cuts)
        return step(plant, motion, piece.share * STEP_S, jnp.zeros(len(plant.coordinate)), free, piece)[0]

    motion = depart(plant, Start(drawn_pose(ball, plant), flight))
    for _ in range(7):
        motion = on(motion, 0)
    depth = 0.4 * SPEED * STEP_S  # behind the wall, for the next step to give back
    assert motion.pose.position[0, 1] == pytest.approx(-7.0 * SPEED * STEP_S)
    assert 0.9 * depth / STEP_S < on(motion, 10).velocity[0, 1] < depth / STEP_S  # at once it were 1024 times that


@pytest.mark.parametrize("restitution", [0.3, 0.5, 0.8, 1.0])
def test_a_soft_hole_loses_the_same_share_where_the_blow_is_resolved(restitution):
    stiffness, step_s = 2e5, 2e-5  # 28 steps to a radian of the blow
    kept = rebound(restitution, stiffness, step_s, 0.3)
    assert kept == pytest.approx(restitution, rel=0.025)  # the give's sides meet over a small range of speeds


@pytest.mark.parametrize("stiffness", [1e4, 2e5])
def test_a_pin_at_rest_sinks_in_by_its_weight_over_the_stiffness(stiffness):
    play = 1e-3
    motion = fly(loose_bar(0.0, (0.0, -play), radial_m=play, stiffness_n_per_m=stiffness))
    depth = -play - (motion.path.pose.position[-1, 0, 1] + CENTRE)
    assert depth == pytest.approx(MASS * G / stiffness, rel=1e-3)  # 1e-3 of it is the barrier's gap


def test_a_loose_pendulum_swings_like_one_on_a_massless_link_as_long_as_its_play():
    """The push passes through the middle of the hole, so play is a link: with a the link's angle and b the bar's,

    δ a'' + c b'' + g a = 0,    c δ a'' + (c² + k²) b'' + g c b = 0.
    """
    for play in (1e-3, 5e-3):
        squares = np.roots([GYRATION_SQUARE * play, -G * (CENTRE * (CENTRE + play) + GYRATION_SQUARE), G**2 * CENTRE])
        slow = np.sqrt(squares.min())
        bar = 0.01
        link = slow**2 * CENTRE * bar / (G - slow**2 * play)
        motion = fly(loose_bar(bar, (play * np.sin(link), -play * np.cos(link)), radial_m=play), 2 * STEP_S)
        period = np.diff(crossings(motion.path.time_s, motion.path.q[:, 0] + bar)).mean()
        assert period == pytest.approx(2 * np.pi / slow, rel=1e-4)  # 0.3 to 1.4 in a thousand: hung lower by the play


def test_a_pin_settles_at_the_wall_below_it():
    play = 1e-3
    down = np.array([1.0, -1.0, 0.0]) / np.sqrt(2)
    motion = fly(loose_bar(np.pi / 4, gravity=G * down, radial_m=play))
    turned = Rotation.from_quat(motion.path.pose.quaternion[-1, 0], scalar_first=True)
    pin = motion.path.pose.position[-1, 0] - turned.apply([CENTRE, 0, 0])
    np.testing.assert_allclose(pin, play * down, atol=2e-3 * play)  # the barrier's gap


@pytest.mark.parametrize("play", [1e-4, 5e-4])
@pytest.mark.parametrize("length", [0.02, 0.05])
def test_a_pin_between_two_rings_droops_by_twice_its_play_over_their_distance(length, play):
    beside = (0.0, 0.0, -G)  # along the hole
    motion = fly(loose_bar(np.pi / 2, gravity=beside, radial_m=play, bearing_length_m=length))
    axis = Rotation.from_quat(motion.path.pose.quaternion[:, 0], scalar_first=True).apply([0, 0, 1])
    tilt = np.linalg.norm(axis[:, :2], axis=1)
    assert not motion.path.lost.any()
    assert tilt.max() < 2 * play / length * (1 + 1e-3)  # sin, tan and angle differ by their square
    assert tilt[-1] == pytest.approx(2 * play / length, rel=1e-3)
