"""A lens is found again from pictures of the printed board, or the sentence says what to film."""

from dataclasses import replace
from fractions import Fraction

import av
import cv2
import numpy as np
import pytest

from backend.observe.board_views import choose_views, find_board
from backend.observe.calibrate_camera import MOST_VIEWS, calibrate_camera, camera_from
from backend.observe.camera import PARAMETERS, read_camera, write_camera
from backend.observe.tracking_error import TrackingError

from .board_scenes import BENDS, SIZE, K, board_poses, computed_views, lean, photograph

TRUTH = np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2], *BENDS])


@pytest.fixture(scope="module")
def photos():
    return [photograph(R, middle, seed=k) for k, (R, middle) in enumerate(board_poses(18))]


@pytest.fixture(scope="module")
def views(photos):
    return [find_board(photo, f"photo {k}") for k, photo in enumerate(photos)]


@pytest.fixture(scope="module")
def camera(views):
    return camera_from(views, SIZE)


def write_photos(folder, photos):
    paths = [folder / f"{k:02d}.png" for k in range(len(photos))]
    for path, photo in zip(paths, photos, strict=True):
        cv2.imwrite(str(path), photo)
    return paths


def test_the_focal_length_is_found_within_three_in_a_thousand(camera):
    np.testing.assert_allclose(camera.focal_px, TRUTH[:2], rtol=0.003)  # the promise; 0.0003 is usual


def test_every_value_lies_within_three_of_its_standard_deviations(camera):
    sd = np.sqrt(np.diag(camera.covariance))
    free = sd > 0
    assert free.sum() >= 8
    assert (np.abs(camera.values() - TRUTH)[free] < 3 * sd[free]).all()
    assert abs(camera.k1 - BENDS[0]) < 3 * camera.sd.k1
    assert camera.sd.k1 < 0.003  # and it says something: a tenth of this lens's bend would be 0.009


def test_the_covariance_holds_over_many_boards():
    z = []
    for seed in range(8):
        camera = camera_from(computed_views(seed), SIZE)
        z.append((camera.values() - TRUTH)[:8] / np.sqrt(np.diag(camera.covariance)[:8]))
    # 64 numbers, correlated in fours or so: their mean square scatters by a third.
    assert 0.4 < np.mean(np.square(z)) < 1.6


def test_a_bent_board_does_not_bend_the_lens():
    """Taken as flat, these views would give a focal length 1.6% too short at a misfit of 0.2 px."""
    camera = camera_from(computed_views(5, count=18, sag_mm=1.0), SIZE)
    np.testing.assert_allclose(camera.focal_px, TRUTH[:2], rtol=0.003)
    assert camera.reprojection_rms_px < 0.08  # the noise of both coordinates, 0.07
    assert any(note.startswith("The board is bent by 1.0 mm") for note in camera.notes)


def test_the_file_is_read_as_it_was_written(camera, tmp_path):
    again = read_camera(write_camera(camera, tmp_path / "deep" / "camera.json"))
    assert again == camera
    assert len(again.covariance) == len(PARAMETERS)


def test_what_it_means_at_the_bed_is_said_in_millimetres(camera):
    relative = max(camera.sd.focal_px) / np.mean(camera.focal_px)
    said = next(note for note in camera.notes if note.startswith("The focal length is known"))
    assert f"{800 * relative:.1g} mm" in said
    assert any("of the picture" in note for note in camera.notes)


def test_photos_and_a_clip_of_the_board_give_the_same_lens(photos, camera, tmp_path):
    sharp = calibrate_camera(write_photos(tmp_path, photos))
    assert (np.abs(sharp.values() - camera.values()) <= 0.1 * np.sqrt(np.diag(camera.covariance))).all()
    path = tmp_path / "board.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=30, options={"crf": "16", "preset": "ultrafast"})
        stream.width, stream.height, stream.pix_fmt = *SIZE, "yuv420p"
        stream.codec_context.time_base = Fraction(1, 30)
        for photo in photos:
            frame = av.VideoFrame.from_ndarray(photo, format="gray").reformat(format="yuv420p")
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    filmed = calibrate_camera([path])
    np.testing.assert_allclose(filmed.focal_px, TRUTH[:2], rtol=0.003)


