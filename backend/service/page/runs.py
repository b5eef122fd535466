"""Measured runs on their way into a study: what a table holds, and when the mechanism was let go."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from backend.service.problems import Problem

Table = Literal["tracks", "joint_positions", "joint_efforts", "inputs"]
FIRST = 4  # samples that are surely still, of a series that begins at rest
CLEAR = 8.0  # standard deviations of the stillness from which it counts as motion
LEAST_M = 5e-4


@dataclass
class Run:
    """One run. place: where its table lies, or the job that tracked it. released_s: None where it starts in motion."""

    id: str
    table: Table
    source: str
    released_s: float | None
    held_out: bool = False
    chosen: bool = True


def kind_of(path: Path, name: str) -> Table:
    """What a table holds, by its header; Problem where it is none of those a study takes."""
    with path.open(newline="", encoding="utf-8-sig", errors="replace") as file:
        try:
            head = {cell.strip() for cell in next(csv.reader(file), [])}
        except csv.Error as error:
            raise Problem("invalid", f"{name} is no table ({error}); save it as CSV, columns named first.") from None
    if {"time_s", "marker"} <= head:
        return "tracks"
    if {"time_s", "joint", "q"} <= head:
        return "joint_positions"
    if {"time_s", "joint", "effort"} <= head:
        return "joint_efforts"
    if {"time_s", "effect", "parameter", "value"} <= head:
        return "inputs"
    raise Problem(
        "invalid",
        f"{name}: its columns ({', '.join(sorted(head)[:12]) or 'none'}) are neither tracks (time_s, marker, x_m, y_m, "
        "z_m) nor encoders (time_s, joint, q). linktwin convert turns other tools' files into tracks.",
    )


def released(path: Path, table: Table) -> float | None:
    """When it was let go, from the first motion; None where it moves from the first sample on.

    From rest the way grows with the square of time, so two ways of which one is four times the other tell the start.
    """
    series = _series(path, table)
    if not series:
        return None
    found = [at for t, way in series if (at := _start(t, way, LEAST_M if table == "tracks" else 2e-3)) is not None]
    return round(min(found), 4) if found else None


def _start(t: np.ndarray, way: np.ndarray, least: float) -> float | None:
    if len(t) < 4 * FIRST:
        return None
    noise = float(np.sqrt(np.mean(way[:FIRST] ** 2)))
    near = max(least, CLEAR * noise)
    moved = np.flatnonzero(way > near)
    far = np.flatnonzero(way > 4 * near)
    if not len(moved) or not len(far) or moved[0] < FIRST:
        return None
    return float(max(t[0], 2 * t[moved[0]] - t[far[0]]))


def _series(path: Path, table: Table) -> list[tuple[np.ndarray, np.ndarray]]:
    """Per marker or joint: times, and how far it is from where it began."""
    key, columns = ("marker", ("x_m", "y_m", "z_m")) if table == "tracks" else ("joint", ("q",))
    rows: dict[str, list[list[float]]] = {}
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            for row in csv.DictReader(file):
                values = [float(row[c]) if row.get(c) else 0.0 for c in columns]
                if any(row.get(c) for c in columns):
                    rows.setdefault(row[key], []).append([float(row["time_s"]), *values])
    except (ValueError, KeyError, TypeError, csv.Error):
        return []  # reading the study will say what is wrong, and in which row
    made = []
    for table_rows in rows.values():
        values = np.array(table_rows)
        way = values[:, 1:] - np.median(values[:FIRST, 1:], axis=0)
        made.append((values[:, 0], np.linalg.norm(way, axis=1)))
    return made
