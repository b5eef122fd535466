import json
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from backend.blind.camera import Camera, Sticker
from backend.cli import app
from backend.mechanism.tracks import read_table
from backend.observe.measure import track_video
from backend.observe.preview import Preview
from backend.observe.tracking_error import TrackingError

from .scenes import SMALL, SMALL_BED, card, drawing, errors_m, film, four, swaps


@pytest.fixture(scope="module")
def measured(eight_dots, tmp_path_factory):
    return track_video(eight_dots.path, eight_dots.mechanism, eight_dots.bed, out_dir=tmp_path_factory.mktemp("out"))


def test_ringed_dots_in_the_beds_plane_are_placed_to_a_tenth_of_a_millimetre(eight_dots, measured):
    error = np.hypot(*errors_m(eight_dots, measured.tracks).transpose(2, 0, 1))
    assert np.median(error) <= 1e-4  # the promise; 0.05 px, 0.026 mm, is usual
    assert np.percentile(error, 95) <= 1.5e-4
    assert error.max() <= 5e-4  # a pixel: no point is far off


def test_no_dot_takes_anothers_name(eight_dots, measured):
    assert swaps(eight_dots, measured.tracks) == 0
    assert (measured.tracks.status == "observed").all()


def test_the_stated_sigma_is_the_error_that_is_made(eight_dots, measured):
    squared = (errors_m(eight_dots, measured.tracks) ** 2).sum(2).ravel() / 2
    nees = (squared / measured.tracks.sigma_m.to_numpy() ** 2).mean()
    assert 0.5 <= nees <= 2  # 1 is honest; 1280 points would settle it within 0.04 were they independent


def test_pixels_and_their_covariance_agree_with_the_truth(eight_dots, measured):
    tracks = measured.tracks
    truth = np.stack([eight_dots.truth["markers_px"][m] for m in eight_dots.markers_m], 1).reshape(-1, 2)
    error = tracks[["x_px", "y_px"]].to_numpy() - truth
    cov = tracks[["cov_xx_px2", "cov_xy_px2", "cov_xy_px2", "cov_yy_px2"]].to_numpy().reshape(-1, 2, 2)
    nees = np.einsum("ni,nij,nj->n", error, np.linalg.inv(cov), error).mean() / 2
    assert 0.5 <= nees <= 2


def test_the_tracks_file_is_what_a_study_reads(eight_dots, measured):
    read = read_table("tracks", measured.tracks_path, eight_dots.mechanism)
    assert len(read) == 160 * 8
    assert read.z_m.isna().all()  # one camera over a flat bed does not measure height
    np.testing.assert_allclose(read.x_m, measured.tracks.x_m, rtol=1e-9)  # ten digits are written


def test_the_summary_counts_what_was_seen(eight_dots, measured):
    summary = json.loads(measured.summary_path.read_text())
    assert summary["frames"] == 160
    assert summary["markers"]["m3"]["status"] == {"observed": 160}
    assert summary["frames_per_s"] == pytest.approx(240, rel=1e-3)  # stamps are whole microseconds
    assert summary["metres_per_px"] == pytest.approx(5e-4, rel=1e-4)
    assert [said[:19] for said in summary["warnings"]] == ["The lens is unknown"]


def test_the_preview_is_a_clip_of_its_own(measured):
    import av

    with av.open(str(measured.preview_path)) as clip:
        shown = sum(1 for _ in clip.decode(video=0))
    assert shown == 160 / 4  # one of four: 60 of the 240 pictures of a second


def test_who_watches_sees_the_dots_as_they_are_followed(eight_dots, tmp_path):
    import cv2

    seen = []

    def watch(done, total):
        if (picture := cv2.imread(str(tmp_path / "watching.jpg"))) is not None:
            seen.append(picture)

    track_video(eight_dots.path, eight_dots.mechanism, eight_dots.bed, out_dir=tmp_path, progress=watch)
    green = (seen[-1][..., 1] > 150) & (seen[-1][..., 2] < 140) & (seen[-1][..., 0] < 140)
    assert green.sum() > 8 * 20  # a ring about each of eight dots
    assert not (tmp_path / "watching.jpg").exists()  # the clip is whole now


def test_a_run_that_is_broken_off_leaves_an_earlier_preview_whole(four_dots, tmp_path):
    (tmp_path / "preview.mp4").write_bytes(b"an earlier one")

    def stop(done, total):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        track_video(four_dots.path, four_dots.mechanism, four_dots.bed, out_dir=tmp_path, progress=stop)
    assert [path.name for path in tmp_path.iterdir()] == ["preview.mp4"]
    assert (tmp_path / "preview.mp4").read_bytes() == b"an earlier one"


