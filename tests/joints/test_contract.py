"""Questions put to every kind of joint that can be simulated."""

from typing import get_args

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from backend.frames import quaternion
from backend.joints.catalogue import catalogue, joint_of_type
from backend.joints.joint import ROWS, SLIDE, TURN
from backend.mechanism.constraints import HELD
from backend.mechanism.joint import WITHOUT_COORDINATE, JointType
from backend.model.build import build
from backend.model.state import drawn_pose
from backend.model.system import system
from backend.simulate import kinematics
from backend.simulate.assemble import free_motions
from tests.mechanisms import SKEW_INERTIA, WEIGHTLESS, body, drawing
from tests.motions import allowed, follow

ALL = sorted(catalogue())


@pytest.fixture(scope="module", params=ALL)
def joined(request):
    """Two free bodies joined by one joint about a skew axis; the system, and its drawn pose."""
    one = body("one", (0.1, 0.2, 0.3), Rotation.from_rotvec([0.3, 0, 0.1]), 0.2, SKEW_INERTIA, (0.01, 0, 0))
    two = body("two", (0.2, 0.2, 0.1), Rotation.from_rotvec([0, 0.4, 0.2]), 0.3, SKEW_INERTIA, (0, 0.02, 0))
    link = ("joint", request.param, "one", "two", (0.15, 0.21, 0.2), (0.3, -0.5, 0.8))
    model = build(drawing("pair", [one, two], [link]))
    plant = system(model)
    return plant, drawn_pose(model, plant)


@pytest.mark.parametrize("type_", ALL)
def test_a_coordinate_is_a_row_that_the_joint_does_not_hold(type_):
    joint = joint_of_type(type_)
    free = [row for row, held in enumerate(joint.held) if not held]
    assert len(joint.held) == len(ROWS)
    assert joint.coordinate in (None, *free)
    assert joint.coordinate in (None, SLIDE, TURN)
    assert (joint.coordinate is None) == (type_ in WITHOUT_COORDINATE)


@pytest.mark.parametrize("type_", ALL)
def test_the_drawing_counts_the_rows_that_the_joint_holds(type_):
    offsets, turns = HELD[type_]
    assert [r for r, held in enumerate(joint_of_type(type_).held) if held] == [*offsets, *(3 + r for r in turns)]


def test_every_type_that_can_be_drawn_can_be_simulated():
    assert set(get_args(JointType)) == set(ALL)


def test_a_type_without_a_file_is_refused_with_the_types_that_have_one():
    with pytest.raises(ValueError, match=r"'rubber' cannot be simulated yet.*fixed, planar, prismatic, revolute"):
        joint_of_type("rubber")


def test_a_joint_drawn_closed_has_no_offset_and_starts_at_zero(joined):
    plant, pose = joined
    placed = kinematics.bodies(plant, pose)
    np.testing.assert_allclose(kinematics.rows(plant, placed).value, 0.0, atol=1e-15)  # rounding of half a metre
    np.testing.assert_allclose(kinematics.coordinates(plant, placed), 0.0, atol=1e-15)


def test_the_rows_change_with_the_poses_as_their_jacobian_says(joined):
    plant, drawn = joined
    rng = np.random.default_rng(7)
    pose = drawn.advance(jnp.asarray(0.1 * rng.standard_normal((2, 6))))  # a joint far from closed

    def held_rows(xi):
        return kinematics.rows(plant, kinematics.bodies(plant, pose.advance(xi))).value

    def coordinate(xi):
        return kinematics.turned(plant, xi)

    jacobian = kinematics.rows(plant, kinematics.bodies(plant, pose)).jacobian[0]
    direction = jnp.asarray(rng.standard_normal((2, 6)))
    step = 1e-6
    difference = (held_rows(step * direction) - held_rows(-step * direction))[0] / (2 * step)
    turned = (coordinate(step * direction) - coordinate(-step * direction))[0] / (2 * step)
    if plant.coordinate[0] == TURN:
        difference = difference.at[TURN].set(turned)  # a free turn is measured about the pin, not by its sine
    np.testing.assert_allclose(jacobian @ direction.ravel(), difference, atol=1e-8)  # central differences at 1e-6