def test_blurred_views_are_passed_over_and_alike_ones_count_once(photos, views):
    blurred = [find_board(cv2.GaussianBlur(photo, (0, 0), 1.8), f"blurred {k}") for k, photo in enumerate(photos[:6])]
    assert sum(v is not None for v in blurred) >= 3
    chosen = choose_views([v for v in [*blurred, *views, *views] if v], SIZE, MOST_VIEWS)
    assert not [v.source for v in chosen if v.source.startswith("blurred")]
    assert len(chosen) == len({v.source for v in chosen}) == len(views)
    few = choose_views(views, SIZE, 5)
    assert len(few) == 5
    centres = np.array([v.px.mean(0) for v in few])
    assert np.ptp(centres, axis=0)[0] > 0.4 * SIZE[0]  # they are taken from all over the picture


def test_a_view_that_misfits_is_left_out_and_named(views, camera):
    bent = replace(views[4], px=views[4].px + 3 * np.sin(views[4].px[:, ::-1] / 60))
    other = camera_from([*views[:4], bent, *views[5:]], SIZE)
    assert other.views == len(views) - 1
    assert any(note.startswith("photo 4 was left out") for note in other.notes)
    np.testing.assert_allclose(other.focal_px, TRUTH[:2], rtol=0.003)


def test_too_few_views_are_refused(photos, tmp_path):
    with pytest.raises(TrackingError, match=r"^5 different sharp views .* \(5 of 5 pictures show it\); 8 are needed"):
        calibrate_camera(write_photos(tmp_path, photos[:5]))


def test_a_board_that_stays_where_it_is_counts_as_one_view(photos, tmp_path):
    with pytest.raises(TrackingError, match=r"^1 different sharp views"):
        calibrate_camera(write_photos(tmp_path, photos[:1] * 9))


def test_boards_square_to_the_camera_are_refused_for_the_focal_length():
    rng = np.random.default_rng(0)
    flat = [
        find_board(photograph(lean(*rng.uniform(-3, 3, 2), 90), (x, y, 420), seed=k), f"flat {k}")
        for k, (x, y) in enumerate([(x, y) for x in (-150, 0, 150) for y in (-50, 0, 50)])
    ]
    with pytest.raises(TrackingError, match=r"nearly square to the camera in all 9 views .* leaning 20 to 40"):
        camera_from(flat, SIZE)


def test_a_board_in_the_middle_alone_is_refused_with_the_places_to_film():
    poses = [(lean(a, b, 90), (0, 0, 900)) for a in (-35, 0, 35) for b in (-35, 0, 35)]
    small = [find_board(photograph(R, middle, seed=k), f"small {k}") for k, (R, middle) in enumerate(poses)]
    with pytest.raises(TrackingError, match=r"covers \d+% of the picture .* upper left"):
        camera_from(small, SIZE)


def test_turned_and_mixed_photos_are_refused_by_name(photos, tmp_path):
    paths = write_photos(tmp_path, photos[:3])
    cv2.imwrite(str(tmp_path / "upright.png"), np.rot90(photos[3]))
    with pytest.raises(TrackingError, match=r"upright\.png is turned otherwise than 00\.png"):
        calibrate_camera([*paths, tmp_path / "upright.png"])
    cv2.imwrite(str(tmp_path / "small.png"), photos[3][:, :1000])
    with pytest.raises(TrackingError, match=r"small\.png is 1000 x 720 pixels, 00\.png 1280 x 720"):
        calibrate_camera([*paths, tmp_path / "small.png"])


def test_a_photo_stored_upside_down_is_refused_though_its_size_agrees(photos, tmp_path):
    paths = [tmp_path / "a.jpg", tmp_path / "b.jpg"]
    for path in paths:
        cv2.imwrite(str(path), photos[0])
    stored = paths[1].read_bytes()
    turned = (
        b"\xff\xe1\x00\x22Exif\x00\x00II*\x00\x08\x00\x00\x00\x01\x00\x12\x01\x03\x00\x01\x00\x00\x00\x03\x00\x00\x00"
    )
    paths[1].write_bytes(stored[:2] + turned + bytes(4) + stored[2:])
    with pytest.raises(TrackingError, match=r"b\.jpg is turned otherwise than a\.jpg"):
        calibrate_camera(paths)


def test_files_without_a_board_and_files_that_are_no_pictures_are_refused(tmp_path):
    cv2.imwrite(str(tmp_path / "empty.png"), np.full((360, 640), 128, np.uint8))
    with pytest.raises(TrackingError, match=r"^0 different sharp views .* \(0 of 1 pictures"):
        calibrate_camera([tmp_path / "empty.png"])
    (tmp_path / "notes.txt").write_text("no picture")
    with pytest.raises(TrackingError, match=r"notes\.txt cannot be opened as a video"):
        calibrate_camera([tmp_path / "notes.txt"])
    with pytest.raises(TrackingError, match="No picture is given"):
        calibrate_camera([])