def test_what_goes_wrong_before_the_first_picture_is_told_itself(tmp_path):
    with pytest.raises(TrackingError, match="the clip is dark"), Preview(tmp_path / "preview.mp4", 30.0, (64, 48)):
        raise TrackingError("the clip is dark")
    assert list(tmp_path.iterdir()) == []


def test_a_camera_file_of_another_run_is_told_apart(four_dots, tmp_path):
    (tmp_path / "camera.json").write_text("{}")
    made = track_video(four_dots.path, four_dots.mechanism, four_dots.bed, out_dir=tmp_path, preview=False)
    assert "camera.json was there before and is not of these tracks" in made.summary["warnings"][-1]
    assert (tmp_path / "camera.json").read_text() == "{}"


def test_a_hidden_dot_is_occluded_and_then_known_again(tmp_path):
    # "swing" moves to the right past x = 15 mm early on; the card lies there for 20 frames and then is gone.
    times = np.arange(80) / 240
    hidden = slice(15, 35)
    cover = card(0.033, -0.02, 0.028, times[15] - 1e-3, times[35] - 1e-3)
    clip = film(tmp_path / "hidden.mp4", times, four, occluders=[cover])
    tracks = track_video(clip.path, clip.mechanism, clip.bed, out_dir=tmp_path, preview=False).tracks
    status = tracks[tracks.marker == "swing"].status.to_numpy()
    assert (status[hidden] == "occluded").all()
    assert (status[:15] == "observed").all()
    assert (status[35:] == "observed").all()
    assert tracks[tracks.status == "occluded"][["x_m", "y_m", "sigma_m", "x_px"]].isna().all(axis=None)
    assert swaps(clip, tracks) == 0
    assert (tracks[tracks.marker != "swing"].status == "observed").all()


def test_on_request_a_gap_is_filled_with_predictions_that_admit_their_error(tmp_path):
    times = np.arange(60) / 240
    cover = card(0.033, -0.02, 0.028, times[15] - 1e-3, times[23] - 1e-3)
    clip = film(tmp_path / "hidden.mp4", times, four, occluders=[cover])
    tracks = track_video(clip.path, clip.mechanism, clip.bed, out_dir=tmp_path, preview=False, coast_s=0.1).tracks
    filled = tracks.status.to_numpy() == "predicted"
    assert filled.sum() == 8
    error = np.hypot(*errors_m(clip, tracks).transpose(2, 0, 1)).ravel()
    assert (error[filled] < 3 * np.sqrt(2) * tracks.sigma_m.to_numpy()[filled]).all()


def test_the_command_line_fills_gaps_when_asked(tmp_path):
    times = np.arange(40) / 240
    cover = card(0.033, -0.02, 0.028, times[15] - 1e-3, times[23] - 1e-3)
    clip = film(tmp_path / "hidden.mp4", times, four, occluders=[cover])
    (tmp_path / "m.json").write_text(clip.mechanism.model_dump_json())
    (tmp_path / "bed.json").write_text(json.dumps(clip.bed))
    given = ["track", clip.path, "--mechanism", tmp_path / "m.json", "--bed", tmp_path / "bed.json", "--out", tmp_path]
    for asked, status in (([], "occluded"), (["--coast", "0.1"], "predicted")):
        done = CliRunner().invoke(app, [*map(str, given), "--json", *asked])
        assert done.exit_code == 0, done.stderr
        assert json.loads(done.stdout)["markers"]["swing"]["status"] == {"observed": 32, status: 8}


def test_a_half_covered_dot_is_an_outlier_with_a_sigma_as_large_as_its_error(tmp_path):
    times = np.arange(40) / 240
    # The card is 50 mm up, seen 1/15 farther out: its left edge at 94.2 mm looks to be at 100.5, right of the middle.
    cover = card(0.0942 + 0.0195, 0.04, 0.0195, times[10] - 1e-3, times[30] - 1e-3)
    clip = film(tmp_path / "half.mp4", times, four, occluders=[cover])
    tracks = track_video(clip.path, clip.mechanism, clip.bed, out_dir=tmp_path, preview=False).tracks
    post = tracks[tracks.marker == "post"]
    assert set(post.status[10:30]) <= {"outlier", "occluded"}
    assert (post.status[:10] == "observed").all()
    error = np.hypot(*errors_m(clip, tracks)[:, 1].T)[10:30]
    seen = np.isfinite(error)
    assert (error[seen] < 3 * post.sigma_m.to_numpy()[10:30][seen]).all()


