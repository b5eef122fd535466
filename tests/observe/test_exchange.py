"""Tracks made elsewhere become tracks, and ours become theirs."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from backend.cli import app
from backend.mechanism.tracks import read_table
from backend.observe.exchange.convert import convert, parse_names
from backend.observe.tracking_error import TrackingError
from backend.observe.video import read_index

from .elsewhere import dlc_csv, dlc_table_h5, sleap_h5, trc_text
from .scenes import errors_m

NOISE_PX = 0.3
METRES_PER_PX = 5e-4


@pytest.fixture(scope="module")
def seen(four_dots):
    """Where each dot of the clip is, told with the error that a network makes [px]."""
    rng = np.random.default_rng(5)
    return {n: np.array(p) + rng.normal(0, NOISE_PX, (60, 2)) for n, p in four_dots.truth["markers_px"].items()}


@pytest.fixture
def sure(seen):
    return {n: np.full(60, 0.99) for n in seen}


def written(kind, path, seen, sure):
    if kind == "csv":
        return dlc_csv(path / "pose.csv", seen, sure)
    if kind == "h5":
        return dlc_table_h5(path / "pose.h5", seen, sure)
    return sleap_h5(
        path / "pose.analysis.h5", {n: p[None] for n, p in seen.items()}, {n: s[None] for n, s in sure.items()}
    )


@pytest.mark.parametrize("kind", ["csv", "h5", "sleap"])
def test_a_networks_tracks_are_placed_on_the_bed_at_the_clips_own_times(four_dots, seen, sure, tmp_path, kind):
    file = written(kind, tmp_path, seen, sure)
    made = convert(file, four_dots.mechanism, bed=four_dots.bed, video=four_dots.path, out_dir=tmp_path)
    read = read_table("tracks", made.files[0], four_dots.mechanism)
    np.testing.assert_allclose(read.time_s[::4], read_index(four_dots.path).times_s, atol=1e-9)
    error = errors_m(four_dots, made.tracks)
    assert np.sqrt((error**2).mean()) == pytest.approx(NOISE_PX * METRES_PER_PX, rel=0.1)  # 480 draws: 3%
    assert made.summary["warnings"] == []
    nees = (error**2).sum(2).ravel() / 2 / read.sigma_m.to_numpy() ** 2
    assert 0.7 < nees.mean() < 1.4  # 55 differences a dot tell a variance within 20%, four dots within 10%


def test_a_score_says_whether_a_point_was_seen_and_never_how_well(four_dots, seen, sure, tmp_path):
    hesitant = {n: s.copy() for n, s in sure.items()}
    hesitant["swing"][:30] = 0.61  # over DeepLabCut's own 0.6
    hesitant["wheel"][10:14] = 0.2
    common = {"bed": four_dots.bed, "frames_per_s": 240.0, "out_dir": tmp_path}
    plain = convert(dlc_csv(tmp_path / "a.csv", seen, sure), four_dots.mechanism, **common).tracks
    made = convert(dlc_csv(tmp_path / "b.csv", seen, hesitant), four_dots.mechanism, **common).tracks
    for column in ("x_m", "sigma_m", "cov_xx_px2"):
        np.testing.assert_array_equal(made[made.marker == "swing"][column], plain[plain.marker == "swing"][column])
    hidden = made[made.status == "occluded"]
    assert list(hidden.marker) == ["wheel"] * 4
    assert list(hidden.frame) == [10, 11, 12, 13]
    assert hidden[["x_m", "y_m", "sigma_m", "x_px"]].isna().all(axis=None)
    lenient = convert(tmp_path / "b.csv", four_dots.mechanism, least_score=0.1, **common).tracks
    assert (lenient.status == "observed").all()
    with pytest.raises(TrackingError, match=r"no point reaches the score 0\.995 \(the best is 0\.99\)"):
        convert(tmp_path / "a.csv", four_dots.mechanism, least_score=0.995, **common)


@pytest.mark.parametrize("to", ["deeplabcut", "sleap", "trc"])
def test_tracks_that_went_to_another_tool_and_back_are_the_same(four_dots, seen, sure, tmp_path, to):
    sure["post"][7] = 0.0
    common = {"bed": four_dots.bed, "video": four_dots.path}
    file = dlc_csv(tmp_path / "pose.csv", seen, sure)
    ours = convert(file, four_dots.mechanism, out_dir=tmp_path, **common)
    sent = convert(ours.files[0], four_dots.mechanism, to=to, out_dir=tmp_path / to)
    back = {} if to == "trc" else common
    for theirs in sent.files:
        tracks = convert(theirs, four_dots.mechanism, out_dir=tmp_path / "back", **back).tracks
        for column in ("time_s", "x_m", "y_m"):  # ten digits are written of a length of 0.1 m; TRC keeps a nanometre
            np.testing.assert_allclose(tracks[column], ours.tracks[column], atol=1e-9)
        assert list(tracks.marker) == list(ours.tracks.marker)
        assert list(tracks.status) == list(ours.tracks.status)
        ratio = tracks.sigma_m / ours.tracks.sigma_m
        assert np.nanmax(np.abs(ratio - 1)) < (0.25 if to == "trc" else 1e-6)  # TRC has a third axis, without noise
    assert any("z_m was not measured" in said for said in sent.summary["warnings"]) == (to == "trc")


def test_metres_alone_become_pixels_through_the_bed(four_dots, seen, sure, tmp_path):
    ours = convert(
        dlc_csv(tmp_path / "pose.csv", seen, sure), four_dots.mechanism, bed=four_dots.bed, frames_per_s=240,
        out_dir=tmp_path,
    )  # fmt: skip
    bare = tmp_path / "bare.csv"
    ours.tracks[["time_s", "marker", "x_m", "y_m", "z_m", "sigma_m"]].to_csv(bare, index=False)
    sent = convert(bare, four_dots.mechanism, to="sleap", bed=four_dots.bed, out_dir=tmp_path)
    back = convert(sent.files[0], four_dots.mechanism, bed=four_dots.bed, frames_per_s=240, out_dir=tmp_path / "back")
    np.testing.assert_allclose(back.tracks.x_px, ours.tracks.x_px, atol=1e-5)  # a homography there and back
    with pytest.raises(TrackingError, match=r"no pixels .*Give --bed"):
        convert(bare, four_dots.mechanism, to="deeplabcut", out_dir=tmp_path)


def test_a_dot_that_was_missed_or_only_guessed_is_not_passed_on_as_seen(four_dots, seen, sure, tmp_path):
    tracks = convert(
        dlc_csv(tmp_path / "pose.csv", seen, sure), four_dots.mechanism, bed=four_dots.bed, frames_per_s=240,
        out_dir=tmp_path,
    ).tracks  # fmt: skip
    tracks.loc[tracks.frame == 20, "status"] = "predicted"
    tracks.to_csv(tmp_path / "tracks.csv", index=False)
    for to in ("deeplabcut", "sleap"):
        sent = convert(tmp_path / "tracks.csv", four_dots.mechanism, to=to, out_dir=tmp_path)
        back = convert(sent.files[0], four_dots.mechanism, bed=four_dots.bed, frames_per_s=240, out_dir=tmp_path / "b")
        assert set(back.tracks.frame[back.tracks.status == "occluded"]) == {20}


def test_names_are_translated_left_out_or_refused(four_dots, seen, sure, tmp_path):
    theirs = {"Swing tip": seen["swing"], "post": seen["post"], "screw": seen["wheel"]}
    file = dlc_csv(tmp_path / "pose.csv", theirs, {n: sure["post"] for n in theirs})
    common = {"bed": four_dots.bed, "frames_per_s": 240.0, "out_dir": tmp_path}
    made = convert(file, four_dots.mechanism, names="Swing tip=swing, screw=", **common)
    assert set(made.tracks.marker) == {"swing", "post"}
    assert any("no track of base, wheel" in said for said in made.summary["warnings"])
    with pytest.raises(TrackingError, match=r"Swing tip, screw are not drawn.*base, post, swing, wheel.*Swing tip="):
        convert(file, four_dots.mechanism, **common)
    with pytest.raises(TrackingError, match=r"no point tip, which --names renames. It has Swing tip, post, screw"):
        convert(file, four_dots.mechanism, names="tip=swing", **common)
    with pytest.raises(TrackingError, match="two points are named post"):
        convert(file, four_dots.mechanism, names="Swing tip=post,screw=", **common)
    with pytest.raises(TrackingError, match="leaves out every point"):
        convert(file, four_dots.mechanism, names="Swing tip=,post=,screw=", **common)
    with pytest.raises(TrackingError, match="no pair"):
        parse_names("Swing tip")


def test_names_that_were_mixed_up_show_at_the_start(four_dots, seen, sure, tmp_path):
    file = dlc_csv(tmp_path / "pose.csv", seen, sure)
    made = convert(
        file, four_dots.mechanism, names="base=post,post=base,swing=wheel,wheel=swing", bed=four_dots.bed,
        frames_per_s=240, out_dir=tmp_path,
    )  # fmt: skip
    assert any("from where the drawing has them" in said for said in made.summary["warnings"])


def test_the_clip_and_the_tracks_must_belong_together(four_dots, seen, sure, tmp_path):
    common = {"bed": four_dots.bed, "video": four_dots.path, "out_dir": tmp_path}
    longer = dlc_csv(tmp_path / "long.csv", *({n: np.r_[v, v[:1]] for n, v in s.items()} for s in (seen, sure)))
    with pytest.raises(TrackingError, match=r"has frame 60, and four\.mp4 has 60 frames"):
        convert(longer, four_dots.mechanism, **common)
    padded = dlc_csv(
        tmp_path / "pad.csv", {n: np.r_[v, np.full((3, 2), np.nan)] for n, v in seen.items()},
        {n: np.r_[v, np.full(3, np.nan)] for n, v in sure.items()},
    )  # fmt: skip
    assert convert(padded, four_dots.mechanism, **common).summary["frames"] == 60
    short = dlc_csv(tmp_path / "short.csv", *({n: v[5:] for n, v in s.items()} for s in (seen, sure)))
    warned = " ".join(convert(short, four_dots.mechanism, **common).summary["warnings"])
    assert "every time is too early" in warned
    # The clip's plate is drawn as one body, and its dots have moved by the fifth picture.
    assert "swing to wheel 92.4 mm, drawn 100.5 mm" in warned
    scaled = dlc_csv(tmp_path / "scaled.csv", {n: 3 * v for n, v in seen.items()}, sure)
    with pytest.raises(TrackingError, match=r"outside the 640 x 360 picture.*scaled, cropped or turned copy"):
        convert(scaled, four_dots.mechanism, **common)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"frames_per_s": 240.0}, "is in pixels. Give --bed"),
        ({"bed": True}, "Give --video CLIP.*or --fps"),
        ({"bed": True, "frames_per_s": 0.0}, "--fps is 0"),
        ({"bed": True, "frames_per_s": 30.0, "video": "x.mp4"}, "not both"),
        ({"bed": True, "frames_per_s": 30.0, "filmed_per_s": 240.0}, "--filmed-at says .* Give --video CLIP"),
        ({"bed": True, "frames_per_s": 30.0, "to": "c3d"}, "unknown; write one of tracks, deeplabcut, sleap, trc"),
        ({"bed": {"camera_height_m": 0.8}, "frames_per_s": 30.0}, "camera_height_m needs the middle.*--video"),
        ({"bed": {"lens": {"focal_px": 1600}}, "frames_per_s": 30.0}, "lens without centre_px needs the middle"),
    ],
)
def test_what_is_missing_is_asked_for(four_dots, seen, sure, tmp_path, given, says):
    bed = given.get("bed")
    given = given | ({"bed": four_dots.bed | (bed if isinstance(bed, dict) else {})} if bed else {})
    with pytest.raises(TrackingError, match=says):
        convert(dlc_csv(tmp_path / "pose.csv", seen, sure), four_dots.mechanism, out_dir=tmp_path, **given)


def test_one_frame_is_no_motion(four_dots, seen, sure, tmp_path):
    file = dlc_csv(tmp_path / "pose.csv", *({n: v[:1] for n, v in s.items()} for s in (seen, sure)))
    with pytest.raises(TrackingError, match="one frame; motion needs at least two"):
        convert(file, four_dots.mechanism, bed=four_dots.bed, frames_per_s=240, out_dir=tmp_path)


def test_rows_that_were_left_out_are_a_gap_and_no_shorter_time(four_dots, seen, sure, tmp_path):
    rows = dlc_csv(tmp_path / "pose.csv", seen, sure).read_text().splitlines(keepends=True)
    (tmp_path / "gap.csv").write_text("".join(rows[:23] + rows[43:]))
    made = convert(tmp_path / "gap.csv", four_dots.mechanism, bed=four_dots.bed, video=four_dots.path, out_dir=tmp_path)
    frames = np.r_[0:20, 40:60]
    np.testing.assert_array_equal(made.tracks.frame[::4], frames)
    np.testing.assert_allclose(made.tracks.time_s[::4], frames / 240, atol=1e-6)  # stamps are whole microseconds
    assert np.abs(errors_m(four_dots, made.tracks)).max() < 5 * NOISE_PX * METRES_PER_PX


def test_a_known_lens_with_its_centre_needs_no_clip(four_dots, seen, sure, tmp_path):
    bed = four_dots.bed | {"lens": {"focal_px": 1600, "centre_px": [319.5, 179.5]}}
    file = dlc_csv(tmp_path / "pose.csv", seen, sure)
    made = convert(file, four_dots.mechanism, bed=bed, frames_per_s=240, out_dir=tmp_path)
    assert np.abs(errors_m(four_dots, made.tracks)).max() < 5 * NOISE_PX * METRES_PER_PX


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "is empty"),
        (b"\x89HDF\r\n\x1a\n" + bytes(20), "HDF5 file that"),
        (b"time;x;y\n0;1;2\n", "no file of tracks: it begins with 'time;x;y'"),
        (b"\x00\x01\x02" * 30, "no text and no HDF5; a clip is measured by linktwin track"),
    ],
)
def test_what_no_tool_wrote_is_refused_in_a_sentence(four_dots, tmp_path, content, says):
    (tmp_path / "pose.csv").write_bytes(content)
    with pytest.raises(TrackingError, match=says):
        convert(tmp_path / "pose.csv", four_dots.mechanism, out_dir=tmp_path)


def test_the_command_line_converts_and_says_what_it_saw(four_dots, seen, sure, tmp_path):
    (tmp_path / "m.json").write_text(four_dots.mechanism.model_dump_json())
    (tmp_path / "bed.json").write_text(json.dumps(four_dots.bed))
    theirs = {f"{n}_t": p for n, p in seen.items()}
    file = dlc_csv(tmp_path / "pose.csv", theirs, {n: sure["post"] for n in theirs})
    named = ",".join(f"{n}_t={n}" for n in seen)
    given = ["convert", file, "--mechanism", tmp_path / "m.json", "--bed", tmp_path / "bed.json"]
    given += ["--video", four_dots.path, "--out", tmp_path / "out"]
    slow = CliRunner().invoke(app, [str(a) for a in [*given, "--names", named, "--filmed-at", "960", "--json"]])
    report = json.loads(slow.stdout)
    assert report["duration_s"] == pytest.approx(59 / 960, rel=1e-4)  # stamps are whole microseconds
    assert any("filmed at 960 frames a second, as was said" in warned for warned in report["warnings"])
    said = CliRunner().invoke(app, [str(a) for a in [*given, "--names", named]])
    assert said.exit_code == 0, said.output
    assert "DeepLabCut CSV" in said.stdout
    assert "60 observed" in said.stdout
    told = CliRunner().invoke(app, [str(a) for a in [*given, "--names", named, "--to", "trc", "--json"]])
    assert [f.endswith("tracks.trc") for f in json.loads(told.stdout)["files"]] == [True]
    wrong = CliRunner().invoke(app, [str(a) for a in given])
    assert wrong.exit_code == 2
    assert "base_t, post_t, swing_t, wheel_t are not drawn" in wrong.stderr
    again = CliRunner().invoke(app, [str(a) for a in ["convert", tmp_path / "out" / "tracks.csv", *given[2:4]]])
    assert again.exit_code == 2
    assert "a study reads it as it is" in again.stderr


def test_a_trc_file_is_metres_already(four_dots, tmp_path):
    times = np.arange(60) / 100
    rng = np.random.default_rng(2)
    noisy = {n: p + rng.normal(0, 2e-4, (60, 3)) for n, p in four_dots.markers_m.items()}
    noisy["wheel"][3] = np.nan
    for unit, per_m in (("mm", 1e3), ("m", 1.0)):
        (tmp_path / "walk.trc").write_text(trc_text(noisy, times, unit, per_m))
        made = convert(tmp_path / "walk.trc", four_dots.mechanism, out_dir=tmp_path)
        at = made.tracks[["x_m", "y_m", "z_m"]].to_numpy().reshape(60, 4, 3)
        # Five decimals are written, of millimetres or of metres.
        np.testing.assert_allclose(at, np.stack([noisy[n] for n in four_dots.markers_m], 1), atol=0.6e-5 / per_m)
        np.testing.assert_allclose(made.tracks.time_s[::4], times, atol=1e-9)
        sigma = made.tracks.sigma_m.dropna().unique()
        assert sigma == pytest.approx(np.full(4, 2e-4), rel=0.25)  # 150 numbers a marker: 8%, three times that
        assert list(made.tracks.status).count("occluded") == 1
        assert "x_px" not in made.tracks
        assert len(read_table("tracks", made.files[0], four_dots.mechanism)) == 240
    with pytest.raises(TrackingError, match="carries its own times"):
        convert(tmp_path / "walk.trc", four_dots.mechanism, frames_per_s=100, out_dir=tmp_path)
