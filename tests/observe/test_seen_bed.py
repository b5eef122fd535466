"""A bed marked with the kit's tags, seen through a calibrated camera, needs no pixels given by hand."""

import json
from functools import partial

import av
import cv2
import numpy as np
import pytest

from backend.observe.bed import read_bed
from backend.observe.camera import Camera, Deviations, read_camera, write_camera
from backend.observe.exchange.convert import convert
from backend.observe.lens import Lens, bend, straighten
from backend.observe.measure import track_video
from backend.observe.project import calibrate
from backend.observe.seen_bed import bed_in_picture
from backend.observe.tags import find_tags
from backend.observe.tracking_error import TrackingError
from backend.observe.without_board import calibrate_from_clip
from backend.observe.write import tracks_table, write_tracks

from .board_scenes import BENDS, SIZE, K, lean, photograph, tag_centres_mm
from .elsewhere import dlc_csv
from .filmed_fourbar import drawing as fourbar
from .scenes import drawing

CORNERS = ((0.0, 0.0), (0.3, 0.0), (0.3, 0.2), (0.0, 0.2))
MIDDLE = (105.0, 148.5)  # of an A4 page [mm]
AWAY = (lean(6, -8, 88), (0.0, 0.0, 420.0))  # the page of tags fills the picture


@pytest.fixture(scope="module")
def luma():
    return photograph(*AWAY, name="tags", about_mm=MIDDLE)


@pytest.fixture
def camera():
    k1, k2, p1, p2, k3 = BENDS.tolist()
    bends = {"k1": k1, "k2": k2, "p1": p1, "p2": p2, "k3": k3}
    return Camera(
        image_size_px=SIZE,
        focal_px=(K[0, 0], K[1, 1]),
        centre_px=(K[0, 2], K[1, 2]),
        **bends,
        sd=Deviations(focal_px=(0.4, 0.4), centre_px=(0.3, 0.3), **dict.fromkeys(bends, 0.001)),
        covariance=tuple(tuple(row) for row in np.eye(9).tolist()),
        reprojection_rms_px=0.05,
        views=18,
        coverage=0.7,
    )


@pytest.fixture
def bed_file(camera, tmp_path):
    """The tags where the page has them, y up from the page's foot, and the camera beside the bed file."""
    write_camera(camera, tmp_path / "lenses" / "camera.json")
    tags = [{"id": i, "x_m": x / 1e3, "y_m": (297 - y) / 1e3} for i, (x, y) in tag_centres_mm().items()]
    path = tmp_path / "bed.json"
    path.write_text(json.dumps({"tags": tags, "camera": "lenses/camera.json", "marker_height_m": 0}))
    return path


def true_px(page_mm):
    at = np.c_[np.asarray(page_mm, float) - MIDDLE, np.zeros(len(page_mm))]
    return cv2.projectPoints(at, cv2.Rodrigues(AWAY[0])[0], np.array(AWAY[1]), K, BENDS)[0].reshape(-1, 2)


def test_tag_centres_are_found_to_a_twentieth_of_a_pixel(luma):
    found, printed = {tag.number: laid for tag, laid in find_tags(luma).items()}, tag_centres_mm()
    assert sorted(found) == sorted(printed)
    off = np.array([found[i].centre_px for i in printed]) - true_px(list(printed.values()))
    assert np.hypot(*off.T).max() < 0.05  # px; 0.02 is usual, outlines alone are 0.2 off


def test_tags_and_a_saved_camera_place_points_within_a_fiftieth_of_a_millimetre(luma, bed_file):
    bed, warnings = bed_in_picture(read_bed(bed_file), luma)
    assert warnings == []
    view = calibrate(bed, *SIZE)
    page = np.array([(x, y) for x in (20, 105, 190) for y in (20, 148, 280)], float)
    placed = 1e3 * view.metres(true_px(page), np.zeros(len(page)))
    error = np.hypot(*(placed - np.c_[page[:, 0], 297 - page[:, 1]]).T)
    assert error.max() < 0.02  # mm, 0.05 px: what a tag is good for
    assert 1e3 * abs(view.position_m[2]) == pytest.approx(true_height_mm(), rel=2e-3)


def true_height_mm():
    R, middle = AWAY
    return abs(R[:, 2] @ np.array(middle))


def test_a_missing_tag_is_told_and_the_others_serve(luma, bed_file):
    listed = json.loads(bed_file.read_text())
    listed["tags"].append({"id": 77, "x_m": 0.5, "y_m": 0.5})
    bed_file.write_text(json.dumps(listed))
    bed, warnings = bed_in_picture(read_bed(bed_file), luma)
    assert len(bed.marks) == 9
    assert warnings == ["Bed tag 77 was not found in the first picture; the others are used."]