def test_a_dot_of_another_colour_is_left_alone(tmp_path):
    stickers = (Sticker(-0.12, 0.05), Sticker(0.03, 0.05, (0.03, 0.08, 0.5)), Sticker(0.03, -0.06))
    clip = film(tmp_path / "stickers.mp4", np.arange(40) / 240, four, bed=replace(SMALL_BED, stickers=stickers))
    result = track_video(clip.path, clip.mechanism, clip.bed, out_dir=tmp_path, preview=False)
    assert result.summary["dots_not_drawn"] == 0
    assert np.nanmax(np.abs(errors_m(clip, result.tracks))) < 5e-4
    assert (result.tracks.status == "observed").all()


def test_one_dot_too_many_of_the_same_colour_is_followed_apart(tmp_path):
    red = Sticker(-0.03, 0.05, (0.60, 0.03, 0.03))
    clip = film(tmp_path / "extra.mp4", np.arange(40) / 240, four, bed=replace(SMALL_BED, stickers=(red,)))
    result = track_video(clip.path, clip.mechanism, clip.bed, out_dir=tmp_path, preview=False)
    assert result.summary["dots_not_drawn"] == 1
    assert "1 more dots are seen" in result.summary["warnings"][0]
    assert swaps(clip, result.tracks) == 0


def test_an_upright_rig_is_measured_in_its_own_plane(tmp_path):
    def upright(t):
        return {name: p[:, [0, 2, 1]] + [0, 0.3, 0] for name, p in four(t).items()}

    bed = replace(SMALL_BED, origin_m=(0.0, 0.3, 0.0), y_axis=(0.0, 0.0, 1.0))
    clip = film(tmp_path / "upright.mp4", np.arange(30) / 240, upright, bed=bed)
    tracks = track_video(clip.path, clip.mechanism, clip.bed, out_dir=tmp_path, preview=False).tracks
    truth = np.stack([p for p in clip.markers_m.values()], 1).reshape(-1, 3)
    assert tracks.y_m.isna().all()
    assert np.abs(tracks[["x_m", "z_m"]].to_numpy() - truth[:, [0, 2]]).max() < 5e-4


def test_dots_above_the_bed_are_placed_too_far_out_until_the_lens_and_height_are_known(tmp_path):
    camera = Camera(width_px=640, height_px=360, tilt_deg=(1.6, -1.1, 0.7), k1=-0.03)

    def raised(t):
        return four(t, height=0.012)

    clip = film(tmp_path / "raised.mp4", np.arange(20) / 240, raised, camera=camera)
    unknown = {k: v for k, v in clip.bed.items() if k != "marker_height_m"}
    naive = track_video(clip.path, clip.mechanism, unknown, out_dir=tmp_path, preview=False)
    error = np.hypot(*errors_m(clip, naive.tracks).transpose(2, 0, 1))
    # 12 mm at 0.8 m and 1.9 degrees of tilt: r x 12 / 800 is up to 1.6 mm, tilt adds 12 mm x 0.034 = 0.4 mm.
    assert 5e-4 < np.median(error) < 2.2e-3
    assert "unknown" in naive.summary["warnings"][0]
    assert " mm too far out" in naive.summary["warnings"][0]
    known = {**clip.bed, "marker_height_m": 0.012, "lens": {"focal_px": 1600, "k1": -0.03}}
    exact = track_video(clip.path, clip.mechanism, known, out_dir=tmp_path, preview=False)
    assert np.median(np.hypot(*errors_m(clip, exact.tracks).transpose(2, 0, 1))) < 1e-4
    assert exact.summary["warnings"] == []


@pytest.mark.parametrize("mirror", [1, -1])
def test_heights_may_be_the_drawings_whichever_side_its_plane_is_seen_from(tmp_path, mirror):
    """Dots 6 to 18 mm up, marks 40 mm above the drawing's origin; z of the mirrored drawing points away."""
    camera = Camera(width_px=640, height_px=360, tilt_deg=(1.6, -1.1, 0.7))

    def stacked(t):
        return {n: p + np.array([0, 0, 0.006 + 0.004 * k]) for k, (n, p) in enumerate(four(t).items())}

    clip = film(tmp_path / "stacked.mp4", np.arange(12) / 240, stacked, camera=camera)
    across = np.array([1, mirror, mirror])
    mechanism = drawing({n: p[0] * across + [0, 0, 0.04] for n, p in clip.markers_m.items()})
    marks = [m | {"y_m": mirror * m["y_m"]} for m in clip.bed["marks"]]
    bed = {"marks": marks, "lens": {"focal_px": 1600}, "plane": {"origin_m": [0, 0, 0.04]}, "marker_height_m": "drawn"}
    result = track_video(clip.path, mechanism, bed, out_dir=tmp_path, preview=False)
    off = result.tracks[["x_m", "y_m"]].to_numpy().reshape(-1, 4, 2) * across[:2] - np.stack(
        [p[:, :2] for p in clip.markers_m.values()], 1
    )
    assert np.median(np.abs(off)) < 1e-4  # 6 mm of height, 0.1 m from the middle, are 0.75 mm
    assert result.summary["warnings"] == []