def test_moving_along_the_free_motions_opens_nothing_and_changes_every_row_that_is_free(joined):
    plant, pose = joined
    motions = free_motions(plant, pose)
    held = plant.held_rows[0]
    free = 6 - held.sum()
    assert motions.shape == (2, 6, 6 + free)  # the pair flies freely, and moves at its joint
    jacobian = kinematics.rows(plant, kinematics.bodies(plant, pose)).jacobian[0]
    along = jnp.einsum("ri,im->rm", jacobian, motions.reshape(12, -1))
    np.testing.assert_allclose(along[held], 0.0, atol=1e-12)
    assert np.linalg.matrix_rank(np.asarray(along[~held]), tol=1e-9) == free


STEP_S = 5e-4


@pytest.fixture(scope="module")
def tumbling():
    """A pair of weightless bodies for every type, tumbling about its joint for half a second in one program."""
    bodies, links = [], []
    for k, type_ in enumerate(ALL):
        one, two = f"one_{type_}", f"two_{type_}"
        turned = Rotation.from_rotvec([0.4, 0, 0.2])
        bodies += [
            body(one, (0, 0, k), Rotation.identity(), 0.2, SKEW_INERTIA, (0.0, 0.01, 0.0)),
            body(two, (0.1, 0, k), turned, 0.3, 2 * SKEW_INERTIA, (0.02, 0.0, 0.01)),
        ]
        links.append((type_, type_, one, two, (0.05, 0.01, k), (0.3, 0.5, 0.8)))
    model = build(drawing("pairs", bodies, links, gravity=WEIGHTLESS))
    free = 6 * len(links) + sum(6 - sum(joint_of_type(type_).held) for type_ in ALL)
    velocity = allowed(model, np.random.default_rng(3).uniform(0.5, 1.5, free).tolist())
    return system(model), follow(model, STEP_S, 1000, velocity)


def corner(motion):
    """(h ω)²: what central differences leave of velocities at a node, relative."""
    return (STEP_S * np.abs(motion.path.velocity[:, :, 3:]).max()) ** 2


@pytest.mark.parametrize("type_", ALL)
def test_a_tumbling_joint_keeps_its_held_rows_closed_and_lets_the_others_move(tumbling, type_):
    plant, motion = tumbling
    joint, held = ALL.index(type_), np.array(joint_of_type(type_).held)
    value = np.asarray(jax.vmap(lambda p: kinematics.rows(plant, kinematics.bodies(plant, p)).value)(motion.path.pose))
    assert np.abs(value[:, joint, held]).max(initial=0.0) < 1e-9  # m and sines; the solver stops at 1e-10 lengths
    for row in np.flatnonzero(~held):
        assert np.ptp(value[:, joint, row]) > 1e-2, ROWS[row]
    assert (np.ptp(motion.path.q[:, joint]) > 1e-2) == (plant.coordinate[joint] is not None)


@pytest.mark.parametrize("type_", ALL)
def test_the_reaction_of_a_tumbling_joint_does_no_work(tumbling, type_):
    plant, motion = tumbling
    joint = ALL.index(type_)
    a, b = plant.pairs[joint]
    pose, velocity = motion.path.pose, motion.path.velocity
    R = np.asarray(quaternion.rotation(jnp.asarray(pose.quaternion)))
    spin = np.einsum("nbij,nbj->nbi", R, velocity[:, :, 3:])
    arm = np.einsum("nij,j->ni", R[:, b], plant.point_b[joint])
    at_b = velocity[:, b, :3] + np.cross(spin[:, b], arm)
    at_a = velocity[:, a, :3] + np.cross(spin[:, a], pose.position[:, b] + arm - pose.position[:, a])
    force, torque = motion.force[:, joint], motion.torque[:, joint]
    power = np.sum(force * (at_b - at_a), -1) + np.sum(torque * (spin[:, b] - spin[:, a]), -1)
    size = np.abs(force).max() * np.abs(at_b).max() + np.abs(torque).max() * np.abs(spin[:, b]).max()
    assert size > 1e-3  # W: the joint carries something
    np.testing.assert_allclose(power, 0.0, atol=corner(motion) * size)


def test_tumbling_pairs_keep_energy_and_momentum(tumbling):
    _, motion = tumbling
    np.testing.assert_allclose(motion.energy, motion.energy[0], rtol=corner(motion))
    size = np.abs(motion.momentum[0]).max()
    np.testing.assert_allclose(motion.momentum, motion.momentum[:1].repeat(1001, 0), atol=corner(motion) * size)
