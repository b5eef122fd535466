"""Coordinates in one another's columns are told; a camera that leans, noise, and markers that may go there are not."""

import numpy as np
import pytest

from backend.mechanism.columns import column_findings, plane_axis
from tests.mechanism.swings import POINTS, filmed, pendulum, swapped
from tests.mechanisms import bennett, fourbar, sliding_mass

DEEP = {**POINTS, "above": (0.1, 0.0, 0.08)}


def findings(table, **drawn):
    return list(column_findings(table, pendulum(**drawn)))


@pytest.mark.parametrize(
    "table",
    [
        filmed(),
        filmed().assign(z_m=0.0),
        filmed(planar=False),
        filmed(planar=False, noise=5e-3),
        filmed(planar=False, lean=0.2),
        swapped(filmed().assign(z_m=0.0), "x_m", "y_m").assign(x_m=np.nan),
        filmed().query("marker == 'tip'"),
    ],
    ids=["a plane", "zeros across it", "in space", "much noise", "a rig that leans", "half of a plane", "one marker"],
)
def test_nothing_stands_out_where_columns_are_right(table):
    assert findings(table) == []


def test_two_columns_of_the_plane_that_are_swapped_are_seen_as_in_a_mirror():
    (said,) = findings(swapped(filmed(), "x_m", "y_m"))
    assert "tip, middle, tail are seen as in a mirror" in said
    assert "x_m and y_m are not in each other's place, and their signs" in said
    (said,) = findings(filmed().assign(y_m=lambda table: -table["y_m"]))
    assert "as in a mirror" in said


@pytest.mark.parametrize("planar", [True, False])
def test_a_motion_along_the_axes_of_all_joints_stands_out(planar):
    (said,) = findings(swapped(filmed(planar=planar), "y_m", "z_m"))
    assert "mm (rms) in z_m, along the axes of all joints" in said
    assert "check that z_m and y_m are not in each other's place" in said


def test_places_along_the_axes_stand_out_where_little_moves():
    still = filmed()
    still["x_m"], still["y_m"] = (still.groupby("marker")[x].transform("first") for x in ("x_m", "y_m"))
    still[["x_m", "y_m"]] += 1e-4 * np.random.default_rng(1).standard_normal((len(still), 2))
    assert findings(still) == []
    (said,) = findings(swapped(still, "y_m", "z_m"))
    assert "to both sides of where they are drawn in z_m" in said
    assert "y_m shows nothing" in said


def test_what_can_slide_along_its_axis_may_be_seen_there():
    assert findings(swapped(filmed(planar=False), "y_m", "z_m"), type="cylindrical") == []


def test_a_body_in_space_shows_by_four_markers_whether_it_is_mirrored():
    about_a_ball = {"points": DEEP, "type": "spherical"}
    right = filmed(DEEP, planar=False)
    assert findings(right, **about_a_ball) == []
    (said,) = findings(swapped(right, "y_m", "z_m"), **about_a_ball)
    assert "x_m, y_m and z_m are not in each other's place" in said


def test_only_axes_that_are_all_parallel_leave_a_coordinate_in_which_nothing_moves():
    assert plane_axis(fourbar()) == 2
    assert plane_axis(bennett()) is None
    assert plane_axis(sliding_mass()) is None