def test_a_drawing_without_heights_cannot_give_them(four_dots, tmp_path):
    bed = four_dots.bed | {"marker_height_m": "drawn"}
    with pytest.raises(TrackingError, match=r"no marker above the bed marks.* 0\.0 to 0\.0 mm.*plane\.origin_m"):
        track_video(four_dots.path, four_dots.mechanism, bed, out_dir=tmp_path)
    sunk = drawing({n: p[0] + [0, 0, 0.01 * (-1) ** k] for k, (n, p) in enumerate(four_dots.markers_m.items())})
    result = track_video(four_dots.path, sunk, bed, out_dir=tmp_path, preview=False)
    assert "below the bed marks" in result.summary["warnings"][0]
    assert "(-10.0 mm)" in result.summary["warnings"][0]


def test_a_known_camera_height_alone_removes_most_of_the_parallax(tmp_path):
    clip = film(tmp_path / "raised.mp4", np.arange(12) / 240, lambda t: four(t, height=0.012))
    bed = {**clip.bed, "marker_height_m": 0.012, "camera_height_m": 0.8}
    tracks = track_video(clip.path, clip.mechanism, bed, out_dir=tmp_path, preview=False).tracks
    assert np.median(np.abs(errors_m(clip, tracks))) < 1e-4


def test_the_drawing_may_sit_elsewhere_than_the_bed(four_dots, tmp_path):
    """The rig stands 25 mm and 20 degrees away from where the bed marks' origin would have it."""
    c, s = np.cos(np.deg2rad(20)), np.sin(np.deg2rad(20))
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    moved = drawing({n: turn @ p[0] + [0.025, 0.01, 0] for n, p in four_dots.markers_m.items()})
    tracks = track_video(four_dots.path, moved, four_dots.bed, out_dir=tmp_path, preview=False).tracks
    assert swaps(four_dots, tracks) == 0


def test_clicks_decide_where_the_drawing_cannot(four_dots, tmp_path):
    jumbled = drawing({n: (0.005 * k, 0.0, 0.0) for k, n in enumerate(four_dots.markers_m)})
    clicks = {n: four_dots.truth["markers_px"][n][0] for n in four_dots.markers_m}
    tracks = track_video(four_dots.path, jumbled, four_dots.bed, out_dir=tmp_path, clicks=clicks, preview=False).tracks
    assert swaps(four_dots, tracks) == 0


def test_progress_reaches_every_frame(four_dots, tmp_path):
    told = []
    track_video(
        four_dots.path, four_dots.mechanism, four_dots.bed, out_dir=tmp_path, preview=False,
        progress=lambda done, of: told.append((done, of)),
    )  # fmt: skip
    assert told == [(k, 60) for k in range(1, 61)]


def test_dots_that_never_were_are_refused(tmp_path):
    clip = film(tmp_path / "bare.mp4", np.arange(5) / 240, lambda t: {"far": np.c_[9 + 0 * t, 0 * t, 0 * t]})
    with pytest.raises(TrackingError, match="No marker found in the first picture"):
        track_video(clip.path, drawing({"far": (0, 0, 0)}), clip.bed, out_dir=tmp_path)


def test_too_few_dots_are_refused_by_count_and_name(four_dots, tmp_path):
    points = {n: p[0] for n, p in four_dots.markers_m.items()} | {"ghost": np.array([0.0, 0.07, 0.0])}
    with pytest.raises(TrackingError, match=r"5 markers are drawn but 4 dots are seen.*ghost"):
        track_video(four_dots.path, drawing(points), four_dots.bed, out_dir=tmp_path)


def test_a_drawing_without_markers_is_refused(four_dots, tmp_path):
    with pytest.raises(TrackingError, match="no markers"):
        track_video(four_dots.path, drawing({}), four_dots.bed, out_dir=tmp_path)


def test_bed_marks_outside_the_picture_are_refused(four_dots, tmp_path):
    marks = [dict(m, x_px=3 * m["x_px"]) for m in four_dots.bed["marks"]]
    with pytest.raises(TrackingError, match="outside the 640 x 360 picture"):
        track_video(four_dots.path, four_dots.mechanism, marks, out_dir=tmp_path)


def test_the_small_camera_sees_half_a_millimetre_per_pixel():
    px = SMALL.project(np.array([[0.0, 0, 0], [0.1, 0, 0]]))
    np.testing.assert_allclose(px[1] - px[0], [200, 0], atol=1e-9)  # rounding
