import json
import re
import subprocess
import sys
from fractions import Fraction

import av
import cv2
import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from backend.cli import app
from backend.observe.measure import track_video
from backend.observe.stills import still
from backend.observe.timestamps import check_times, played_slower, within_ticks
from backend.observe.tracking_error import TrackingError
from backend.observe.video import Part, Video

from .scenes import errors_m, film, four


def repacked(source, target, options=None, turn=0, tags=None, slower=1):
    """The same pictures in another container, unchanged but for turn, tags and the pace at which they play."""
    with av.open(str(source)) as given, av.open(str(target), "w", options=options or {}) as made:
        made.metadata.update(tags or {})
        stream = made.add_stream_from_template(given.streams.video[0])
        if turn:
            stream.set_display_rotation(turn)
        for packet in given.demux(video=0):
            if packet.dts is not None:
                packet.pts, packet.dts, packet.duration = (
                    slower * t for t in (packet.pts, packet.dts, packet.duration)
                )
                packet.stream = stream
                made.mux(packet)
    return target


def test_every_frame_has_its_time_and_one_is_held_at_a_time(four_dots):
    frames = iter(Video(four_dots.path))
    first = next(frames)
    assert first.luma.shape == (360, 640)
    assert first.cb.shape == first.cr.shape == (180, 320)
    times = [first.time_s] + [f.time_s for f in frames]
    np.testing.assert_allclose(times, np.arange(60) / 240, atol=1e-6)  # stamps are whole microseconds


def test_a_clip_of_varying_rate_has_its_true_times(tmp_path):
    rng = np.random.default_rng(4)
    times = np.cumsum(rng.uniform(3e-3, 9e-3, 50))
    times[20:] += 0.03  # and some frames dropped
    times -= times[0]
    clip = film(tmp_path / "vfr.mp4", times, four)
    result = track_video(clip.path, clip.mechanism, clip.bed, out_dir=tmp_path, preview=False)
    seen = result.tracks.time_s.to_numpy()[::4]
    assert np.abs(seen - np.array(clip.truth["times_s"])).max() < 1e-6
    assert np.abs(seen - times).max() < 1e-6
    assert np.nanmax(np.abs(errors_m(clip, result.tracks))) < 5e-4


def test_an_even_pace_is_known_better_than_a_clock_of_milliseconds(four_dots, tmp_path):
    """Matroska rounds to milliseconds, 0.3 mm of a dot at 1 m/s; sixty of them tell the pace."""
    video = Video(repacked(four_dots.path, tmp_path / "a.mkv"))
    times = np.array([f.time_s for f in video])
    np.testing.assert_allclose(times, video.times_s, atol=1e-12)  # what interpolating rounds
    assert np.abs(times - np.arange(60) / 240).max() < 3e-4  # half a tick is 5e-4
    assert np.ptp(np.diff(times)) < 1e-9
    assert video.frames_per_s == pytest.approx(240, rel=2e-3)  # a median of milliseconds is 250
    assert "in ticks of 1 ms; all agree with" in video.warnings[0]


@pytest.mark.parametrize("tick_s", [1e-3, 1 / 600])
def test_frames_that_were_dropped_leave_an_even_pace_even(tick_s):
    """An iPhone's 1/600 s at 240 frames a second: stamps two and three ticks apart by turns."""
    count = np.delete(np.arange(300), [50, 51, 130, 200, 201, 202, 203])
    times, told = within_ticks(np.rint(count / 240 / tick_s) * tick_s, tick_s, "clip")
    assert np.abs(times - count / 240 - (times - count / 240).mean()).max() < 0.1 * tick_s
    assert "all agree with" in told[0]


def test_a_clock_of_milliseconds_at_a_rate_that_varies_is_left_as_it_is():
    """Nothing says when between two ticks a frame was seen; a warning says what that is worth."""
    true = np.cumsum(np.random.default_rng(4).uniform(3e-3, 9e-3, 100))
    stamps = np.rint(true * 1e3) / 1e3
    times, told = within_ticks(stamps, 1e-3, "clip")
    np.testing.assert_array_equal(times, stamps)
    assert "no even pace: a dot at 1 m/s is placed 0.29 mm off" in told[0]
    drifting = np.rint((np.arange(400) / 240 + 2e-3 * np.sin(np.arange(400) / 60)) * 1e3) / 1e3  # 2 ms to and fro
    np.testing.assert_array_equal(within_ticks(drifting, 1e-3, "clip")[0], drifting)


