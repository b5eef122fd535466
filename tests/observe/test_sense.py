"""A bed file, a drawing or a clip that cannot belong together is refused or told, never measured in silence."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from backend.observe.account import warn_lost
from backend.observe.bars import Bar, known_lengths
from backend.observe.bed import Bed, read_bed
from backend.observe.dots import learn_look
from backend.observe.measure import track_video
from backend.observe.plane import Plane
from backend.observe.project import calibrate
from backend.observe.sense import check_marks, warn_lengths
from backend.observe.tracking_error import TrackingError
from backend.observe.video import Video

from .filmed_fourbar import MARKERS, fourbar
from .filmed_fourbar import drawing as fourbar_drawing
from .scenes import drawing, film, four

FLAT = Bed()  # of which nothing is known


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    """Ten pictures of four dots."""
    return film(tmp_path_factory.mktemp("sense") / "four.mp4", np.arange(10) / 240, four)


def spread(bed, scale):
    """The bed file with its marks' places so many times as far apart."""
    return bed | {"marks": [m | {"x_m": scale * m["x_m"], "y_m": scale * m["y_m"]} for m in bed["marks"]]}


@pytest.mark.parametrize("scale", [1e3, 39.37, 1e-3])
def test_a_bed_file_in_another_unit_is_refused_as_that(clip, tmp_path, scale):
    with pytest.raises(TrackingError, match=r"another unit\. All lengths are in metres"):
        track_video(clip.path, clip.mechanism, spread(clip.bed, scale), out_dir=tmp_path)


def test_a_single_dot_in_millimetres_puts_the_camera_a_quarter_of_a_kilometre_away(clip, tmp_path):
    alone = drawing({"base": clip.markers_m["base"][0]})
    with pytest.raises(TrackingError, match="the camera would be about 250 m away"):
        track_video(clip.path, alone, spread(clip.bed, 1e3), out_dir=tmp_path)


@pytest.mark.parametrize("known", [{}, {"lens": {"focal_px": 500}}])
def test_a_height_in_millimetres_is_refused_as_that(clip, tmp_path, known):
    with pytest.raises(TrackingError, match="12000 mm above the bed, and the camera is about 250 mm up"):
        track_video(clip.path, clip.mechanism, clip.bed | known | {"marker_height_m": 12}, out_dir=tmp_path)


def test_swapped_marks_are_refused_as_that(clip, tmp_path):
    a, b, *rest = clip.bed["marks"]
    crossed = [a | {"x_m": b["x_m"]}, b | {"x_m": a["x_m"]}, *rest]
    with pytest.raises(TrackingError, match=r"another order round.*Two of them are swapped"):
        track_video(clip.path, clip.mechanism, clip.bed | {"marks": crossed}, out_dir=tmp_path)


def told(clip, folder, bed):
    return " ".join(track_video(clip.path, clip.mechanism, bed, out_dir=folder, preview=False).summary["warnings"])


def test_a_print_of_another_size_is_told_by_the_drawings_lengths(clip, tmp_path):
    assert "Distances are seen 1.2 times as large as they are drawn (base to post 254.3 mm" in told(
        clip, tmp_path, spread(clip.bed, 1.2)
    )


def test_a_bed_of_another_origin_is_told(clip, tmp_path):
    marks = [m | {"x_m": m["x_m"] + 0.5} for m in clip.bed["marks"]]
    assert "The points start 500 mm (median) from where the drawing has them" in told(
        clip, tmp_path, clip.bed | {"marks": marks}
    )


def known_camera(**more):
    """Six marks seen by a camera square to the bed, 0.5 mm a pixel; more: of them, by id."""
    spots = {
        "a": (-0.3, -0.15),
        "b": (0, -0.15),
        "c": (0.3, -0.15),
        "d": (0.3, 0.15),
        "e": (0, 0.16),
        "f": (-0.3, 0.15),
    }
    px = {i: (639.5 + 2e3 * x, 359.5 - 2e3 * y) for i, (x, y) in spots.items()}
    marks = [
        {"id": i, **dict(zip(("x_m", "y_m"), more.get(i, at), strict=True)), "x_px": px[i][0], "y_px": px[i][1]}
        for i, at in spots.items()
    ]
    return read_bed({"marks": marks, "lens": {"focal_px": 1600}, "marker_height_m": 0.0})


