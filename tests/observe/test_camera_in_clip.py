"""The pose of a calibrated camera in a clip, and what is left unknown of it."""

import numpy as np
import pytest

from backend.observe.bed import read_bed
from backend.observe.beforehand import before_of
from backend.observe.camera import Camera, Deviations
from backend.observe.camera_in_clip import camera_in_clip
from backend.observe.placing import placing_slopes
from backend.observe.shared_error import error_of_camera
from backend.observe.viewpoint import Viewpoint

from .filmed_fourbar import MARKERS, SIZE, TAGS, Eye, fourbar, raised

LENS_SD = np.array([2.0, 2.0, 1.5, 1.5, 3e-3, 5e-3, 1e-4, 1e-4, 0.0])
TILT = np.deg2rad([4.0, 4.0, 2.0])


def calibrated(eye, rng):
    """The lens as a board leaves it: the truth and an error of the size that its covariance states."""
    covariance = np.diag(LENS_SD**2)
    covariance[0, 1] = covariance[1, 0] = 0.99 * LENS_SD[0] ** 2
    true = np.array([eye.focal_px, eye.focal_px, *eye.centre_px, eye.k1, eye.k2, 0, 0, 0])
    v, s, names = rng.multivariate_normal(true, covariance), LENS_SD, ("k1", "k2", "p1", "p2", "k3")
    sd = Deviations(focal_px=(s[0], s[1]), centre_px=(s[2], s[3]), **dict(zip(names, s[4:].tolist(), strict=True)))
    return Camera(
        image_size_px=SIZE, focal_px=(v[0], v[1]), centre_px=(v[2], v[3]), sd=sd, views=20, coverage=0.9,
        **dict(zip(names, v[4:].tolist(), strict=True)), covariance=tuple(map(tuple, covariance.tolist())),
        reprojection_rms_px=0.06,
    )  # fmt: skip


def bed_of(eye, rng, heights_m):
    seen = eye.pixels(np.c_[TAGS, np.zeros(len(TAGS))]) + 0.04 * rng.standard_normal((len(TAGS), 2))
    marks = [
        {"id": f"tag {k}", "x_m": x, "y_m": y, "x_px": u, "y_px": v}
        for k, ((x, y), (u, v)) in enumerate(zip(TAGS, seen.tolist(), strict=True))
    ]
    return read_bed(
        {
            "marks": marks, "mark_sd_m": 0.0, "marker_height_sd_m": 3e-4,
            "marker_height_m": dict(zip(MARKERS, heights_m.tolist(), strict=True)),
        }
    )  # fmt: skip


def clip(seed):
    """The truth, and the camera as found, of one draw of lens, pose, heights and noise."""
    rng = np.random.default_rng(seed)
    eye = Eye(1000.0, k1=-0.08, k2=0.03, height_m=0.62, tilt_rad=tuple(TILT * rng.standard_normal(3)))
    heights = 0.012 + 0.003 * rng.standard_normal(5)
    bed = bed_of(eye, rng, heights + 3e-4 * rng.standard_normal(5))
    xy = fourbar(np.linspace(0, 6, 20))
    px = eye.pixels(raised(xy, heights))
    return eye, bed, xy, px, camera_in_clip(calibrated(eye, rng), bed, MARKERS, px, SIZE)


def test_the_covariance_of_lens_pose_and_heights_together_is_honest():
    nees = []
    for seed in range(24):
        _, _, xy, px, camera = clip(seed)
        view, pose = Viewpoint.of(camera, camera.pose), camera.pose
        height = np.tile(list(pose.marker_height_m.values()), len(xy))
        at = view.on_plane(px.reshape(-1, 2), pose.plane, height)
        J = placing_slopes(view, pose.plane, at, height, np.tile(np.arange(5), len(xy)), 5)
        error, C = at - xy.reshape(-1, 2), J @ np.array(pose.covariance) @ np.swapaxes(J, 1, 2)
        nees.append(np.mean(np.einsum("ni,nij,nj->n", error, np.linalg.inv(C), error)) / 2)
    assert 0.65 < np.mean(nees) < 1.45  # some six independent errors a clip: the mean of 24 scatters by 0.12


def test_a_camera_that_has_not_moved_keeps_its_pose_and_one_that_has_is_found_again():
    eye, bed, _, px, camera = clip(0)
    assert camera_in_clip(camera, bed, MARKERS, px, SIZE) is camera
    moved = Eye(eye.focal_px, k1=eye.k1, k2=eye.k2, height_m=0.66, tilt_rad=(0.02, 0.0, 0.0))
    heights = np.array(list(camera.pose.marker_height_m.values()))
    again = camera_in_clip(camera, bed_of(moved, np.random.default_rng(1), heights), MARKERS, px, SIZE)
    sd = np.sqrt(np.diag(again.pose.covariance))[12:15]
    assert np.all(np.abs(np.array(again.pose.position_m) - moved.position_m) < 4 * sd)
    assert sd.max() < 5e-3  # m


def test_heights_that_were_only_guessed_are_not_known_the_next_time():
    eye, bed, _, px, _ = clip(0)
    board = calibrated(eye, np.random.default_rng(1))
    for given, known in ((None, None), ({"knee": 0.02}, ["knee"]), (0.012, list(MARKERS))):
        found = camera_in_clip(board, bed.model_copy(update={"marker_height_m": given}), MARKERS, px, SIZE)
        again = read_bed(bed.model_copy(update={"marker_height_m": None, "camera": found})).marker_height_m
        assert (again and list(again)) == known
        root = before_of(found, MARKERS, bed.model_copy(update={"marker_height_m": again})).root[9:]
        np.testing.assert_allclose(root @ root.T, np.array(found.pose.covariance)[15:, 15:], atol=1e-12)


def test_a_lens_calibrated_at_another_setting_is_told():
    eye, bed, _, px, _ = clip(0)
    other = calibrated(Eye(eye.focal_px, k1=eye.k1 + 0.1, k2=eye.k2), np.random.default_rng(2))
    assert any("another setting" in note for note in camera_in_clip(other, bed, MARKERS, px, SIZE).notes)


def test_tolerances_say_how_far_scale_and_turn_may_be_off():
    _, _, _, px, camera = clip(0)
    sd_m, tolerances = error_of_camera(camera, MARKERS, px, 1 / 60)
    told = {t["kind"]: t["sd"] for t in tolerances}
    assert 2e-5 < sd_m < 3e-4
    scales, turns = [], []
    for seed in range(24):
        _, _, xy, px, found = clip(seed)
        view, pose = Viewpoint.of(found, found.pose), found.pose
        height = np.tile(list(pose.marker_height_m.values()), len(xy))
        z = (view.on_plane(px.reshape(-1, 2), pose.plane, height) @ [1, 1j]).ravel()
        w = xy.reshape(-1, 2) @ [1, 1j]
        a = np.vdot(w - w.mean(), z - z.mean()) / np.vdot(w - w.mean(), w - w.mean())
        scales.append(a.real - 1)
        turns.append(a.imag)
    # 24 draws tell a deviation to 15%; cameras tilted otherwise differ.
    assert told["camera_scale"] == pytest.approx(np.std(scales), rel=0.6)
    assert told["camera_rotation"] == pytest.approx(np.std(turns), rel=0.6)
    assert told["time_offset"] == pytest.approx(1 / 60 / np.sqrt(12))
