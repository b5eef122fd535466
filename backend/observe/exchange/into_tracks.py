"""Points tracked elsewhere become tracks: times, places on the bed, status and noise.

A tool's score says whether a point was seen, never how well: networks are sure of places that are pixels off.
The noise is measured along each point's own track, as it is for dots.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from jaxtyping import Float

from backend.observe.account import warn_height, warn_marks, warn_spatial
from backend.observe.bars import known_lengths
from backend.observe.bed import Bed
from backend.observe.camera_in_clip import Shared, shared_error
from backend.observe.drawn_heights import raised_as_drawn
from backend.observe.exchange.camera import Footage
from backend.observe.exchange.points import Points
from backend.observe.flat_mechanism import out_of_plane
from backend.observe.label import drawn_positions
from backend.observe.place import in_world
from backend.observe.rows import Rows
from backend.observe.sense import check_marks, check_units, drawn_extent_m, warn_lengths, warn_start
from backend.observe.tracking_error import TrackingError
from backend.observe.uncertainty import point_covariance, track_noise
from backend.observe.write import tracks_table

FLOOR_M = 1e-5  # no motion capture repeats better; a simulated file has no noise at all
AXES = "Check --names, and that the axes and the origin are those of the drawing."


class IntoTracks(NamedTuple):
    """One row per frame and marker, what its user should know, and what all points seen by a camera have wrong."""

    table: pd.DataFrame
    notes: list[str]
    shared: Shared | None


class Placed(NamedTuple):
    """Points on the bed, (frame, point, ...): their own times, places, deviations, covariance of pixels."""

    own_s: Float[np.ndarray, "frame point"]
    world: Float[np.ndarray, "frame point 3"]
    sigma: Float[np.ndarray, "frame point"]
    cov_px2: Float[np.ndarray, "frame point 2 2"]
    notes: list[str]
    shared: Shared


def into_tracks(
    points: Points, mechanism: Any, clip: Footage, bed: Bed | None, least_score: float | None = None
) -> IntoTracks:
    """The table of tracks.

    points: under the drawing's names.  mechanism: the drawing.  least_score: below it a point
    counts as hidden (default: what the tool itself uses).
    Raises TrackingError where times or places cannot be had.
    """
    sure = points.sure if least_score is None else least_score
    seen = np.isfinite(points.at).all(2) & ~(points.score < sure)
    if not seen.any():
        raise TrackingError(
            f"{points.source}: no point reaches the score {sure:g} (the best is {np.nanmax(points.score):.2f}). "
            "Track again, or lower --least-score."
        )
    points = _to_last(points, seen, clip)
    seen = seen[: len(points.frame)]
    at = np.where(seen[..., None], points.at, np.nan)
    times = points.time_s if points.time_s is not None else clip.times(points.frame, points.source)
    if len(times) < 2:
        raise TrackingError(f"{points.source} holds one frame; motion needs at least two. Export the whole clip.")
    notes = [*points.notes, *clip.warnings]
    status = np.where(seen, "observed", "occluded").astype(object)
    own_s, shared = np.repeat(times[:, None], len(points.names), 1), None
    if points.in_pixels:
        px = at
        own_s, world, sigma, cov, more, shared = _seen_by_camera(points, at, seen, times, mechanism, clip, bed)
        notes += more
        if clip.times_s is not None and len(clip.times_s) > points.frame[-1] + 1:
            notes.append(
                f"{points.source} ends at frame {points.frame[-1]}, {clip.name} at {len(clip.times_s) - 1}: "
                "were empty frames at its start left out, every time is too early."
            )
    else:
        noise = [track_noise(times, at[:, m]) for m in range(at.shape[1])]
        each = [np.nan if c is None else np.sqrt(np.trace(c) / 3 + FLOOR_M**2) for c in noise]
        world, sigma = at, np.where(seen, np.array(each), np.nan)
        px, cov = np.full((*seen.shape, 2), np.nan), np.full((*seen.shape, 2, 2), np.nan)
    cov = np.where(seen[..., None, None], cov, np.nan)
    table = tracks_table(points.names, own_s, points.frame, world, sigma, px, cov, status)
    if not points.in_pixels:
        table = table.drop(columns=[name for name in table.columns if name.endswith(("_px", "_px2"))])
    notes += warn_start(drawn_positions(mechanism), points.names, _first(world), drawn_extent_m(mechanism), AXES)
    return IntoTracks(table, notes, shared)


def _to_last(points: Points, seen: np.ndarray, clip: Footage) -> Points:
    """Without the empty rows that some tools append beyond the clip's end."""
    if clip.times_s is None or points.time_s is not None:
        return points
    last = int(np.flatnonzero(seen.any(1))[-1]) + 1
    inside = int(np.searchsorted(points.frame, len(clip.times_s)))
    keep = max(last, inside)
    return replace(points, frame=points.frame[:keep], at=points.at[:keep], score=points.score[:keep])


def _seen_by_camera(
    points: Points, at: np.ndarray, seen: np.ndarray, times: np.ndarray, mechanism: Any, clip: Footage, bed: Bed | None
) -> Placed:
    if bed is None:
        raise TrackingError(f"{points.source} is in pixels. Give --bed BED.json: marks in metres and pixels, or tags.")
    given = bed.camera
    bed, notes = clip.seen(bed)
    drawn = drawn_positions(mechanism)
    bed, below = raised_as_drawn(bed, drawn)
    markers = list(drawn)
    heights, more = bed.heights(markers)
    more += below
    own = [markers.index(name) for name in points.names]
    px = at[seen]
    view, size_px = clip.view(bed, px)
    check_marks(bed, view, size_px)
    check_units(mechanism, bed, view, heights, size_px)
    cov = point_covariance(times, at, None, seen)  # the tool says nothing of one picture against another
    world, sigma = in_world(at, cov, view, bed, heights[own])
    every = np.full((len(at), len(markers), 2), np.nan)
    every[:, own] = at
    shared = shared_error(given, bed, view, heights, markers, every, size_px, float(np.median(np.diff(times))))
    row = Rows(size_px, clip.quarter_turns).share(np.where(seen[..., None], at, 0))
    own_s = times[:, None] + bed.readout_s * np.clip(row, 0, 1)
    warned = warn_height(bed, view, px, size_px[0]) + warn_marks(bed, view)
    warned += warn_spatial(out_of_plane(mechanism, bed.plane), view, px, size_px[0])
    bars = known_lengths(mechanism, bed.plane, points.names)
    first = bed.plane.from_world(np.nan_to_num(_first(world)))[:, :2]
    warned += warn_lengths(bars, points.names, np.where(np.any(seen, axis=0)[:, None], first, np.nan), bed)
    return Placed(own_s, world, sigma, cov, [*notes, *more, *warned, *shared.notes], shared)


def _first(world: np.ndarray) -> np.ndarray:
    """Each point's first place, (point, 3); NaN for one that is nowhere."""
    seen = np.any(np.isfinite(world), axis=2)
    first = world[np.argmax(seen, axis=0), np.arange(world.shape[1])]
    return np.where(np.any(seen, axis=0)[:, None], first, np.nan)