def test_marks_that_contradict_each_other_are_refused_with_what_would_mend_them():
    def refused(**more):
        bed = known_camera(**more)
        with pytest.raises(TrackingError, match="contradict each other") as told:
            check_marks(bed, calibrate(bed, 1280, 720), (1280, 720))
        return str(told.value)

    assert "With the places of b and f swapped they agree." in refused(b=(-0.3, 0.15), f=(0, -0.15))
    assert "Without e the others agree" in refused(e=(0.08, 0.16))
    bed = known_camera(e=(0.002, 0.16))
    check_marks(bed, calibrate(bed, 1280, 720), (1280, 720))  # 4 px off, of which a warning tells


def test_where_lens_and_heights_are_known_lengths_three_hundredths_off_are_told():
    seen = 1.03 * fourbar([1.0])[0]
    bars = known_lengths(fourbar_drawing(), Plane(), MARKERS)
    (warning,) = warn_lengths(bars, MARKERS, seen, known_camera())
    assert "Distances are seen 1.03 times as large" in warning
    assert warn_lengths(bars, MARKERS, seen, FLAT) == []  # unknown heights do as much


def test_a_mechanism_that_is_not_the_drawn_one_is_told_by_its_bar():
    seen = fourbar([1.4], (0.16, 0.07, 0.17, 0.12, 0.08, 0.05))[0]  # a crank of 70 mm in place of 60
    bars = known_lengths(fourbar_drawing(), Plane(), MARKERS)
    (warning,) = warn_lengths(bars, MARKERS, seen, FLAT)
    assert "not the one that is drawn: pivot to crankpin 70.0 mm, drawn 60.0 mm" in warning
    assert warn_lengths(bars, MARKERS, fourbar([1.4])[0], FLAT) == []
    assert warn_lengths([Bar(0, 1, 0.06)], MARKERS, np.full((5, 2), np.nan), FLAT) == []


def test_markers_that_are_lost_or_seldom_seen_are_told_with_what_to_do():
    status = np.full((100, 3), "observed", dtype=object)
    status[61:, 0], status[::3, 2], status[1::3, 2] = "occluded", "outlier", "occluded"
    seen = SimpleNamespace(status=status, times_s=np.arange(100) / 240)
    lost, seldom = warn_lost(seen, ["tip", "knee", "heel"], SimpleNamespace(slower=8.0, begins_s=1.0))
    assert lost.startswith("Not seen again: tip after 3.00 s. Look there in the preview")  # as a player shows it
    assert "--to 3.00" in lost
    assert seldom.startswith("Seldom seen: heel (33%) of the pictures.")


def test_a_dark_start_and_a_click_on_nothing_are_told(clip, tmp_path):
    first = next(iter(Video(clip.path)))
    with pytest.raises(TrackingError, match=r"first picture is dark.*--from"):
        learn_look(replace(first, luma=first.luma // 8), 4)
    with pytest.raises(TrackingError, match="base has no pixel"):
        track_video(clip.path, clip.mechanism, clip.bed, out_dir=tmp_path, clicks={"base": (np.nan, 1)})


@pytest.mark.parametrize("way", [None, "texture", "tag"])
def test_a_click_on_what_is_not_drawn_is_refused_however_markers_are_followed(clip, tmp_path, way):
    names = clip.markers_m
    targets = dict(zip(names, range(4), strict=True)) if way == "tag" else way and dict.fromkeys(names, way)
    with pytest.raises(TrackingError, match="unknown markers bse; the drawing has base"):
        track_video(clip.path, clip.mechanism, clip.bed, out_dir=tmp_path, clicks={"bse": (1, 2)}, targets=targets)
