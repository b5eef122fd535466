"""A clip with its tracks drawn over it."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

from nicegui.element import Element


class Film(Element, component="film.js"):
    """clip, preview: addresses of the clip and of the tracker's annotated one. tracks: from `film_tracks`."""

    def __init__(self, clip: str, preview: str, tracks: dict[str, Any]) -> None:
        super().__init__()
        self._props["clip"] = clip
        self._props["preview"] = preview
        self._props["tracks"] = tracks


def film_tracks(path: Path) -> dict[str, Any]:
    """Per marker where it is in every frame [px] (null where it was not seen) and its status, from a tracks.csv."""
    times: dict[float, int] = {}
    rows: list[tuple[int, str, list[float] | None, str]] = []
    with path.open(newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            k = times.setdefault(float(row["time_s"]), len(times))
            seen = bool(row.get("x_px")) and bool(row.get("y_px"))
            spot = [round(float(row["x_px"]), 2), round(float(row["y_px"]), 2)] if seen else None
            rows.append((k, row["marker"], spot, row.get("status") or "observed"))
    markers: dict[str, dict[str, list[Any]]] = {}
    for k, marker, spot, status in rows:
        track = markers.setdefault(marker, {"px": [None] * len(times), "status": ["occluded"] * len(times)})
        track["px"][k], track["status"][k] = spot, status
    return {"time_s": list(times), "markers": markers}
