from dataclasses import replace

import numpy as np
import pytest

from backend.blind.camera import Camera
from backend.blind.render import Look
from backend.observe.detect import Region, detect
from backend.observe.dots import learn_look, learn_patch
from backend.observe.tracking_error import TrackingError
from backend.observe.video import Frame, Video

from .scenes import film, four


def placed(clip, frame, look):
    """Distance from each true dot to the nearest detection [px]."""
    truth = np.array([p[frame.index] for p in clip.truth["markers_px"].values()])
    return np.hypot(*(truth[:, None] - detect(frame, look).px[None]).transpose(2, 0, 1)).min(1)


def test_the_size_of_the_dots_is_measured_in_the_picture(four_dots):
    look = learn_look(next(iter(Video(four_dots.path))), 4)
    assert look.radius_px == pytest.approx(8, abs=0.6)  # 4 mm at 0.5 mm per pixel, profile sampled at 0.25 px
    assert look.ring_px == pytest.approx(12, abs=1.0)


def test_dots_sought_in_a_region_are_those_that_the_whole_picture_shows_there(four_dots):
    frame = next(iter(Video(four_dots.path)))
    look = learn_look(frame, 4)
    whole = detect(frame, look).px
    for k in range(4):  # one by one, then all of them, then beyond the picture's edges
        alone = detect(frame, look, Region.around(whole[k : k + 1], np.array([25.0]))).px
        np.testing.assert_allclose(alone, whole[k : k + 1], atol=1e-9)
    for reach in (25.0, 1e4):
        np.testing.assert_allclose(detect(frame, look, Region.around(whole, np.full(4, reach))).px, whole, atol=1e-9)
    assert len(detect(frame, look, Region.around(np.array([[-500.0, 9000.0]]), np.array([10.0])))) == 0


@pytest.mark.parametrize("colour", [(0.6, 0.03, 0.03), (0.03, 0.3, 0.08), (0.03, 0.08, 0.5), (0.4, 0.02, 0.3)])
def test_dots_of_any_ink_are_found_to_a_tenth_of_a_pixel(tmp_path, colour):
    clip = film(tmp_path / "ink.mp4", np.arange(8) / 240, four, look=Look(dot_colour_rgb=colour))
    frames = list(Video(clip.path))
    look = learn_look(frames[0], 4)
    assert np.median([placed(clip, f, look) for f in frames]) < 0.1
    assert all(len(detect(f, look)) == 4 for f in frames)


@pytest.mark.parametrize(("noise", "crf", "limit"), [(0.0, 10, 0.03), (6.0, 26, 0.25)])
def test_a_clean_picture_is_placed_finer_than_a_coarse_one(tmp_path, noise, crf, limit):
    clip = film(tmp_path / "noise.mp4", np.arange(8) / 240, four, look=Look(noise_codes=noise, crf=crf))
    frames = list(Video(clip.path))
    look = learn_look(frames[0], 4)
    assert np.median([placed(clip, f, look) for f in frames]) < limit


def test_small_dots_are_found_too(tmp_path):
    clip = film(tmp_path / "far.mp4", np.arange(6) / 240, four, camera=Camera(1600, 1.6, 640, 360))
    frames = list(Video(clip.path))
    look = learn_look(frames[0], 4)  # 8 pixels across
    assert np.median([placed(clip, f, look) for f in frames]) < 0.12


def test_a_grey_picture_holds_no_dots(four_dots):
    frame = next(iter(Video(four_dots.path)))
    grey = replace(frame, cb=np.full_like(frame.cb, 128), cr=np.full_like(frame.cr, 128))
    with pytest.raises(TrackingError, match="0 coloured areas"):
        learn_look(grey, 4)


def test_a_coloured_patch_without_a_brighter_surrounding_is_no_dot(four_dots):
    frame = next(iter(Video(four_dots.path)))
    with pytest.raises(TrackingError, match="none a round dot"):
        learn_look(replace(frame, luma=np.full_like(frame.luma, 120)), 4)


