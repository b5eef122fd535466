"""From a clip to tracks: read, find, name, follow, place on the bed, say how well."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from backend.observe.account import summarise, warn_height, warn_marks
from backend.observe.bed import Bed, read_bed
from backend.observe.detect import Detections, detect
from backend.observe.dots import DotLook, learn_look
from backend.observe.label import drawn_positions, label_dots
from backend.observe.preview import Preview
from backend.observe.project import AbstractView, calibrate
from backend.observe.track import ConstantVelocity, Tracker
from backend.observe.tracking_error import TrackingError
from backend.observe.uncertainty import point_covariance
from backend.observe.video import Frame, Video
from backend.observe.write import tracks_table, write_tracks

GREATEST_ACCELERATION = 60.0  # m/s^2: six g, beyond what springs and hands do to a linkage on a table
COAST_SHARE = 1 / 3  # a prediction's error, as a part of the greatest that the gate allows


@dataclass(frozen=True)
class TrackResult:
    """Tracks (one row per frame and marker), a summary of plain JSON values, and the files written."""

    tracks: pd.DataFrame
    summary: dict[str, Any]
    tracks_path: Path
    summary_path: Path
    preview_path: Path | None


@dataclass
class _Record:
    """What was seen, frame by frame."""

    times_s: list[float]
    frames: list[int]
    px: list[np.ndarray]
    cov: list[np.ndarray]
    expected: list[np.ndarray]
    status: list[np.ndarray]


def track_video(
    video_path: str | Path,
    mechanism: Any,
    bed_marks: Bed | str | Path | Sequence[Any] | Mapping[str, Any],
    *,
    out_dir: str | Path,
    clicks: Mapping[str, Sequence[float]] | str | Path | None = None,
    keep_truncated: bool = False,
    coast_s: float = 0.0,
    preview: bool = True,
    progress: Callable[[int, int], None] | None = None,
) -> TrackResult:
    """Measure where a mechanism's markers went; writes tracks.csv, tracking.json and preview.mp4 in out_dir.

    mechanism: backend.mechanism's drawing, of which markers and body poses are used.
    bed_marks: see backend.observe.bed.  clicks: marker -> (x, y) [px] in the first picture, or a JSON file.
    keep_truncated: measure the readable part of a file that ends too early.
    coast_s: fill gaps up to this long with predictions, marked `predicted`; without it a hidden dot has no
    coordinates.  progress: called with (frames done, frames in all).
    Raises TrackingError with a sentence where the clip, the marks or the dots cannot be used.
    """
    bed, out = read_bed(bed_marks), Path(out_dir)
    drawn = drawn_positions(mechanism)
    if not drawn:
        raise TrackingError("The drawing has no markers; add a marker for each dot that is to be followed.")
    heights, warnings = _heights(bed, list(drawn))
    video = Video(video_path, keep_truncated)
    pictures = iter(video)
    first = next(pictures, None)
    if first is None:
        raise TrackingError(f"{video.name}: not one frame can be decoded (0 frames read). Copy it again.")
    height_px, width_px = first.luma.shape
    view = _view(bed, width_px, height_px)
    on_bed = bed.plane.from_world(np.array(list(drawn.values())))[:, :2]
    expected = view.pixels(on_bed, heights)
    clicks = _read_clicks(clicks)
    look = learn_look(first, len(drawn), np.array([*clicks.values()], float).reshape(-1, 2))
    found = detect(first, look)
    named = label_dots(dict(zip(drawn, expected, strict=True)), found.px, 2 * look.ring_px, clicks)
    look = replace(look, weight=float(np.median(found.weight[list(named.values())])))
    found = detect(first, look)
    strangers = np.setdiff1d(np.arange(len(found)), list(named.values()))
    if len(strangers):
        warnings.append(f"{len(strangers)} more dots are seen than are drawn; they were followed apart.")
    slope = np.abs(np.linalg.det(view.slope(expected, heights))).mean() ** 0.5  # metres per pixel
    out.mkdir(parents=True, exist_ok=True)
    preview_path = out / "preview.mp4" if preview else None
    painter = Preview(preview_path, video.frames_per_s, (width_px, height_px)) if preview_path else None
    order = np.r_[list(named.values()), strangers].astype(int)
    try:
        seen = _follow(first, pictures, found, order, look, list(drawn), slope, painter, progress, video.frame_count)
    finally:
        if painter:
            painter.close()
    table = _place(seen, list(drawn), look, view, bed, heights, slope, coast_s)
    px = np.concatenate([p[np.isfinite(p[:, 0])] for p in seen.px])
    warnings += video.warnings + warn_height(bed, view, px, width_px) + warn_marks(bed, view)
    summary = summarise(video, table, look, view, bed, slope, len(strangers), warnings, (width_px, height_px))
    tracks_path = write_tracks(table, out / "tracks.csv")
    (out / "tracking.json").write_text(json.dumps(summary, indent=1), encoding="utf-8")
    return TrackResult(table, summary, tracks_path, out / "tracking.json", preview_path)


def _read_clicks(clicks: Mapping[str, Sequence[float]] | str | Path | None) -> dict[str, tuple[float, float]]:
    try:
        given = json.loads(Path(clicks).read_text(encoding="utf-8")) if isinstance(clicks, str | Path) else clicks
        return {str(name): (float(at[0]), float(at[1])) for name, at in (given or {}).items()}
    except (OSError, ValueError, TypeError, IndexError, AttributeError, KeyError) as error:
        raise TrackingError(f'Clicks cannot be read ({error}); write {{"marker": [x_px, y_px]}}.') from error


def _heights(bed: Bed, names: list[str]) -> tuple[np.ndarray, list[str]]:
    """Height of each marker above the marks' plane [m]; zero where unknown."""
    given = bed.marker_height_m
    if isinstance(given, dict):
        if unknown := sorted(set(given) - set(names)):
            raise TrackingError(f"marker_height_m names {', '.join(unknown)}; the drawing has {', '.join(names)}.")
        missing = [n for n in names if n not in given]
        note = [f"No height is given for {', '.join(missing)}; taken as zero."] if missing else []
        return np.array([given.get(n, 0.0) for n in names]), note
    return np.full(len(names), given or 0.0), []


