"""DeepLabCut's tracks: three header rows (scorer, bodyparts, coords) over x, y and likelihood, in pixels.

Mathis et al. (2018), Nature Neuroscience 21, 1281; Nath et al. (2019), Nature Protocols 14, 2152.  A project of
several animals has a fourth header row, individuals.  The same table is a CSV, or a pandas table in HDF5 under
`df_with_missing`.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from jaxtyping import Float, Int

from backend.observe.exchange.pandas_hdf import Column, kind, read_frame, write_frame
from backend.observe.exchange.points import Points, checked, listed, told_apart
from backend.observe.tracking_error import TrackingError

HEADERS = ("scorer", "bodyparts", "coords")
MANY = ("scorer", "individuals", "bodyparts", "coords")
COORDS = ("x", "y", "likelihood")
SURE = 0.6  # DeepLabCut's own `pcutoff`
SCORER = "linktwin"
KEY = "df_with_missing"
AGAIN = "Export the tracks of the clip again (analyze_videos with save_as_csv)."
AS_CSV = "Save it as CSV (analyze_videos with save_as_csv, or pandas.read_hdf and to_csv) and give that."


def read_csv(path: Path) -> Points:
    """The tracks of a DeepLabCut CSV.  Raises TrackingError naming the row and the remedy."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = [row for row in csv.reader(file) if row]
    except (OSError, UnicodeError, csv.Error) as error:
        raise TrackingError(f"{path.name} cannot be read as CSV ({error}). {AGAIN}") from error
    first = [row[0].strip() for row in rows[:4]]
    headers = MANY if first[1:2] == ["individuals"] else HEADERS
    if tuple(first[: len(headers)]) != headers:
        absent = [name for name in headers if name not in first]
        raise TrackingError(
            f"{path.name} lacks the header row {listed(absent)}: its first rows begin with {listed(first)}, where "
            f"DeepLabCut writes {listed(headers)}. {AGAIN}"
            if absent
            else f"{path.name} has its header rows in the order {listed(first)}, not {listed(headers)}. {AGAIN}"
        )
    body = rows[len(headers) :]
    width = len(rows[len(headers) - 1])
    for number, row in enumerate(rows, start=1):
        if len(row) != width:
            raise TrackingError(f"{path.name}: row {number} has {len(row)} cells, the headers {width}. {AGAIN}")
    columns = tuple(zip(*(row[1:] for row in rows[: len(headers)]), strict=True))
    index = _frames([row[0] for row in body], path.name)
    values = _numbers([row[1:] for row in body], len(columns), len(headers) + 1, path.name)
    return _points(columns, headers, index, values, path.name)


def read_h5(path: Path) -> Points:
    """The tracks of a DeepLabCut HDF5 file, in either of pandas' layouts.  Raises TrackingError."""
    with h5py.File(path) as file:
        tables = [str(key) for key in file if kind(file[key])]
        if len(tables) > 1 and KEY not in tables:
            raise TrackingError(f"{path.name} holds the tables {listed(tables)}, none of them {KEY}. {AS_CSV}")
        if not tables:
            raise TrackingError(f"{path.name} holds no table of pandas; it holds {listed(list(file))}. {AS_CSV}")
        table = read_frame(file[KEY if KEY in tables else tables[0]], path.name, AS_CSV)
    depth = {len(column) for column in table.columns}
    headers = MANY if depth == {4} else HEADERS
    if depth not in ({3}, {4}):
        raise TrackingError(f"{path.name}: its columns have no levels {listed(HEADERS)}. {AS_CSV}")
    index = _frames(table.index.tolist(), path.name)
    return _points(table.columns, headers, index, table.values, path.name)


def _frames(cells: Sequence[Any], name: str) -> Int[np.ndarray, "frame"]:
    try:
        numbers = np.array([float(cell) for cell in cells])
        if not (numbers == np.round(numbers)).all():
            raise ValueError("not whole")
    except (TypeError, ValueError):
        odd = next((c for c in cells if not str(c).strip().isdigit()), "")
        cell = odd.decode("utf-8", "replace") if isinstance(odd, bytes) else odd
        raise TrackingError(
            f"{name}: a row is called {str(cell)[:60]!r}, not by its frame number. Labelled pictures are no tracks: "
            "give what analyze_videos wrote for the clip."
        ) from None
    return numbers.astype(int)


def _numbers(body: list[list[str]], width: int, first_row: int, name: str) -> Float[np.ndarray, "frame column"]:
    try:
        return np.array([[cell or "nan" for cell in row] for row in body], object).astype(float).reshape(-1, width)
    except ValueError:
        for number, row in enumerate(body, start=first_row):
            for cell in row:
                try:
                    float(cell or "nan")
                except ValueError:
                    raise TrackingError(f"{name}: row {number} holds {cell!r}, not a number. {AGAIN}") from None
        raise


def _points(
    columns: Sequence[Column], headers: Sequence[str], index: np.ndarray, values: np.ndarray, name: str
) -> Points:
    where = {column[1:]: k for k, column in enumerate(columns)}
    if len(where) < len(columns):
        raise TrackingError(f"{name}: a column stands twice, or two scorers share the file; keep one. {AGAIN}")
    whose = list(dict.fromkeys(column[:-1] for column in where))
    found = {column[-1] for column in where}
    for part in whose:
        if lacking := [coord for coord in ("x", "y") if (*part, coord) not in where]:
            raise TrackingError(
                f"{name}: {'.'.join(part)} has no column {listed(lacking)}; its coords row names "
                f"{listed(sorted(found))}, where DeepLabCut writes {listed(COORDS)}. {AGAIN}"
            )
    at = np.stack([values[:, [where[*part, c] for part in whose]] for c in ("x", "y")], -1)
    nothing = np.full(len(index), np.nan)
    score = np.stack([values[:, k] if (k := where.get((*p, "likelihood"))) is not None else nothing for p in whose], 1)
    smoothed = "filtered" in Path(name).stem
    note = f"{name} was smoothed (filterpredictions): impacts are blurred; give the file before it." if smoothed else ""
    groups = [part[0] for part in whose] if len(headers) == 4 else [""] * len(whose)
    return checked(
        Points(
            source=name,
            names=told_apart(groups, [part[-1] for part in whose]),
            frame=index,
            at=at,
            score=score,
            sure=SURE,
            notes=(note,) if note else (),
        )
    )


def _columns(points: Points) -> tuple[list[Column], Float[np.ndarray, "frame column"]]:
    columns = [(SCORER, name, coord) for name in points.names for coord in COORDS]
    values = np.concatenate([points.at, points.score[..., None]], axis=2)
    return columns, values.reshape(len(points.frame), -1)


def write_csv(points: Points, path: Path) -> Path:
    """Write pixels and likelihood as DeepLabCut's CSV: the index is the frame, an unseen point is empty."""
    columns, values = _columns(points)
    with path.open("w", encoding="utf-8", newline="") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerows([header, *level] for header, level in zip(HEADERS, zip(*columns, strict=True), strict=True))
        for frame, row in zip(points.frame.tolist(), values.tolist(), strict=True):
            out.writerow([frame, *("" if cell != cell else repr(cell) for cell in row)])
    return path


def write_h5(points: Points, path: Path) -> Path:
    """Write the same as a pandas table under `df_with_missing`."""
    columns, values = _columns(points)
    with h5py.File(path, "w") as file:
        write_frame(file, KEY, columns, HEADERS, points.frame, values)
    return path
