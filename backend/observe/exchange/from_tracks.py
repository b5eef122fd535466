"""Tracks become the points that other tools read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from jaxtyping import Float, Int

from backend.observe.bed import Bed
from backend.observe.drawn_heights import raised_as_drawn
from backend.observe.exchange import deeplabcut, sleap, trc
from backend.observe.exchange.camera import Footage
from backend.observe.exchange.points import Points, listed
from backend.observe.tracking_error import TrackingError

# Both tools' usual thresholds (0.6 and 0.2) let whole dots through and stop predictions.
SCORES = {"ok": 1.0, "observed": 1.0, "outlier": 0.5, "predicted": 0.1, "occluded": 0.0}
Drawn = dict[str, Float[np.ndarray, "3"]]
SAME_S = 1e-9  # a table's times keep a nanosecond
WRITERS: dict[str, tuple[tuple[str, Callable[[Points, Path], Path]], ...]] = {
    "deeplabcut": (("deeplabcut.csv", deeplabcut.write_csv), ("deeplabcut.h5", deeplabcut.write_h5)),
    "sleap": (("sleap.h5", sleap.write_h5),),
    "trc": (("tracks.trc", trc.write_trc),),
}


def export(
    table: pd.DataFrame, to: str, drawn: Drawn, clip: Footage, bed: Bed | None, folder: Path, source: str
) -> tuple[list[Path], list[str]]:
    """Write a table of tracks for another tool; the files, and what their user should know.

    to: a key of WRITERS.  DeepLabCut and SLEAP take pixels: the table's own, or through `bed`.
    """
    points = _metres(table, source)
    points = (
        _with_depth(_at_one_time(table, points), drawn) if to == "trc" else _pixels(table, points, drawn, clip, bed)
    )
    folder.mkdir(parents=True, exist_ok=True)
    return [write(points, folder / name) for name, write in WRITERS[to]], list(points.notes)


class Grid(NamedTuple):
    """A table by frame and marker; row, marker: where in it each of the table's rows belongs.

    times_s: of each frame, the mean over its points, which a rolling shutter reads one after another.
    """

    names: list[str]
    times_s: Float[np.ndarray, "frame"]
    frame: Int[np.ndarray, "frame"]
    row: Int[np.ndarray, "n"]
    marker: Int[np.ndarray, "n"]


def _grid(table: pd.DataFrame) -> Grid:
    names, own_s = list(dict.fromkeys(table.marker)), table.time_s.to_numpy(float)
    numbered = "frame" in table and np.isfinite(table.frame.to_numpy(float)).all()
    frame, row = np.unique(table.frame.to_numpy(int) if numbered else own_s, return_inverse=True)
    times = np.bincount(row, own_s) / np.bincount(row)
    marker = table.marker.map({name: k for k, name in enumerate(names)}).to_numpy(int)
    return Grid(names, times, frame if numbered else np.arange(len(times)), row, marker)


def _metres(table: pd.DataFrame, source: str) -> Points:
    names, times, frame, row, marker = _grid(table)
    at, score = np.full((len(times), len(names), 3), np.nan), np.zeros((len(times), len(names)))
    at[row, marker] = table[["x_m", "y_m", "z_m"]].to_numpy(float)
    score[row, marker] = table.status.map(SCORES).to_numpy(float) if "status" in table else 1.0
    return Points(source, tuple(names), frame, at, score, times)


def _at_one_time(table: pd.DataFrame, points: Points) -> Points:
    """The points of each frame at its one time: each is carried there by its own velocity, where that is seen."""
    _, times, _, row, marker = _grid(table)
    own_s = np.full(points.at.shape[:2], np.nan)
    own_s[row, marker] = table.time_s.to_numpy(float)
    late = times[:, None] - own_s
    if not len(late) or np.nanmax(np.abs(late)) < SAME_S:
        return points
    velocity = np.zeros_like(points.at)
    velocity[1:-1] = (points.at[2:] - points.at[:-2]) / (own_s[2:] - own_s[:-2])[..., None]
    note = (
        f"Points of one frame are up to {1e3 * np.nanmax(np.ptp(own_s, axis=1)):.1f} ms apart, as their rows are read; "
        "TRC has one time a frame, to which each was carried by its own velocity."
    )
    return replace(points, at=points.at + np.nan_to_num(velocity) * late[..., None], notes=(*points.notes, note))


def _with_depth(points: Points, drawn: Drawn) -> Points:
    """TRC knows no point without a depth: what was not measured is taken from the drawing, and said."""
    flat = np.all(np.isnan(points.at), axis=(0, 1))
    if flat.all():
        raise TrackingError(f"{points.source} holds not one place to write.")
    at, seen = points.at.copy(), np.all(np.isfinite(points.at[..., ~flat]), axis=2)
    expected = np.array([drawn[name] for name in points.names])
    at[..., flat] = np.where(seen[..., None], expected[:, flat], np.nan)
    axes = ", ".join(f"{axis}_m" for axis, unmeasured in zip("xyz", flat, strict=True) if unmeasured)
    note = (f"{axes} was not measured: the TRC file holds the drawn value.",) if axes else ()
    return replace(points, at=at, notes=(*points.notes, *note))


def _pixels(table: pd.DataFrame, points: Points, drawn: Drawn, clip: Footage, bed: Bed | None) -> Points:
    _, times, _, row, marker = _grid(table)
    px = np.full((*points.at.shape[:2], 2), np.nan)
    if {"x_px", "y_px"} <= set(table.columns):
        px[row, marker] = table[["x_px", "y_px"]].to_numpy(float)
    if np.isnan(px).all():
        if bed is None:
            remedy = "Give --bed BED.json, through which metres become pixels."
            raise TrackingError(f"{points.source} holds no pixels (x_px, y_px). {remedy}")
        seen = np.isfinite(points.at).sum(2) >= 2
        markers = list(drawn)
        bed, _ = raised_as_drawn(clip.seen(bed)[0], drawn)
        heights = bed.heights(markers)[0][[markers.index(name) for name in points.names]]
        known = np.where(np.isnan(points.at), np.array(bed.plane.origin_m), points.at)
        on_bed = bed.plane.from_world(known)[..., :2]
        view, _ = clip.view(bed, np.zeros((0, 2)))
        px[seen] = view.pixels(on_bed[seen], np.broadcast_to(heights, seen.shape)[seen])
    uneven = np.ptp(np.diff(times)) > 0.01 * np.median(np.diff(times)) if len(times) > 1 else False
    note = (
        ("Frames are unevenly spaced in time, and these files count frames: keep the clip beside them.",)
        if uneven
        else ()
    )
    return Points(points.source, points.names, points.frame, px, points.score, notes=note)


def known_targets() -> str:
    """The names of what can be written."""
    return listed(["tracks", *WRITERS])
