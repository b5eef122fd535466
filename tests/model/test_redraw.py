"""Errors of what was drawn, as they arrive in the moving system."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from backend.mechanism.read import parse_mechanism
from backend.model.build import build
from backend.model.state import drawn_pose
from backend.model.system import system
from backend.simulate import points
from tests.mechanisms import bar_inertia, document, double_pendulum, effect, fourbar, pendulum


def redrawn(kind, on, drawn=pendulum, **parameters):
    return system(build(drawn(effects=[effect("e", kind, on, **parameters)])))


def test_a_mass_error_scales_mass_and_inertia():
    drawn, real = system(build(pendulum())), redrawn("mass_error", ["link"], relative=0.1)
    np.testing.assert_allclose(real.mass, 1.1 * drawn.mass)
    np.testing.assert_allclose(real.inertia, 1.1 * drawn.inertia)


def test_an_inertia_error_leaves_the_mass():
    drawn, real = system(build(pendulum())), redrawn("inertia_error", ["link"], relative=-0.2)
    np.testing.assert_allclose(real.mass, drawn.mass)
    np.testing.assert_allclose(real.inertia, 0.8 * drawn.inertia)


def test_a_longer_bar_is_the_bar_drawn_longer():
    mass, length, by = 0.1, 0.2, 0.05
    real = redrawn("length_error", ["link"], relative=by)
    np.testing.assert_allclose(real.inertia[0], np.diag(bar_inertia(mass, (1 + by) * length)), rtol=1e-12)
    np.testing.assert_allclose(real.point_b[0], [-(1 + by) * length / 2, 0, 0], atol=1e-15)
    np.testing.assert_allclose(real.mass, [mass])


def test_a_stretched_coupler_carries_its_marker_along():
    model = build(fourbar(effects=[effect("e", "length_error", ["coupler"], relative=0.02)]))
    plant = system(model)
    drawn = np.array([0.28, 0.2]) - [0.05, 0.12]
    at = np.asarray(points.marker_positions(model, plant, drawn_pose(model, plant)))[0, :2]
    assert np.linalg.norm(at - [0.05, 0.12]) == pytest.approx(1.02 * np.linalg.norm(drawn), rel=1e-12)


@pytest.mark.parametrize(("name", "axis"), [("roll_rad", [1, 0, 0]), ("pitch_rad", [0, 1, 0])])
def test_gravity_seen_from_a_leaning_rig_leans_the_other_way(name, axis):
    real = redrawn("gravity_tilt", ["world"], **{name: 0.1})
    expected = Rotation.from_rotvec(-0.1 * np.array(axis)).apply([0, -9.81, 0])
    np.testing.assert_allclose(real.forces[0].effect.gravity_m_per_s2[0], expected, atol=1e-12)


def test_errors_of_one_kind_add_up_on_one_part_and_stay_off_the_others():
    drawn = system(build(double_pendulum()))
    errors = [
        effect("a", "mass_error", ["lower"], relative=0.1),
        effect("b", "mass_error", ["lower"], relative=0.2),
        effect("c", "mass_error", ["upper"], relative=-0.5),
    ]
    ratio = np.asarray(system(build(double_pendulum(errors))).mass / drawn.mass)
    slots = build(double_pendulum()).topology.body_ids
    np.testing.assert_allclose([ratio[slots.index(b)] for b in ("upper", "lower")], [0.5, 1.32], rtol=1e-12)


def test_each_marker_is_moved_by_its_own_errors_and_no_other():
    given = document(double_pendulum())
    given["markers"] = [{**given["markers"][0], "id": name} for name in ("near", "tip", "far")]
    shifts = [("near", 0.01, 0.0), ("near", 0.02, 0.0), ("far", 0.0, -0.04)]
    given["effects"] = [
        effect(f"m{i}", "marker_offset", [on], dx_m=x, dy_m=y).model_dump(mode="json")
        for i, (on, x, y) in enumerate(shifts)
    ]
    made, drawn = build(parse_mechanism(given)), system(build(double_pendulum()))
    moved = np.asarray(system(made).markers - drawn.markers)[[made.marker_ids.index(n) for n in ("near", "tip", "far")]]
    np.testing.assert_allclose(moved, [[0.03, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, -0.04, 0.0]], atol=1e-15)