def _view(bed: Bed, width_px: int, height_px: int) -> AbstractView:
    far = [m.id for m in bed.marks if not (-1 < m.x_px < width_px and -1 < m.y_px < height_px)]
    if far:
        raise TrackingError(
            f"Bed marks {', '.join(far)} lie outside the {width_px} x {height_px} picture; "
            "take their pixels from a frame of this clip, as it is shown upright."
        )
    return calibrate(bed, width_px, height_px)


def _follow(
    first: Frame,
    pictures: Any,
    found: Detections,
    order: np.ndarray,
    look: DotLook,
    names: list[str],
    slope: float,
    painter: Preview | None,
    progress: Callable[[int, int], None] | None,
    count: int,
) -> _Record:
    """Carry the names of the first picture through the clip; `order` lists each dot's first detection."""
    own, start = len(names), found.px[order]
    tracker = Tracker(
        ConstantVelocity(first.time_s, start),
        first.time_s,
        len(order),
        1.5 * look.ring_px,
        GREATEST_ACCELERATION / slope,
    )
    seen = _Record([], [], [], [], [], [])
    frame: Frame | None = first
    while frame is not None:
        if frame is first:
            index, expected = order, start
        else:
            found = detect(frame, look)
            index, expected = tracker.follow(frame.time_s, found)
        hit, k = index[:own] >= 0, index[:own]
        px, cov = np.full((own, 2), np.nan), np.full((own, 2, 2), np.nan)
        px[hit], cov[hit] = found.px[k[hit]], found.cov_px2[k[hit]]
        status = np.full(own, "occluded", object)
        status[hit] = np.where(found.whole[k[hit]], "observed", "outlier")
        seen.times_s.append(frame.time_s)
        seen.frames.append(frame.index)
        for column, value in (("px", px), ("cov", cov), ("expected", expected[:own]), ("status", status)):
            getattr(seen, column).append(value)
        if painter:
            painter.show(frame, names, np.where(hit[:, None], px, expected[:own]), status.tolist(), look.ring_px)
        if progress:
            progress(frame.index + 1, count)
        frame = next(pictures, None)
    return seen


def _place(
    seen: _Record,
    names: list[str],
    look: DotLook,
    view: AbstractView,
    bed: Bed,
    heights: np.ndarray,
    slope: float,
    coast_s: float,
) -> pd.DataFrame:
    """Put every point on the bed, with the standard deviation that its pixels' covariance gives it."""
    times, px, status = np.array(seen.times_s), np.array(seen.px), np.array(seen.status)
    whole = status == "observed"
    cov = point_covariance(times, px, np.array(seen.cov), whole)
    partly = status == "outlier"
    # A dot of which half is covered has its centroid 0.42 radii off.
    cov[partly] += (0.5 * look.radius_px) ** 2 * np.eye(2)
    if coast_s > 0:
        last = np.maximum.accumulate(np.where(np.isfinite(px[..., 0]), times[:, None], -np.inf), axis=0)
        gap = times[:, None] - last
        fill = (status == "occluded") & (gap <= coast_s)
        px[fill], status[fill] = np.array(seen.expected)[fill], "predicted"
        drift = COAST_SHARE * 0.5 * GREATEST_ACCELERATION / slope * gap[fill] ** 2
        cov[fill] = (drift**2 + 1.0)[:, None, None] * np.eye(2)
    seen_xy, each = px.reshape(-1, 2), np.tile(heights, len(times))
    world = bed.plane.to_world(view.metres(seen_xy, each))
    world[~np.isfinite(seen_xy[:, 0])] = np.nan
    J = view.slope(seen_xy, each)
    cov_m2 = J @ cov.reshape(-1, 2, 2) @ J.swapaxes(1, 2)
    sigma = np.sqrt(np.trace(cov_m2, axis1=1, axis2=2) / 2)
    shape = whole.shape
    return tracks_table(
        names, times, np.array(seen.frames), world.reshape(*shape, 3), sigma.reshape(shape), px, cov, status
    )
