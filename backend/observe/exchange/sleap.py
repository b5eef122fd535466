"""SLEAP's analysis HDF5: dense arrays of pixels and scores.

Pereira et al. (2022), Nature Methods 19, 486.  Written for MATLAB, so the axes run backwards: tracks
(track, xy, node, frame), point_scores (track, node, frame), track_occupancy (frame, track).  Newer files name the
axes in an attribute `dims`, and may order them otherwise.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from backend.observe.exchange.points import Points, checked, listed, told_apart
from backend.observe.tracking_error import TrackingError

AXES = ("track", "xy", "node", "frame")
SURE = 0.2  # SLEAP's own `peak_threshold`
AGAIN = 'Export "Analysis HDF5" from SLEAP again.'


def read_h5(path: Path) -> Points:
    """The tracks of an analysis file.  Raises TrackingError naming the array, its shape and the remedy.

    Tracks that are never seen together are one body that was lost and found: they are joined.
    """
    with h5py.File(path) as file:
        if absent := [key for key in ("tracks", "node_names") if key not in file]:
            raise TrackingError(f"{path.name} has no {listed(absent)}; it holds {listed(list(file))}. {AGAIN}")
        nodes = [_text(name) for name in np.asarray(file["node_names"]).ravel()]
        at = _ordered(file["tracks"], AXES, path.name)
        if at.shape[1] != 2 or at.shape[2] != len(nodes):
            raise TrackingError(
                f"{path.name}: tracks is {' x '.join(map(str, at.shape))}, not track x 2 x node x frame with the "
                f"{len(nodes)} nodes of node_names. {AGAIN}"
            )
        count, frames = at.shape[0], at.shape[3]
        tracks = [_text(name) for name in np.asarray(file["track_names"]).ravel()] if "track_names" in file else []
        score = np.full((count, len(nodes), frames), np.nan)
        if "point_scores" in file:
            score = _ordered(file["point_scores"], ("track", "node", "frame"), path.name)
            _same(score.shape, (count, len(nodes), frames), "point_scores", path.name)
        present = np.any(np.all(np.isfinite(at), axis=1), axis=1).T
        if "track_occupancy" in file:
            occupied = _ordered(file["track_occupancy"], ("frame", "track"), path.name) > 0
            _same(occupied.shape, (frames, count), "track_occupancy", path.name)
            present = present & occupied
    at = np.where(present.T[:, None, None, :], at, np.nan).transpose(3, 0, 2, 1)  # frame, track, node, xy
    score = score.transpose(2, 0, 1)
    notes: tuple[str, ...] = ()
    if count > 1 and (present.sum(1) <= 1).all():
        notes = (f"{path.name}: its {count} tracks never meet and are taken as one body that was lost and found.",)
        owner = present.argmax(1)
        at, score = (a[np.arange(frames), owner][:, None] for a in (at, score))
        count = 1
    tracks = tracks if len(tracks) == count else [f"track_{k}" for k in range(count)]
    names = told_apart(np.repeat(tracks, len(nodes)).tolist(), nodes * count)
    return checked(
        Points(
            source=path.name,
            names=names,
            frame=np.arange(frames),
            at=at.reshape(frames, len(names), 2),
            score=score.reshape(frames, len(names)),
            sure=SURE,
            notes=notes,
        )
    )


def _ordered(stored: Any, axes: tuple[str, ...], name: str) -> np.ndarray:
    """An array with its axes in the order of MATLAB's files."""
    if stored.ndim != len(axes):
        raise TrackingError(
            f"{name}: {stored.name.strip('/')} has shape {stored.shape}, not {' x '.join(axes)}. {AGAIN}"
        )
    array = np.asarray(stored, float)
    try:
        dims = json.loads(_text(stored.attrs["dims"])) if "dims" in stored.attrs else list(axes)
        return array.transpose([dims.index(axis) for axis in axes])
    except (ValueError, AttributeError) as error:
        raise TrackingError(
            f"{name}: {stored.name.strip('/')} names its axes {stored.attrs['dims']!r}, not {listed(axes)}. {AGAIN}"
        ) from error


def _same(found: tuple[int, ...], wanted: tuple[int, ...], what: str, name: str) -> None:
    if found != wanted:
        raise TrackingError(f"{name}: {what} has shape {found}; with its tracks it should be {wanted}. {AGAIN}")


def _text(cell: Any) -> str:
    return cell.decode("utf-8", "replace") if isinstance(cell, bytes) else str(cell)


def write_h5(points: Points, path: Path) -> Path:
    """Write one track over frames 0 to the last, as SLEAP's analysis file for MATLAB; unseen is NaN."""
    frames, nodes = int(points.frame[-1]) + 1, len(points.names)
    at, score = np.full((frames, nodes, 2), np.nan), np.full((frames, nodes), np.nan)
    at[points.frame], score[points.frame] = points.at, points.score
    seen = np.any(np.isfinite(at[..., 0]), axis=1)
    of_frame = np.full(frames, np.nan)
    of_frame[seen] = np.nanmean(np.where(np.isfinite(at[seen, :, 0]), score[seen], np.nan), axis=1)
    dense = {
        "tracks": at.transpose(2, 1, 0)[None],
        "point_scores": score.T[None],
        "instance_scores": of_frame[None],
        "tracking_scores": np.where(seen, 1.0, np.nan)[None],
        "track_occupancy": seen.astype(np.uint8)[:, None],
    }
    with h5py.File(path, "w") as file:
        for key, values in dense.items():
            file.create_dataset(key, data=values, compression="gzip", compression_opts=9)
        file["node_names"] = [np.bytes_(name.encode()) for name in points.names]
        file["track_names"] = [np.bytes_(b"mechanism")]
        file["edge_names"], file["edge_inds"] = np.zeros((0, 2), "S1"), np.zeros((0, 2), np.int64)
        file["labels_path"], file["video_path"], file["video_ind"] = "", points.source, 0
        file["provenance"] = json.dumps({"writer": "linktwin"})
    return path
