"""From a file of tracks to another: whatever wrote it becomes a table of tracks, which any tool is then given."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from backend.mechanism.tracks import read_table
from backend.observe.account import status_counts
from backend.observe.bed import Bed, read_bed, spare_camera
from backend.observe.camera import CAMERA, warn_stale, write_camera
from backend.observe.exchange.camera import footage
from backend.observe.exchange.formats import OURS, format_of, read_points
from backend.observe.exchange.from_tracks import WRITERS, export, known_targets
from backend.observe.exchange.into_tracks import into_tracks
from backend.observe.label import drawn_positions
from backend.observe.tracking_error import TrackingError
from backend.observe.write import write_tracks


@dataclass(frozen=True)
class Converted:
    """Tracks (one row per frame and marker), a summary of plain JSON values, and the files written."""

    tracks: pd.DataFrame
    summary: dict[str, Any]
    files: list[Path]


def convert(
    path: str | Path,
    mechanism: Any,
    *,
    out_dir: str | Path,
    to: str = "tracks",
    bed: Bed | str | Path | Sequence[Any] | Mapping[str, Any] | None = None,
    video: str | Path | None = None,
    frames_per_s: float | None = None,
    filmed_per_s: float | None = None,
    names: str | Mapping[str, str] = "",
    least_score: float | None = None,
) -> Converted:
    """Read tracks of any known format and write them in another.

    mechanism: backend.mechanism's drawing.  to: tracks, deeplabcut, sleap or trc.  bed: marks through which pixels
    become metres.  video: the clip, for its clock and size; frames_per_s: its rate [1/s] where there is no clip.
    filmed_per_s: the rate [1/s] at which slow motion was filmed, of a clip that does not note it.
    names: theirs -> ours, or "theirs=ours,...".  least_score: below it a point counts as hidden.
    Raises TrackingError (DrawingError for linktwin's own tables) with a sentence where something is missing or wrong.
    """
    path, folder = Path(path), Path(out_dir)
    if to != "tracks" and to not in WRITERS:
        raise TrackingError(f"--to {to} is unknown; write one of {known_targets()}.")
    drawn = drawn_positions(mechanism)
    if not drawn:
        raise TrackingError("The drawing has no markers; add a marker for each point that was tracked.")
    wrote, renaming = format_of(path), names if isinstance(names, Mapping) else parse_names(names)
    marks = None if bed is None else read_bed(bed)
    if to == "tracks":
        spare_camera(bed, folder)
    clip = footage(None if video is None else Path(video), frames_per_s, filmed_per_s)
    if wrote == OURS:
        if to == "tracks":
            raise TrackingError(f"{path.name} is linktwin's own already: a study reads it as it is. Write --to FORMAT.")
        if renaming or frames_per_s is not None or filmed_per_s is not None:
            raise TrackingError(f"{path.name} has its own names and times; leave --names, --fps and --filmed-at out.")
        tracks, notes, shared = read_table("tracks", path, mechanism), [], None
    else:
        points = read_points(path)
        if points.time_s is not None and (frames_per_s is not None or filmed_per_s is not None):
            raise TrackingError(f"{path.name} carries its own times; leave --fps and --filmed-at out.")
        points = points.renamed(renaming, list(drawn))
        tracks, notes, shared = into_tracks(points, mechanism, clip, marks, least_score)
    if to == "tracks":
        folder.mkdir(parents=True, exist_ok=True)
        files = [write_tracks(tracks, folder / "tracks.csv")]
        if shared and shared.camera:
            files.append(write_camera(shared.camera, folder / CAMERA))
        else:
            notes += warn_stale(folder)
    else:
        files, more = export(tracks, to, drawn, clip, marks, folder, path.name)
        notes += more
    summary = _summary(path.name, wrote, to, tracks, notes)
    if shared:
        summary["calibration_sd_m"] = shared.sd_m
    if shared and shared.camera:
        summary["tolerances"] = list(shared.tolerances)
    return Converted(tracks, summary, files)


def parse_names(text: str) -> dict[str, str]:
    """`theirs=ours,...` as a mapping.  Raises TrackingError."""
    pairs = [pair.split("=") for pair in text.split(",") if pair.strip()]
    if wrong := ["=".join(pair) for pair in pairs if len(pair) != 2 or not pair[0].strip()]:
        raise TrackingError(f"--names {wrong[0]!r} is no pair; write theirs=ours, separated by commas.")
    return {theirs.strip(): ours.strip() for theirs, ours in pairs}


def _summary(source: str, wrote: str, to: str, tracks: pd.DataFrame, notes: list[str]) -> dict[str, Any]:
    first = tracks[tracks.marker == tracks.marker.iloc[0]]
    times = np.unique(first.time_s.to_numpy(float))  # of one marker: rows of a picture may be read one after another
    return {
        "source": source,
        "format": wrote,
        "to": to,
        "frames": len(times),
        "frames_per_s": float(1 / np.median(np.diff(times))) if len(times) > 1 else None,
        "duration_s": float(np.ptp(tracks.time_s.to_numpy(float))),
        "markers": status_counts(tracks),
        "warnings": notes,
    }
