"""A clip with its tracks drawn over it."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

from nicegui.element import Element


class Film(Element, component="film.js"):
    """clip, preview: addresses of the clip and of the tracker's annotated one. tracks: from `film_tracks`.

    begins_s: where in the clip, as a player shows it, they begin. slower: how many times slower it plays than it was
    filmed.
    """

    def __init__(
        self, clip: str, preview: str, tracks: dict[str, Any], begins_s: float = 0.0, slower: float = 1.0
    ) -> None:
        super().__init__()
        self._props["clip"] = clip
        self._props["preview"] = preview
        self._props["tracks"] = tracks
        self._props["begins"] = begins_s
        self._props["slower"] = slower


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
