import numpy as np
import pytest

from backend.observe.label import drawn_positions, label_dots, rotation
from backend.observe.tracking_error import TrackingError

from .scenes import drawing

RNG = np.random.default_rng(7)
EXPECTED = {"a": (100, 100), "b": (300, 120), "c": (320, 300), "d": (120, 260), "e": (210, 180)}
PLACES = np.array(list(EXPECTED.values()), float)


def named(dots, **given):
    return label_dots({n: np.array(p, float) for n, p in EXPECTED.items()}, dots, 20, **given)


def turned(degrees, shift=(0, 0), scale=1.0, mirror=False):
    c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    p = PLACES * ([1, -1] if mirror else [1, 1])
    return scale * (p - p.mean(0)) @ np.array([[c, s], [-s, c]]) + PLACES.mean(0) + shift


def test_dots_near_their_drawn_places_get_their_names_in_any_order():
    order = RNG.permutation(5)
    dots = (PLACES + RNG.normal(0, 10, (5, 2)))[order]
    assert [order[k] for k in named(dots).values()] == [0, 1, 2, 3, 4]


@pytest.mark.parametrize("place", [turned(25, (60, -30)), turned(-70, scale=0.7), turned(5, (150, 40), 1.4)])
def test_a_rig_that_was_moved_turned_and_scaled_is_still_named(place):
    order = RNG.permutation(5)
    assert [order[k] for k in named((place + RNG.normal(0, 1, (5, 2)))[order]).values()] == [0, 1, 2, 3, 4]


def test_extra_dots_far_from_the_drawing_do_not_confuse():
    dots = np.r_[PLACES, [[600, 600], [20, 500]]]
    assert list(named(dots).values()) == [0, 1, 2, 3, 4]


def test_a_symmetric_drawing_turned_away_is_doubtful():
    square = {n: np.array(p, float) for n, p in zip("abcd", [(0, 0), (100, 0), (100, 100), (0, 100)], strict=True)}
    dots = (np.array(list(square.values())) - 50) @ np.array([[1, 1], [-1, 1]]) / np.sqrt(2) + 50
    with pytest.raises(TrackingError, match="4 markers are drawn and 4 dots are seen, but it is doubtful which"):
        label_dots(square, dots, 20)


def test_two_dots_equally_near_are_doubtful_by_name():
    dots = PLACES.copy()
    dots[0] += [30, 0]
    dots = np.r_[dots, [PLACES[0] - [30, 0]]]
    with pytest.raises(TrackingError, match=r"doubtful which dots are a\. "):
        named(dots)


def test_a_click_settles_a_doubt():
    dots = np.r_[PLACES + np.outer([1, 0, 0, 0, 0], [30, 0]), [PLACES[0] - [30, 0]]]
    assert named(dots, clicks={"a": (72, 101)})["a"] == 5


def test_too_few_dots_are_refused_with_the_name_of_the_lonely_marker():
    with pytest.raises(TrackingError, match=r"5 markers are drawn but 4 dots.*without a dot: d\."):
        named(np.delete(PLACES, 3, 0))


def test_where_no_dot_is_seen_a_later_start_is_asked_for_clicked_or_not():
    with pytest.raises(TrackingError, match=r"no target lies clear of the edge.*--from"):
        named(np.zeros((0, 2)), clicks={"a": (100, 100)})


@pytest.mark.parametrize(
    ("clicks", "says"),
    [
        ({"z": (1, 2)}, "unknown markers z; the drawing has a, b"),
        ({"a": (150, 150)}, "click for a .* px from the nearest dot"),
        ({"a": (101, 100), "b": (99, 100)}, "a and b|b and a"),
    ],
)
def test_clicks_that_miss_are_refused(clicks, says):
    with pytest.raises(TrackingError, match=says):
        named(PLACES, clicks=clicks)


def test_a_mirrored_picture_is_not_taken_for_the_drawing():
    with pytest.raises(TrackingError, match="doubtful"):
        named(turned(0, mirror=True, shift=(0, 250)))


def test_markers_stand_where_their_bodies_are_drawn():
    points = {"p": np.array([0.3, 0.1, 0.05]), "q": np.array([-0.2, 0.0, 0.01])}
    for name, p_W in drawn_positions(drawing(points)).items():
        np.testing.assert_allclose(p_W, points[name], atol=1e-15)


def test_rotation_agrees_with_the_drawings_own():
    pose = drawing({"p": np.zeros(3)}).bodies[0].pose
    np.testing.assert_allclose(rotation(pose.quaternion_wxyz), pose.rotation(), atol=1e-15)
