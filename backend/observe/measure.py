"""From a clip to tracks: read, find, name, follow, place on the bed, say how well."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from backend.observe.account import (
    summarise,
    warn_blank,
    warn_height,
    warn_lens,
    warn_lost,
    warn_marks,
    warn_spatial,
    warn_stick,
)  # fmt: skip
from backend.observe.assembly import assembling_of
from backend.observe.bars import known_lengths
from backend.observe.bed import Bed, read_bed, spare_camera
from backend.observe.camera import CAMERA, warn_stale, write_camera
from backend.observe.camera_in_clip import shared_error
from backend.observe.carried import TEXTURE, GivenTargets, Untagged, read_targets
from backend.observe.cotracker import cotracker, rough_paths
from backend.observe.drawn_heights import raised_as_drawn
from backend.observe.flat_mechanism import out_of_plane
from backend.observe.follow_bed import BedWatch, ShakenView, settle
from backend.observe.kinematics import kinematics_of
from backend.observe.label import check_clicked, drawn_positions
from backend.observe.place import Record, place
from backend.observe.preview import Preview
from backend.observe.project import AbstractView, view_in_picture
from backend.observe.readout import dated, error_of_readout_m, readout_of
from backend.observe.rows import Rows
from backend.observe.seen_bed import bed_in_picture
from backend.observe.sense import check_marks, check_units, drawn_extent_m, warn_lengths, warn_start
from backend.observe.targets import DotTargets, TagTargets, Targets
from backend.observe.texture import TextureTargets
from backend.observe.track import ConstantVelocity, Linked
from backend.observe.tracking_error import TrackingError
from backend.observe.video import WHOLE, Frame, Part, Video
from backend.observe.write import write_tracks

GREATEST_ACCELERATION = 60.0  # m/s^2: six g, beyond what springs and hands do to a linkage on a table

UNCARRIED = (
    "The camera moved, so no camera.json stands beside the tracks: a fit does not carry how well lens and poses are "
    "known unless the study states the tolerances of tracking.json, or frees camera_scale and camera_rotation."
)
FOLLOWED = (
    "Markers were followed by their surroundings, from where the drawing or a click puts them in the first picture: an "
    "error there stays for the whole clip. Free marker_offset in a fit."
)
START = "Check that the bed file's origin and axes are the drawing's, and that the clip begins near the drawn pose."


@dataclass(frozen=True)
class TrackResult:
    """Tracks (one row per frame and marker), a summary of plain JSON values, the files written, and whether the camera
    moved: then every picture has a view of its own.
    """

    tracks: pd.DataFrame
    summary: dict[str, Any]
    tracks_path: Path
    summary_path: Path
    preview_path: Path | None
    shaken: bool = False


def track_video(
    video_path: str | Path,
    mechanism: Any,
    bed_marks: Bed | str | Path | Sequence[Any] | Mapping[str, Any],
    *,
    out_dir: str | Path,
    clicks: Mapping[str, Sequence[float]] | str | Path | None = None,
    targets: GivenTargets = None,
    checkpoint: str | Path | None = None,
    keep_truncated: bool = False,
    part: Part = WHOLE,
    coast_s: float = 0.0,
    preview: bool = True,
    progress: Callable[[int, int], None] | None = None,
) -> TrackResult:
    """Measure where a mechanism's markers went; writes tracks.csv, tracking.json and preview.mp4 in out_dir.

    mechanism: backend.mechanism's drawing, of which markers and body poses are used.
    bed_marks: see backend.observe.bed.  clicks: marker -> (x, y) [px] in the first picture, or a JSON file.
    targets: marker -> number of the tag that it carries in place of a dot ("aruco_4x4_50:3" of another family), or
    "texture" where nothing is stuck on any marker, or "dark" where all are dots without a colour, "patch" where all are
    coloured areas of any shape; or a
    JSON file.  checkpoint: of CoTracker, to say where textures are to be looked for.
    keep_truncated: measure the readable part of a file that ends too early.  part: what of the clip counts.
    coast_s: fill gaps up to this long with predictions, marked `predicted`; without it a hidden dot has no
    coordinates.  progress: called with (frames done, frames in all).
    Raises TrackingError with a sentence where the clip, the marks or the dots cannot be used.
    """
    bed, out = read_bed(bed_marks), Path(out_dir)
    spare_camera(bed_marks, out)
    drawn = drawn_positions(mechanism)
    if not drawn:
        raise TrackingError("The drawing has no markers; add a marker for each dot that is to be followed.")
    video = Video(video_path, keep_truncated, part)
    pictures = iter(video)
    first = next(pictures, None)
    if first is None:
        raise TrackingError(f"{video.name}: not one frame can be decoded (0 frames read). Copy it again.")
    height_px, width_px = first.luma.shape
    given = bed.camera
    bed, told = bed_in_picture(bed, first.luma)
    bed, below = raised_as_drawn(bed, drawn)
    heights, warnings = bed.heights(list(drawn))
    warnings += told + below
    view = view_in_picture(bed, width_px, height_px)
    on_bed = bed.plane.from_world(np.array(list(drawn.values())))[:, :2]
    check_marks(bed, view, (width_px, height_px))
    check_units(mechanism, bed, view, heights, (width_px, height_px))
    expected = view.pixels(on_bed, heights)
    clicks = _read_clicks(clicks)
    check_clicked(clicks, list(drawn))
    tags = read_targets(targets, list(drawn))
    if clicks and isinstance(tags, dict):
        warnings.append(f"Tags name themselves: the clicks for {', '.join(clicks)} are left out.")
    places = dict(zip(drawn, expected, strict=True))
    textured = tags if isinstance(tags, Untagged) and tags.way == TEXTURE else None
    if checkpoint and not textured:
        raise TrackingError('A CoTracker checkpoint serves bare markers alone; say {"marker": "texture"} of each.')
    if textured:
        begun = np.array([clicks.get(name, px) for name, px in places.items()], float)
        again = Video(video_path, keep_truncated, part)
        paths = rough_paths(cotracker(checkpoint), again, begun) if checkpoint else None
        on_pins: Targets = TextureTargets(first, dict(zip(drawn, begun, strict=True)), textured.reach_px, paths)
        warnings.append(FOLLOWED)
    elif isinstance(tags, dict):
        on_pins = TagTargets(first, tags)
    else:
        assembling = assembling_of(mechanism, bed.plane, view, heights)
        on_pins = DotTargets(first, places, clicks, tags.way if tags else "", assembling)
    if on_pins.strangers:
        warnings.append(f"{on_pins.strangers} more dots are seen than are drawn; they were followed apart.")
    slope = np.abs(np.linalg.det(view.slope(expected, heights))).mean() ** 0.5  # metres per pixel
    out.mkdir(parents=True, exist_ok=True)
    preview_path = out / "preview.mp4" if preview else None
    start_px = on_pins.found.px[on_pins.order]
    each = ConstantVelocity(first.time_s, start_px, GREATEST_ACCELERATION / slope)
    at = view.metres(start_px[: len(drawn)], heights)
    bars = known_lengths(mechanism, bed.plane, list(drawn))
    warnings += warn_lengths(bars, list(drawn), at, bed)
    warnings += warn_start(drawn, list(drawn), bed.plane.to_world(at), drawn_extent_m(mechanism), START)
    together = kinematics_of(mechanism, bed.plane, first.time_s, at)
    on_pins.start(Linked(each, together, view, heights) if together else each)
    watch = BedWatch(bed.pixels(), first.luma, video.frame_count)
    size_px, marks = (width_px, height_px), bed
    with Preview(preview_path, video.frames_per_s, size_px) if preview_path else nullcontext() as painter:
        seen = _follow(first, pictures, on_pins, list(drawn), watch, painter, progress, video.frame_count)
    rows = Rows(size_px, first.quarter_turns)
    bed, shaken = settle(marks, watch.result(), seen.times_s, rows)
    view = view_in_picture(bed, *size_px)
    readout = None
    if bed.lens:
        for _ in range(2 if shaken else 1):  # a camera that moved is itself found through the readout
            at, row = _on_bed(seen, view, heights, bed.readout_s, rows, shaken)
            readout = readout_of(seen.times_s, at, row, bars)
            dated_marks, told = dated(marks, readout)
            bed, shaken = settle(dated_marks, watch.result(), seen.times_s, rows)
        warnings += told
    bodies = [marker.body for marker in mechanism.markers]
    table = place(seen, list(drawn), on_pins.radius_px, view, bed, heights, coast_s, rows, bodies, shaken)
    if shaken:
        warnings.append("The camera moved; every picture has its own pose, from the bed marks seen in it.")
    px = seen.px[np.isfinite(seen.px[..., 0])]
    warnings += video.warnings + warn_height(bed, view, px, width_px) + warn_marks(bed, view)
    warnings += warn_spatial(out_of_plane(mechanism, bed.plane), view, px, width_px)
    warnings += warn_stick(bed, view, px, width_px) + warn_blank(watch.followable) + warn_lost(seen, list(drawn), video)
    shared = shared_error(given, bed, view, heights, list(drawn), seen.px, size_px, 1 / video.frames_per_s)
    shared_m = shared.sd_m
    if readout and bed.readout_s == readout.seconds:
        at, row = _on_bed(seen, view, heights, bed.readout_s, rows, shaken)
        shared_m = float(np.hypot(shared_m, error_of_readout_m(seen.times_s, at, row, readout.sd_s)))
    summary = summarise(video, table, on_pins, view, bed, slope, warnings, shared_m)
    if readout:
        summary["readout"] = {"used_s": bed.readout_s, "seen_s": readout.seconds, "sd_s": readout.sd_s}
    if shared.camera and not shaken:  # one pose for the whole clip, from its marks
        summary["warnings"] += shared.notes
        summary["tolerances"] = list(shared.tolerances)
        write_camera(shared.camera, out / CAMERA)
    else:
        summary["warnings"] += warn_lens(shared.unknown_lens_m) + warn_stale(out)
    if shared.camera and shaken:
        summary["warnings"].append(UNCARRIED)
        summary["tolerances"] = list(shared.tolerances)
    tracks_path = write_tracks(table, out / "tracks.csv")
    (out / "tracking.json").write_text(json.dumps(summary, indent=1), encoding="utf-8")
    return TrackResult(table, summary, tracks_path, out / "tracking.json", preview_path, shaken is not None)


def _read_clicks(clicks: Mapping[str, Sequence[float]] | str | Path | None) -> dict[str, tuple[float, float]]:
    try:
        given = json.loads(Path(clicks).read_text(encoding="utf-8")) if isinstance(clicks, str | Path) else clicks
        read = {str(name): (float(at[0]), float(at[1])) for name, at in (given or {}).items()}
        if wrong := [name for name, at in read.items() if not np.isfinite(at).all()]:
            raise ValueError(f"{', '.join(wrong)} has no pixel")
        return read
    except (OSError, ValueError, TypeError, IndexError, AttributeError, KeyError) as error:
        raise TrackingError(f'Clicks cannot be read ({error}); write {{"marker": [x_px, y_px]}}.') from error


def _on_bed(
    seen: Record, view: AbstractView, heights_m: np.ndarray, readout_s: float, rows: Rows, shaken: ShakenView | None
) -> tuple[np.ndarray, np.ndarray]:
    """Places [m] of points called observed, NaN else, and their rows, 0 first and 1 last: (frame, marker, ...)."""
    at, row = np.full(seen.px.shape, np.nan), rows.share(seen.px)
    frame, marker = np.nonzero(seen.status == "observed")
    px, height = seen.px[frame, marker], heights_m[marker]
    own_s = seen.times_s[frame] + readout_s * row[frame, marker]
    at[frame, marker] = shaken.metres(px, height, frame, own_s) if shaken else view.metres(px, height)
    return at, row


def _follow(
    first: Frame,
    pictures: Any,
    targets: Targets,
    names: list[str],
    watch: BedWatch,
    painter: Preview | None,
    progress: Callable[[int, int], None] | None,
    count: int,
) -> Record:
    """Carry the names of the first picture through the clip."""
    own, seen = len(names), Record(count, len(names))
    frame: Frame | None = first
    while frame is not None:
        if frame is first:
            found, index = targets.found, targets.order
            expected, reach = found.px[index], np.zeros(len(index))
        else:
            found, index, (expected, reach) = targets.step(frame)
        watch.look(frame.luma)
        seen.add(frame.time_s, frame.index, index[:own], found, expected[:own], reach[:own])
        if painter:
            shown = np.where(index[:own, None] >= 0, seen.px[-1], expected[:own])
            painter.show(frame, names, shown, seen.status[-1].tolist(), 1.5 * targets.radius_px)
        if progress:
            progress(frame.index - first.index + 1, count)
        frame = next(pictures, None)
    return seen
