"""Questions put to every kind of joint that can be simulated."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from backend.joints.catalogue import catalogue, joint_of_type
from backend.joints.joint import ROWS, SLIDE, TURN
from backend.model.build import build
from backend.model.state import drawn_pose
from backend.model.system import system
from backend.simulate import kinematics
from backend.simulate.assemble import free_motions
from tests.mechanisms import SKEW_INERTIA, body, drawing

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
    assert free == ([] if joint.coordinate is None else [joint.coordinate])
    assert joint.coordinate in (None, SLIDE, TURN)


def test_a_type_without_a_file_is_refused_with_the_types_that_have_one():
    with pytest.raises(ValueError, match=r"'rubber' cannot be simulated yet.*fixed, prismatic, revolute"):
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


def test_moving_along_the_free_motions_opens_nothing_and_changes_only_the_coordinate(joined):
    plant, pose = joined
    motions = free_motions(plant, pose)
    free = 0 if plant.coordinate[0] is None else 1
    assert motions.shape == (2, 6, 6 + free)  # the pair flies freely, and moves at its joint
    jacobian = kinematics.rows(plant, kinematics.bodies(plant, pose)).jacobian[0]
    along = jnp.einsum("ri,im->rm", jacobian, motions.reshape(12, -1))
    held = plant.held_rows[0]
    np.testing.assert_allclose(along[held], 0.0, atol=1e-12)
    assert np.linalg.matrix_rank(np.asarray(along[~held]), tol=1e-9) == free
