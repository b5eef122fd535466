import cv2
import numpy as np
import pytest

from backend.observe.account import warn_blank
from backend.observe.bed import Bed, BedMark
from backend.observe.follow_bed import BedWatch, settle
from backend.observe.rows import Rows

RNG = np.random.default_rng(2)
PLACES = np.array([[60.0, 60.0], [260.0, 60.0], [260.0, 180.0], [60.0, 180.0], [160.0, 120.0]])
PAPER = cv2.GaussianBlur(RNG.normal(128, 60, (240, 320)).astype(np.float32), (0, 0), 3) * 3 - 256


def picture(shift=(0.0, 0.0), gain=1.0, covered=False):
    """A print moved by a part of a pixel, in another light; a card over the first mark."""
    H = np.array([[1, 0, shift[0]], [0, 1, shift[1]]], np.float32)
    seen = gain * cv2.warpAffine(PAPER, H, (320, 240), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    if covered:
        seen[:100, :100] = 90
    return np.clip(seen + RNG.normal(0, 1, seen.shape), 0, 255).astype(np.uint8)


def bed():
    marks = (
        BedMark(id=str(k), x_m=1e-3 * u, y_m=-1e-3 * v, x_px=u, y_px=v) for k, (u, v) in enumerate(PLACES.tolist())
    )
    return Bed(marks=tuple(marks))


def watched(pictures):
    watch = BedWatch(PLACES, pictures[0], len(pictures))
    for luma in pictures:
        watch.look(luma)
    return watch.result()


def test_marks_are_followed_to_a_fifteenth_of_a_pixel_in_changing_light():
    shifts = [(0.0, 0.0), (0.7, -0.4), (1.9, 0.3), (2.4, 1.2)]
    moved = watched([picture(s, 1 - 0.08 * k) for k, s in enumerate(shifts)])
    assert np.abs(moved - np.array(shifts)[:, None]).max() < 0.07  # OpenCV warps to 1/32 px


def test_a_covered_mark_is_left_out_and_found_again():
    moved = watched([picture(), picture(covered=True), picture((0.5, 0.0))])
    assert np.isnan(moved[1, 0]).all()
    assert np.isfinite(moved[1, 1:]).all()
    assert np.abs(moved[2, 0] - [0.5, 0.0]).max() < 0.07


def test_a_still_camera_has_one_view_and_a_shaken_one_a_view_for_every_picture():
    t = np.arange(4) / 240
    still = watched([picture() for _ in t])
    assert settle(bed(), still, t, Rows((320, 240)))[1] is None
    shifts = np.array([(0.0, 0.0), (0.7, -0.4), (1.9, 0.3), (2.4, 1.2)])
    _, shaken = settle(bed(), watched([picture(s) for s in shifts]), t, Rows((320, 240)))
    assert shaken is not None
    at = shaken.metres(PLACES[4] + shifts, np.zeros(4), np.arange(4), t)
    np.testing.assert_allclose(at, np.tile([0.16, -0.12], (4, 1)), atol=7e-5)  # 0.07 px of 1 mm


@pytest.mark.parametrize("wrong", ["three on a line", "two swapped"])
def test_marks_that_fix_no_view_leave_a_shaken_camera_where_it_was(wrong):
    """A corner is covered, and of the four marks that are left three lie on a diagonal; or one is taken for another."""
    shifts = np.array([(0.0, 0.0), (0.7, -0.4), (1.9, 0.3), (2.4, 1.2)])
    moved = np.tile(shifts[:, None], (1, 5, 1)) + RNG.normal(0, 0.05, (4, 5, 2))
    if wrong == "three on a line":
        moved[2, 3] = np.nan
    else:
        moved[2, 0], moved[2, 1], moved[2, 4] = (200, 0), (-200, 0), np.nan
    _, shaken = settle(bed(), moved, t := np.arange(4) / 240, Rows((320, 240)))
    assert shaken is not None
    at = shaken.metres(PLACES[3] + shifts, np.zeros(4), np.arange(4), t)
    off = np.hypot(*(at - [0.06, -0.18]).T)
    assert off[[0, 1, 3]].max() < 5e-4
    assert off[2] < 2e-3  # by as much as the camera moved since the picture before


def test_marks_that_show_nothing_do_not_make_a_camera_seem_to_move():
    """Points read off a bare wall, and corners of the picture: what passes them is no bed."""
    wall = np.clip(RNG.normal(120, 3, (6, 240, 320)), 0, 255).astype(np.uint8)
    for k, luma in enumerate(wall):
        cv2.circle(luma, (40 + 40 * k, 60), 20, 30, -1)
    at = np.array([[0.0, 0.0], [319.0, 0.0], [319.0, 239.0], [0.0, 239.0], [160.0, 60.0], [280.0, 200.0]])
    watch = BedWatch(at, wall[0], len(wall))
    for luma in wall:
        watch.look(luma)
    assert not watch.followable.any()
    assert np.isnan(watch.result()).all()
    assert "a camera that moves is not noticed" in warn_blank(watch.followable)[0]