def test_black_dots_are_found_where_that_is_said(tmp_path):
    clip = film(tmp_path / "black.mp4", np.arange(6) / 240, four, look=Look(dot_colour_rgb=(0.02, 0.02, 0.02)))
    frames = list(Video(clip.path))
    with pytest.raises(TrackingError, match='"dark"'):
        learn_look(frames[0], 4)
    look = learn_look(frames[0], 4, dark=True)
    assert np.median([placed(clip, f, look) for f in frames]) < 0.1
    assert all(len(detect(f, look)) < 12 for f in frames)  # marks on the bed are black too


def painted(four_dots, mask, cb=90, cr=110):
    """A wall with a coloured area on it."""
    frame = next(iter(Video(four_dots.path)))
    half = mask[::2, ::2]
    planes = {"cb": np.where(half, cb, 128), "cr": np.where(half, cr, 128), "luma": np.where(mask, 90, 170)}
    return replace(frame, **{k: v.astype(np.uint8) for k, v in planes.items()})


def test_a_glossy_ball_that_fills_a_fortieth_of_the_picture_is_found(four_dots):
    """Its highlights leave crumbs of its colour, which are not its size."""
    v, u = np.mgrid[:360, :640]
    ball = np.hypot(u - 300.5, v - 150.5) < 43
    for k in range(5):
        ball ^= np.hypot(u - 288 - 6 * k, v - 128) < 4
        ball |= np.hypot(u - 288 - 6 * k, v - 128) < 1.6
    frame = painted(four_dots, ball)
    look = learn_look(frame, 1)
    assert look.area_px == pytest.approx(np.pi * 43**2, rel=0.1)
    found = detect(frame, look)
    assert np.hypot(*(found.px[0] - [300.5, 150.5])) < 3  # the highlight lies on one side


def test_a_dot_as_wide_as_a_fifth_of_a_large_picture_is_found():
    """Its rays hold more points than one row of OpenCV's remap may."""
    v, u = np.mgrid[:900, :1280]
    disc, ring = (np.hypot(u - 640.5, v - 450.5) < r for r in (120, 180))
    luma = np.where(disc, 90, np.where(ring, 220, 150)).astype(np.uint8)
    cb, cr = (np.where(disc[::2, ::2], k, 128).astype(np.uint8) for k in (90, 180))
    frame = Frame(0, 0.0, luma, cb, cr, None, 0)
    look = learn_look(frame, 1)
    assert look.radius_px == pytest.approx(120, abs=1.0)
    assert np.hypot(*(detect(frame, look).px[0] - [640.5, 450.5])) < 0.5


def test_a_patch_of_any_shape_is_placed_by_the_centroid_of_its_colour(four_dots):
    shape = np.zeros((360, 640), bool)
    shape[100:140, 200:300], shape[300:306, 10:16] = True, True
    look = learn_patch(painted(four_dots, shape), np.array([[260.0, 120.0]]))
    moved = painted(four_dots, np.roll(shape, (20, 30), (0, 1)))
    found = detect(moved, look)
    assert len(found) == 1
    assert found.whole.all()
    np.testing.assert_allclose(found.px[0], [279.5, 139.5], atol=0.6)  # half the resolution of the colours
    shape[100:140, 240:300] = False
    assert not detect(painted(four_dots, shape), look).whole.any()
    with pytest.raises(TrackingError, match="on no colour"):
        learn_patch(painted(four_dots, shape), np.array([[500.0, 50.0]]))
    with pytest.raises(TrackingError, match="known by a click"):
        learn_patch(painted(four_dots, shape), np.zeros((0, 2)))


@pytest.mark.parametrize("other", [(90, 128), (90, 166)])
def test_patches_of_two_colours_are_refused_by_where_they_were_clicked(four_dots, other):
    left, right = np.zeros((2, 360, 640), bool)
    left[100:140, 100:140], right[100:140, 400:440] = True, True
    frame, second = painted(four_dots, left, 166, 90), painted(four_dots, right, *other)
    frame = replace(frame, cb=frame.cb + (second.cb - 128), cr=frame.cr + (second.cr - 128))
    with pytest.raises(TrackingError, match=r"at \(120, 120\), \(420, 120\).*patches of one colour"):
        learn_patch(frame, np.array([[120.0, 120.0], [420.0, 120.0]]))
