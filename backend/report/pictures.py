"""Linked pictures as data: motions and charts that share one clock, in pictures.json, for whoever plays them back.

Lengths in metres, quaternions [w, x, y, z], forces in newtons, all in W; arrays of vectors are flat.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from backend.report.chart import Chart
from backend.report.evidence import Motion, Overlay

FRAMES = 720  # of one motion: between two of them the browser interpolates
SEEN = 1200  # instants at which markers were seen
PLACES_M, PLACES_Q, DIGITS_N = 7, 6, 5


@dataclass(frozen=True)
class Linked:
    """A chart and the clock it follows.

    group: under which heading it stands. run: name of the motion; empty where it follows none. offset_s: what has to be
    added to its own time to have the motion's.
    """

    chart: Chart
    group: str
    run: str = ""
    offset_s: float = 0.0


@dataclass(frozen=True)
class Pictures:
    """What one result shows. twin: what the moving bodies are called. forces_n: run -> joint -> force on body B (t, 3).

    story: words and numbers of the result, ready for JSON.
    """

    kind: str
    overlays: Sequence[Overlay] = ()
    charts: Sequence[Linked] = ()
    twin: str = "twin"
    forces_n: Mapping[str, Mapping[str, Float[np.ndarray, "t 3"]]] = field(default_factory=dict)
    story: Mapping[str, Any] = field(default_factory=dict)


def write_pictures(pictures: Pictures, path: str | Path) -> Path:
    """Write pictures.json; returns its path."""
    path = Path(path)
    document = {
        "schema_version": "1.0",
        "kind": pictures.kind,
        "story": dict(pictures.story),
        "motions": [
            _motion(overlay, pictures.twin, pictures.forces_n.get(overlay.experiment, {}))
            for overlay in pictures.overlays
            if len(overlay.after.time_s) > 1
        ],
        "charts": [
            {"group": c.group, "run": c.run, "offset_s": c.offset_s, "svg": str(c.chart.svg())} for c in pictures.charts
        ],
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(document, ensure_ascii=False, separators=(",", ":"), allow_nan=False), encoding="utf-8")
    return path


def _motion(overlay: Overlay, twin: str, forces: Mapping[str, np.ndarray]) -> dict[str, Any]:
    after = overlay.after
    count = _followed(after)
    nodes = np.unique(np.linspace(0, count - 1, min(count, FRAMES)).round().astype(int))
    times = np.asarray(after.time_s)[nodes]
    made: dict[str, Any] = {
        "name": overlay.experiment,
        "twin": twin,
        "time_s": _rounded(times, 6),
        "after": _tracks(after, times),
        "extent_m": _extent(after, nodes),
    }
    if overlay.before is not None:
        made["before"] = _tracks(overlay.before, times)
    if overlay.seen_m and len(overlay.seen_time_s):
        made["seen"] = _seen(overlay)
    if forces:
        made["forces_n"] = {
            joint: [_significant(v) for v in np.nan_to_num(np.asarray(f)[nodes]).ravel()] for joint, f in forces.items()
        }
    return made


def _followed(motion: Motion) -> int:
    """How many frames there are before the motion was lost."""
    good = np.isfinite(np.asarray(motion.time_s))
    for p, q in zip(motion.position_m.values(), motion.quaternion_wxyz.values(), strict=True):
        good &= np.isfinite(p).all(-1) & np.isfinite(q).all(-1)
    return len(good) if good.all() else max(int(np.argmin(good)), 1)


def _tracks(motion: Motion, times: Float[np.ndarray, " n"]) -> dict[str, dict[str, list[float]]]:
    """Every body at the given times; past the end of a motion that was lost it stays where it was."""
    count = _followed(motion)
    at = np.clip(np.searchsorted(motion.time_s[:count], times - 1e-9), 0, count - 1)
    tracks = {}
    for body, p in motion.position_m.items():
        q = _steady(np.asarray(motion.quaternion_wxyz[body])[at])
        tracks[body] = {"position_m": _rounded(p[at], PLACES_M), "quaternion_wxyz": _rounded(q, PLACES_Q)}
    return tracks


def _steady(q: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 4"]:
    """Signs without jumps: q and -q are one rotation, but no line leads from one to the other."""
    flips = np.where(np.einsum("ij,ij->i", q[1:], q[:-1]) < 0.0, -1.0, 1.0)
    return q * np.concatenate([[1.0], np.cumprod(flips)])[:, None]


def _extent(motion: Motion, nodes: np.ndarray) -> list[list[float]]:
    """Two corners of the box that all body origins keep to."""
    points = np.concatenate([np.asarray(p)[nodes] for p in motion.position_m.values()] or [np.zeros((1, 3))])
    return [_rounded(points.min(0), 6), _rounded(points.max(0), 6)]


def _seen(overlay: Overlay) -> dict[str, Any]:
    keep = slice(None, None, math.ceil(len(overlay.seen_time_s) / SEEN))
    return {
        "time_s": _rounded(np.asarray(overlay.seen_time_s)[keep], 6),
        "markers": {
            marker: [_rounded(row, PLACES_M) if np.isfinite(row).all() else None for row in np.asarray(p)[keep]]
            for marker, p in overlay.seen_m.items()
        },
    }


def _rounded(values: Iterable[float] | np.ndarray, places: int) -> list[float]:
    return np.round(np.asarray(values, float), places).ravel().tolist()


def _significant(value: float) -> float:
    return float(f"{value:.{DIGITS_N}g}")