def test_frames_that_fall_on_ticks_and_fine_clocks_need_no_word():
    """30 frames a second in 1/600 s; a GIF's 10 ms; any rate in microseconds."""
    uneven = np.cumsum(np.random.default_rng(4).uniform(3e-3, 9e-3, 100))
    for stamps, tick_s in ((np.arange(90) / 30, 1 / 600), (np.arange(90) / 100, 0.01), (uneven, 1e-6)):
        times, told = within_ticks(stamps, tick_s, "clip")
        np.testing.assert_array_equal(times, stamps)
        assert told == []


def test_a_part_of_a_clip_on_a_coarse_clock_has_the_times_of_the_whole(four_dots, tmp_path):
    path = repacked(four_dots.path, tmp_path / "a.mkv")
    part = Video(path, part=Part(from_s=0.1, to_s=0.2))
    np.testing.assert_allclose([f.time_s for f in part], part.times_s, atol=1e-12)  # what interpolating rounds
    np.testing.assert_array_equal(part.times_s, Video(path).times_s[24:49])


@pytest.mark.parametrize("turn", [90, 180, 270])
def test_a_turned_clip_is_read_as_a_viewer_shows_it(four_dots, tmp_path, turn):
    plain = next(iter(Video(four_dots.path)))
    turned = next(iter(Video(repacked(four_dots.path, tmp_path / "turned.mp4", turn=turn))))
    np.testing.assert_array_equal(turned.luma, np.rot90(plain.luma, turn // 90))
    np.testing.assert_array_equal(turned.cr, np.rot90(plain.cr, turn // 90))
    assert turned.bgr().shape == (*turned.luma.shape, 3)


@pytest.mark.parametrize("turn", [0, 90, 180, 270])
def test_a_turned_clips_points_are_dated_by_the_rows_of_its_sensor(four_dots, tmp_path, turn):
    """Those of a phone held upright are columns of the picture that it shows."""
    clip = repacked(four_dots.path, tmp_path / "turned.mp4", turn=turn)
    u, v = np.meshgrid(np.arange(640.0), np.arange(360.0))
    upright = np.rot90(np.dstack([u, v]), turn // 90)  # which pixel of the sensor each shows

    def seen(x_px, y_px):
        at = int(np.abs(upright - [x_px, y_px]).sum(2).argmin())
        return dict(zip(("y_px", "x_px"), map(float, np.unravel_index(at, upright.shape[:2])), strict=True))

    marks = [m | seen(m["x_px"], m["y_px"]) for m in four_dots.truth["bed_marks"]]
    bed = four_dots.bed | {"marks": marks, "readout_s": 4e-3}
    tracks = track_video(clip, four_dots.mechanism, bed, out_dir=tmp_path, part=Part(to_s=0.03), preview=False).tracks
    rows = np.stack([np.array(p)[:, 1] for p in four_dots.truth["markers_px"].values()], 1)[: len(tracks) // 4]
    late = tracks.time_s.to_numpy().reshape(-1, 4) - np.arange(len(rows))[:, None] / 240
    np.testing.assert_allclose(late, 4e-3 * rows / 359, atol=1e-5)  # ticks of a microsecond, rows to a tenth


@pytest.mark.skipif("libx265" not in av.codecs_available, reason="this build of PyAV has no libx265 to film with")
@pytest.mark.parametrize("turn", [0, 90])
def test_ten_bit_hevc_is_read_at_eight_bits_and_upright(tmp_path, turn):
    """What phones film by default: Main 10, 4:2:0, here with a ramp in luma and one colour."""
    ramp = np.tile(np.linspace(16, 235, 128), (96, 1)) + np.linspace(0, 2, 96)[:, None]
    with av.open(str(tmp_path / "plain.mp4"), "w") as out:
        stream = out.add_stream("libx265", rate=240, options={"crf": "4", "x265-params": "log-level=none"})
        stream.width, stream.height, stream.pix_fmt = 128, 96, "yuv420p10le"
        for k in range(6):
            picture = av.VideoFrame(128, 96, "yuv420p10le")
            for plane, codes in zip(
                picture.planes, (ramp, np.full((48, 64), 90.0), np.full((48, 64), 160.0)), strict=True
            ):
                row = np.zeros((plane.height, plane.line_size // 2), "<u2")
                row[:, : plane.width] = np.round(4 * codes)  # ten bits count quarters of a code
                plane.update(row.tobytes())
            picture.pts = k
            out.mux(stream.encode(picture))
        out.mux(stream.encode(None))
    video = Video(repacked(tmp_path / "plain.mp4", tmp_path / "turned.mp4", turn=turn))
    frames = list(video)
    assert frames[0].source.format.name == "yuv420p"
    np.testing.assert_allclose([f.time_s for f in frames], np.arange(6) / 240 + frames[0].time_s, atol=1e-5)  # ticks
    upright = np.rot90(ramp, turn // 90)
    assert frames[3].luma.shape == upright.shape
    # Rounding to eight bits, and crf 4 on a clean ramp: one code; half a code of it would be a shift.
    off = frames[3].luma - upright
    assert np.abs(off).max() <= 2.5
    assert abs(off.mean()) < 0.3
    assert np.abs(frames[3].cb - 90.0).max() <= 1
    assert np.abs(frames[3].cr - 160.0).max() <= 1


def test_streaming_ten_times_as_many_frames_needs_no_more_memory(tmp_path):
    """Read in processes of their own, whose peak is theirs alone."""
    peaks = []
    for count in (40, 400):
        with av.open(str(tmp_path / f"{count}.mp4"), "w") as out:
            stream = out.add_stream("libx264", rate=240, options={"preset": "ultrafast"})
            stream.width, stream.height, stream.pix_fmt = 1280, 720, "yuv420p"
            for k in range(count):
                picture = av.VideoFrame.from_ndarray(np.full((1080, 1280), 40 + k % 100, np.uint8), format="yuv420p")
                picture.pts = k
                out.mux(stream.encode(picture))
            out.mux(stream.encode(None))
        # VmHWM: ru_maxrss would start at what the parent held.
        read = (
            "import sys; from backend.observe.video import Video; n = sum(1 for _ in Video(sys.argv[1]));"
            "print(n, next(r.split()[1] for r in open('/proc/self/status') if r.startswith('VmHWM')))"
        )
        done = subprocess.run(
            [sys.executable, "-c", read, str(tmp_path / f"{count}.mp4")], capture_output=True, text=True, check=True
        )
        read_frames, kilobytes = map(int, done.stdout.split())
        assert read_frames == count
        peaks.append(kilobytes / 1024)
    # 360 more frames are 500 MB as luma and colour, 1 GB as BGR.
    assert peaks[1] - peaks[0] < 30


def test_slow_motion_that_says_how_it_was_filmed_gets_its_times_back(four_dots, tmp_path):
    """Some cameras write 240 frames a second to be played at 30, and note the 240."""
    tags = {"com.android.capture.fps": "240.000000"}
    slow = repacked(
        four_dots.path, tmp_path / "slow.mp4", {"movflags": "use_metadata_tags"}, tags=tags, slower=8
    )  # fmt: skip
    video = Video(slow)
    assert video.frames_per_s == pytest.approx(240, rel=1e-3)  # stamps are whole microseconds
    assert np.abs(np.array([f.time_s for f in video]) - np.arange(60) / 240).max() < 1e-5
    assert "plays at 30: its times are divided by 8" in video.warnings[0]
    true = repacked(four_dots.path, tmp_path / "true.mp4", {"movflags": "use_metadata_tags"}, tags=tags)
    assert Video(true).warnings == []
    dark = repacked(four_dots.path, tmp_path / "dark.mp4", {"movflags": "use_metadata_tags"}, tags=tags, slower=2)
    assert Video(dark).frames_per_s == pytest.approx(120, rel=1e-3)  # a camera that halved its rate, no slow motion


@pytest.mark.parametrize(
    ("filmed", "played", "slower"),
    [(1000, 30, 100 / 3), (1000, 24, 125 / 3), (960, 25, 38.4), (480, 25, 19.2), (240, 30 / 1.001, 8), (240, 30, 8)],
)
def test_slow_motion_is_stretched_by_the_ratio_of_its_rates_whole_or_not(filmed, played, slower):
    times = np.round(np.delete(np.arange(90), [20, 21, 50]) / played, 3)  # Matroska's milliseconds, dropped frames
    pace, told = played_slower(times, None, "clip", filmed)
    # Steps of a millisecond on 86 frames: the pace is known to 1 / 33 / 86.
    assert 1 / pace == pytest.approx(slower, rel=5e-4)
    assert f"divided by {1 / pace:.4g}" in told[0]


def test_the_command_line_keeps_a_truncated_clip_when_asked(four_dots, tmp_path):
    whole = repacked(four_dots.path, tmp_path / "whole.mp4", {"movflags": "faststart"}).read_bytes()
    (tmp_path / "short.mp4").write_bytes(whole[: len(whole) * 3 // 5])
    (tmp_path / "m.json").write_text(four_dots.mechanism.model_dump_json())
    (tmp_path / "bed.json").write_text(json.dumps(four_dots.bed))
    given = ["track", tmp_path / "short.mp4", "--mechanism", tmp_path / "m.json", "--bed", tmp_path / "bed.json"]
    given = [str(a) for a in [*given, "--out", tmp_path / "out", "--json"]]
    refused = CliRunner().invoke(app, given)
    assert refused.exit_code == 2
    assert "--keep-truncated" in refused.stderr
    kept = CliRunner().invoke(app, [*given, "--keep-truncated"])
    assert kept.exit_code == 0
    assert json.loads(kept.stdout)["truncated"]


@pytest.mark.parametrize(
    ("content", "says"),
    [(b"", "is empty"), (b"To whom it may concern. " * 400, "cannot be opened"), (bytes(5000), "cannot be opened")],
)
def test_what_is_no_video_is_refused_with_zero_frames_read(tmp_path, content, says):
    path = tmp_path / "clip.mp4"
    path.write_bytes(content)
    with pytest.raises(TrackingError, match=rf"clip\.mp4 {says}.*0 frames read"):
        Video(path)


def test_a_missing_file_and_a_picture_are_refused(tmp_path):
    with pytest.raises(TrackingError, match="There is no file"):
        Video(tmp_path / "none.mp4")
    av.VideoFrame.from_ndarray(np.zeros((64, 64, 3), np.uint8)).save(tmp_path / "still.png")
    (tmp_path / "still.png").rename(tmp_path / "still.mp4")
    with pytest.raises(TrackingError, match="one frame"):
        Video(tmp_path / "still.mp4")
    jpeg = cv2.imencode(".jpg", np.zeros((64, 64, 3), np.uint8))[1]
    (tmp_path / "photo.mp4").write_bytes(jpeg.tobytes())
    with pytest.raises(TrackingError, match=r"photo\.mp4 (holds one frame|cannot be opened)"):
        Video(tmp_path / "photo.mp4")


def test_subtitles_named_like_a_clip_have_no_picture(tmp_path):
    (tmp_path / "words.mp4").write_text("1\n00:00:00,000 --> 00:00:01,000\nHello\n\n" * 20)
    with pytest.raises(TrackingError, match=r"words\.mp4 (has no picture|cannot be opened)"):
        Video(tmp_path / "words.mp4")


def test_sound_alone_is_refused(tmp_path):
    path = tmp_path / "sound.mp4"
    with av.open(str(path), "w") as out:
        stream = out.add_stream("aac", rate=48000, layout="mono")
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 1024), np.float32), format="fltp", layout="mono")
        frame.sample_rate, frame.pts = 48000, 0
        out.mux(stream.encode(frame))
        out.mux(stream.encode(None))
    with pytest.raises(TrackingError, match="no picture"):
        Video(path)


def test_a_recording_cut_before_its_index_was_written_is_refused(four_dots, tmp_path):
    whole = four_dots.path.read_bytes()
    (tmp_path / "cut.mp4").write_bytes(whole[: len(whole) * 2 // 3])
    with pytest.raises(TrackingError, match="0 frames read"):
        Video(tmp_path / "cut.mp4")


@pytest.mark.parametrize("suffix", ["mp4", "mkv"])
def test_a_truncated_file_says_how_many_frames_it_read_and_keeps_them_on_request(four_dots, tmp_path, suffix):
    whole = repacked(four_dots.path, tmp_path / f"whole.{suffix}", {"movflags": "faststart"} if suffix == "mp4" else {})
    data = whole.read_bytes()
    path = tmp_path / f"short.{suffix}"
    path.write_bytes(data[: len(data) * 3 // 5])
    with pytest.raises(TrackingError, match=r"ends too early: [1-5]\d (of 60 )?frames could be read"):
        track_video(path, four_dots.mechanism, four_dots.bed, out_dir=tmp_path)
    result = track_video(path, four_dots.mechanism, four_dots.bed, out_dir=tmp_path, keep_truncated=True, preview=False)
    kept = result.summary["frames"]
    assert 10 < kept < 60
    assert result.summary["truncated"]
    assert any(f"{kept}" in said and "ends too early" in said for said in result.summary["warnings"])
    assert np.nanmedian(np.abs(errors_m(four_dots, result.tracks))) < 1e-4


@pytest.mark.parametrize("tagged", [True, False])
def test_sound_that_goes_on_after_the_pictures_cuts_no_clip_short(four_dots, tmp_path, tagged):
    """Matroska says how long its longest track is, and of each track only in a tag that not all writers write."""
    path = tmp_path / "talk.mkv"
    with av.open(str(four_dots.path)) as given, av.open(str(path), "w") as made:
        stream = made.add_stream_from_template(given.streams.video[0])
        sound = made.add_stream("pcm_s16le", rate=8000, layout="mono")
        for packet in given.demux(video=0):
            if packet.dts is not None:
                packet.pts, packet.dts = packet.pts + 100_000, packet.dts + 100_000  # us: the sound begins first
                packet.stream = stream
                made.mux(packet)
        heard = av.AudioFrame.from_ndarray(np.zeros((1, 8000), np.int16), format="s16", layout="mono")
        heard.sample_rate, heard.pts = 8000, 0
        made.mux(sound.encode(heard))
    if not tagged:
        path.write_bytes(path.read_bytes().replace(b"DURATION", b"DURATIOM"))
    assert len(list(Video(path))) == 60
    data = path.read_bytes()
    (tmp_path / "short.mkv").write_bytes(data[: len(data) * 3 // 5])
    if tagged:
        with pytest.raises(TrackingError, match="ends too early"):
            Video(tmp_path / "short.mkv")


@pytest.mark.parametrize("suffix", ["mp4", "mkv"])
def test_a_last_picture_that_stands_long_is_no_missing_end(four_dots, tmp_path, suffix):
    with av.open(str(four_dots.path)) as given, av.open(str(tmp_path / f"long.{suffix}"), "w") as made:
        stream = made.add_stream_from_template(given.streams.video[0])
        packets = [packet for packet in given.demux(video=0) if packet.dts is not None]
        packets[-1].duration *= 100
        for packet in packets:
            packet.stream = stream
            made.mux(packet)
    assert not Video(tmp_path / f"long.{suffix}").truncated


def test_pixels_that_are_not_square_are_told_with_their_remedy(four_dots, tmp_path):
    told = []
    for width in (64, 96):  # shown as wide as this, for 64 pixels
        with av.open(str(tmp_path / "tape.mp4"), "w") as made:
            stream = made.add_stream("libx264", rate=25)
            stream.width, stream.height, stream.pix_fmt = 64, 64, "yuv420p"
            stream.sample_aspect_ratio = Fraction(width, 64)
            for _ in range(5):
                made.mux(stream.encode(av.VideoFrame.from_ndarray(np.zeros((64, 64, 3), np.uint8))))
            made.mux(stream.encode(None))
        told.append(Video(tmp_path / "tape.mp4").warnings)
    assert told[0] == []
    assert "1.5 times as wide as high (3:2)" in told[1][0]
    assert "setsar=1" in told[1][0]


def test_garbage_in_the_middle_never_ends_in_a_crash(four_dots, tmp_path):
    """A damaged copy is refused or read in part; what is measured stays on the dots or says it is not."""
    data = bytearray(four_dots.path.read_bytes())
    rng = np.random.default_rng(0)
    for k in range(4):
        at = len(data) // 3 + 3001 * k
        data[at : at + 500] = rng.integers(0, 256, 500, dtype=np.uint8).tobytes()
    (tmp_path / "bad.mp4").write_bytes(data)
    try:
        result = track_video(
            tmp_path / "bad.mp4", four_dots.mechanism, four_dots.bed, out_dir=tmp_path, keep_truncated=True
        )
    except TrackingError:
        return
    assert 1 <= result.summary["frames"] <= 60


def test_a_baked_in_slow_motion_ramp_is_refused(tmp_path):
    step = np.repeat([1 / 240, 1 / 30, 1 / 240], 20)
    times = np.r_[0, np.cumsum(step)]
    clip = film(tmp_path / "ramp.mp4", times, lambda t: four(0 * t))
    with pytest.raises(
        TrackingError, match=r"slow-motion ramp is baked.*original file from the camera.*Unmodified Original"
    ):
        Video(clip.path)


def test_a_clip_without_a_clock_is_refused(tmp_path):
    with av.open(str(tmp_path / "raw.h264"), "w", format="h264") as out:
        stream = out.add_stream("libx264", rate=Fraction(30))
        stream.width = stream.height = 64
        for _ in range(5):
            out.mux(stream.encode(av.VideoFrame.from_ndarray(np.zeros((64, 64, 3), np.uint8))))
        out.mux(stream.encode(None))
    with pytest.raises(TrackingError, match="no timestamps"):
        Video(tmp_path / "raw.h264")


def test_dropped_frames_and_a_rate_that_halves_are_no_jump_but_told():
    step = np.full(100, 1 / 60)
    step[50:] = 1 / 30  # exposure in a dark room
    step[[10, 30]] *= 4
    (said,) = check_times(np.r_[0, np.cumsum(step)], "clip")
    assert re.search(r"16.67 ms apart near frame \d and 33.33 ms near frame [45]\d", said)
    assert "slows in poor light. If an editor did it, times are wrong" in said
    step[50:] = 1 / 50  # less than a camera that hunts for light
    assert check_times(np.r_[0, np.cumsum(step)], "clip") == []


@pytest.mark.parametrize(
    ("times", "says"),
    [
        (np.r_[np.arange(30), np.arange(50, 80)] / 240, "jumps by 87.5 ms after frame 29"),
        (np.r_[np.arange(30), np.arange(28, 50)] / 240, "jumps from 0.1208 s to 0.1167 s"),
        (np.r_[np.arange(30), 29, np.arange(30, 40)] / 240, "jumps from"),
    ],
)
def test_a_clock_that_leaps_stops_or_runs_back_is_refused(times, says):
    with pytest.raises(TrackingError, match=says):
        check_times(times, "clip")


def test_a_tag_that_is_no_utf8_does_not_stop_a_clip(four_dots, tmp_path):
    clip = repacked(four_dots.path, tmp_path / "named.mp4", tags={"title": "a bench in Zuerich"})
    data = clip.read_bytes()
    assert data.count(b"Zuerich") == 1
    clip.write_bytes(data.replace(b"Zuerich", b"Z\xfcrich.", 1))  # as Latin-1 spells it
    assert len(list(Video(clip))) == 60


def test_a_part_of_slow_motion_that_notes_no_rate_is_read_with_its_true_times(four_dots, tmp_path):
    slow = repacked(four_dots.path, tmp_path / "slow.mp4", slower=8)
    part = list(Video(slow, part=Part(from_s=0.5, to_s=1.0, filmed_per_s=240)))
    assert [f.index for f in part] == list(range(15, 31))  # plays at 30 a second
    assert np.abs(np.array([f.time_s for f in part]) - np.arange(15, 31) / 240).max() < 1e-5
    with pytest.raises(TrackingError, match=r"lasts 1\.97 s; 0 of its frames"):
        Video(slow, part=Part(from_s=5))
    begun = Video(slow, part=Part(from_s=0.49, filmed_per_s=240))
    assert (begun.begins_s, begun.slower) == pytest.approx((0.5, 8.0), abs=1e-4)
    assert still(slow, 0.0, from_s=0.49)[0] == pytest.approx(0.5, abs=1e-4)


def test_a_part_of_a_clip_is_tracked_by_command(four_dots, tmp_path):
    """What stands in the bed file is one length; the clip starts when its pictures are fit to be seen."""
    (tmp_path / "m.json").write_text(four_dots.mechanism.model_dump_json())
    a, b = ([mark[k] for k in ("x_px", "y_px")] for mark in four_dots.bed["marks"][:2])
    stick = {"a_px": a, "b_px": b, "length_m": 0.3, "origin_px": [319.5, 179.5]}
    (tmp_path / "bed.json").write_text(json.dumps({"stick": stick}))
    given = ["track", four_dots.path, "--mechanism", tmp_path / "m.json", "--bed", tmp_path / "bed.json"]
    given += ["--from", "0.048", "--to", "0.102", "--out", tmp_path / "out", "--json"]
    done = CliRunner().invoke(app, [str(word) for word in given])
    assert done.exit_code == 0, done.stderr
    tracks = pd.read_csv(tmp_path / "out" / "tracks.csv")
    assert tracks.frame.min() == 12
    assert tracks.frame.max() == 24
    truth = np.stack([p[12:25, :2] for p in four_dots.markers_m.values()], 1).reshape(-1, 2)
    assert np.abs(tracks[["x_m", "y_m"]].to_numpy() - truth).max() < 3e-4
    assert "a camera that leans" in json.loads(done.stdout)["warnings"][-1]