def test_too_few_tags_are_refused_by_number(luma):
    tags = [{"id": i, "x_m": 0.1 * (i % 2), "y_m": 0.1 * (i // 2 % 2)} for i in (0, 1, 50, 51)]
    with pytest.raises(TrackingError, match=r"^2 of the 4 bed tags are found .* \(missing: 50, 51\).* Tags 2, 3"):
        bed_in_picture(read_bed({"tags": tags}), luma)
    with pytest.raises(TrackingError, match=r"^3 bed marks are given \(tag 0, tag 1, tag 50\)"):
        read_bed({"tags": tags[:3]})


def test_a_tag_printed_twice_is_refused(luma):
    with pytest.raises(TrackingError, match="Bed tag 0, 1, 2, 3, 4, 5, 6, 7, 8 is seen twice"):
        find_tags(np.hstack([luma, luma]))


def test_a_mirrored_picture_is_refused_as_that(luma, bed_file):
    with pytest.raises(TrackingError, match="mirrored"):
        bed_in_picture(read_bed(bed_file), np.ascontiguousarray(luma[:, ::-1]))


def test_a_camera_of_another_resolution_is_scaled_with_a_warning(camera, bed_file):
    half = photograph(*AWAY, name="tags", about_mm=MIDDLE, size=(960, 540))
    bed, (warning,) = bed_in_picture(read_bed(bed_file), half)
    assert "scaled by 0.75" in warning
    assert "made from 1280 x 720 pictures, the clip has 960 x 540" in warning
    assert bed.lens is not None
    np.testing.assert_allclose(bed.lens.focal(), 0.75 * np.array(camera.focal_px))
    view = calibrate(bed, 960, 540)
    assert 1e3 * abs(view.position_m[2]) == pytest.approx(true_height_mm(), rel=3e-3)


@pytest.mark.parametrize(("size", "says"), [((720, 1280), "is turned"), ((1280, 960), "another shape")])
def test_a_camera_held_otherwise_or_of_another_shape_is_refused(camera, size, says):
    with pytest.raises(TrackingError, match=rf"{says}.*linktwin calibrate"):
        camera.lens_for(*size)


def test_the_camera_that_a_bed_file_names_is_not_written_over(bed_file):
    track = partial(track_video, "clip.mp4", fourbar(), bed_file)
    with pytest.raises(TrackingError, match=r"camera that the bed file names.*--out"):
        track(out_dir=bed_file.parent / "lenses" / ".." / "lenses")
    with pytest.raises(TrackingError, match="no file clip"):
        track(out_dir=bed_file.parent)
    with pytest.raises(TrackingError, match="bed file names"):
        calibrate_from_clip("clip.mp4", fourbar(), bed_file, out_dir=bed_file.parent / "lenses")
    (file := bed_file.parent / "tracks.trc").write_text("PathFileType\t4\n")
    with pytest.raises(TrackingError, match="bed file names"):
        convert(file, fourbar(), bed=bed_file, out_dir=bed_file.parent / "lenses")


def test_a_camera_file_that_is_missing_or_none_is_refused(tmp_path):
    bed = tmp_path / "bed.json"
    bed.write_text(json.dumps({"marks": [], "camera": "camera.json"}))
    with pytest.raises(TrackingError, match=r"camera\.json cannot be read"):
        read_bed(bed)
    (tmp_path / "camera.json").write_text('{"focal_px": 3}')
    with pytest.raises(TrackingError, match=r"camera\.json is no camera file \(focal_px.*linktwin calibrate"):
        read_bed(bed)
    with pytest.raises(TrackingError, match="both lens and camera"):
        read_bed({"lens": {"focal_px": 1000}, "camera": _plain(tmp_path)})


def _plain(folder):
    zeros = dict.fromkeys(("k1", "k2", "p1", "p2", "k3"), 0.0)
    sd = Deviations(focal_px=(0, 0), centre_px=(0, 0), **zeros)
    both = {"image_size_px": (4, 3), "focal_px": (5, 5), "centre_px": (1.5, 1), **zeros, "sd": sd}
    made = Camera(**both, covariance=((0.0,),), reprojection_rms_px=0, views=8, coverage=1)
    return str(write_camera(made, folder / "plain.json"))


def test_a_lens_bends_as_opencv_says_and_straightening_undoes_it():
    k1, k2, p1, p2, k3 = bends = (-0.28, 0.11, 0.002, -0.001, -0.02)  # a wide-angle lens
    lens = Lens(focal_px=(K[0, 0], K[1, 1]), k1=k1, k2=k2, p1=p1, p2=p2, k3=k3)
    xy = np.random.default_rng(0).uniform([-0.64, -0.36], [0.64, 0.36], (50, 2))
    seen = cv2.projectPoints(np.c_[xy, np.ones(50)], np.zeros(3), np.zeros(3), K, np.array(bends))[0].reshape(-1, 2)
    centre = np.array([K[0, 2], K[1, 2]])
    np.testing.assert_allclose(centre + lens.focal() * bend(xy, lens), seen, atol=1e-9)
    np.testing.assert_allclose(straighten(seen, lens, centre), xy, atol=1e-12)


DOTS_MM = {"a": (40.0, 255.0), "b": (80.0, 262.0), "c": (120.0, 252.0), "d": (165.0, 260.0)}
DOTS_M = {name: np.array([x / 1e3, (297 - y) / 1e3, 0.0]) for name, (x, y) in DOTS_MM.items()}


@pytest.fixture(scope="module")
def still(tmp_path_factory):
    """Four of the kit's dots on the blank foot of the page of tags, filmed still."""
    path = tmp_path_factory.mktemp("still") / "still.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=60, options={"crf": "16", "preset": "ultrafast"})
        stream.width, stream.height, stream.pix_fmt = *SIZE, "yuv420p"
        for k in range(4):
            picture = photograph(*AWAY, name="tags", about_mm=MIDDLE, seed=k, dots_mm=tuple(DOTS_MM.values()))
            frame = av.VideoFrame.from_ndarray(picture, format="rgb24").reformat(format="yuv420p")
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def test_a_clip_needs_no_pixels_given_by_hand(still, bed_file, tmp_path):
    result = track_video(still, drawing(DOTS_M), bed_file, out_dir=tmp_path / "out", preview=False)
    placed = result.tracks[["x_m", "y_m"]].to_numpy().reshape(-1, 4, 2)
    error = 1e3 * np.hypot(*(placed - np.array(list(DOTS_M.values()))[:, :2]).transpose(2, 0, 1))
    assert error.max() < 0.1  # mm, 0.25 px: dots of 19 px are good to 0.05 px, nine tags to 0.1 px each
    assert result.summary["warnings"] == []


def test_tracks_made_elsewhere_are_placed_through_tags_and_a_saved_camera(still, bed_file, tmp_path):
    seen = dict(zip(DOTS_MM, true_px(list(DOTS_MM.values())), strict=True))
    theirs = dlc_csv(
        tmp_path / "pose.csv", {n: np.tile(p, (4, 1)) for n, p in seen.items()}, dict.fromkeys(seen, [1.0] * 4)
    )
    rows_s = 4e-3
    bed_file.write_text(json.dumps(json.loads(bed_file.read_text()) | {"readout_s": rows_s}))
    made = convert(theirs, drawing(DOTS_M), bed=bed_file, video=still, out_dir=tmp_path / "out")
    placed = made.tracks[["x_m", "y_m"]].to_numpy().reshape(-1, 4, 2)
    error = 1e3 * np.hypot(*(placed - np.array(list(DOTS_M.values()))[:, :2]).transpose(2, 0, 1))
    assert error.max() < 0.1  # mm; as the tracker's own
    assert made.summary["warnings"] == []
    assert 0 < made.summary["calibration_sd_m"] < 1e-3  # of a camera whose covariance is only a stand-in
    assert read_camera(made.files[1]).pose is not None  # which a fit in pixels names
    late = made.tracks.time_s.to_numpy()[:4]
    np.testing.assert_allclose(late, rows_s * made.tracks.y_px.to_numpy()[:4] / (SIZE[1] - 1), atol=1e-9)
    with pytest.raises(TrackingError, match=r"tags and camera need a picture.*--video CLIP"):
        convert(theirs, drawing(DOTS_M), bed=bed_file, frames_per_s=60, out_dir=tmp_path)


def test_tracks_whose_points_have_their_own_times_go_out_frame_by_frame(still, tmp_path):
    times_s, names, speed = np.arange(6) / 60, list(DOTS_M), 1.0
    late_s = 1e-3 * np.arange(4)
    own_s = times_s[:, None] + late_s
    at = np.stack(list(DOTS_M.values())) + speed * own_s[..., None] * [1, 0, np.nan]
    px = np.broadcast_to(true_px(list(DOTS_MM.values())), (6, 4, 2))
    none = np.full((6, 4), np.nan)
    table = tracks_table(names, own_s, np.arange(6), at, none, px, np.full((6, 4, 2, 2), np.nan), none.astype(object))
    table["status"] = "observed"
    ours = write_tracks(table, tmp_path / "tracks.csv")
    dlc, _ = convert(ours, drawing(DOTS_M), to="deeplabcut", out_dir=tmp_path).files
    assert len(dlc.read_text().splitlines()) == 3 + 6
    (trc,) = convert(ours, drawing(DOTS_M), to="trc", out_dir=tmp_path).files
    back = convert(trc, drawing(DOTS_M), out_dir=tmp_path / "back").tracks
    assert len(back) == 6 * 4
    middle = back[(back.frame > 0) & (back.frame < 5)]  # at the ends nothing tells how fast a point is
    there = middle.x_m - speed * middle.time_s
    np.testing.assert_allclose(there, np.tile([p[0] for p in DOTS_M.values()], 4), atol=1e-8)


def test_a_tags_family_may_be_written_in_capitals():
    bed = read_bed(
        {"tags": [{"id": k, "x_m": x, "y_m": y, "family": "ARUCO_4X4_50"} for k, (x, y) in enumerate(CORNERS)]}
    )
    assert [str(tag.tag) for tag in bed.tags] == [f"aruco_4x4_50:{k}" for k in range(4)]
