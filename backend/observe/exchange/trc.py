"""TRC (Track Row Column), the marker files of Motion Analysis, Vicon and OpenSim: text, tabs, metres or millimetres.

Three rows of header, a row of marker names (each over its X column), a row X1 Y1 Z1 X2 ..., an empty row, then one
row a frame: number, time [s], coordinates (OpenSim documentation, "Marker (.trc) Files").
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from backend.observe.exchange.points import Points, checked, listed
from backend.observe.tracking_error import TrackingError

METRES = {"m": 1.0, "meters": 1.0, "cm": 1e-2, "mm": 1e-3, "millimeters": 1e-3}
AGAIN = "Export it again from the capture software."


def read_trc(path: Path) -> Points:
    """The markers of a TRC file in metres, in the axes of the file.  Raises TrackingError with row and remedy.

    An empty cell, or NaN, is a marker not seen.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig", errors="replace").splitlines()
    except OSError as error:
        raise TrackingError(f"{path.name} cannot be read ({error.strerror}). {AGAIN}") from error
    if not lines or not lines[0].startswith("PathFileType") or len(lines) < 5:
        raise TrackingError(f"{path.name} is no TRC file: its first row does not begin with PathFileType. {AGAIN}")
    header = dict(zip(lines[1].split(), lines[2].split(), strict=False))
    unit = header.get("Units", "").lower()
    if unit not in METRES:
        raise TrackingError(
            f"{path.name}: Units is {header.get('Units') or 'missing'!r}; it must be one of {listed(sorted(METRES))}. "
            "Correct it in the file's third row."
        )
    titles = lines[3].split("\t")
    if [title.strip().lower()[:4] for title in titles[:2]] != ["fram", "time"]:
        raise TrackingError(f"{path.name}: row 4 begins with {titles[:2]}, not Frame# and Time. {AGAIN}")
    names = tuple(title.strip() for title in titles[2:] if title.strip())
    promised = header.get("NumMarkers", "")
    if promised.isdigit() and int(promised) != len(names):
        raise TrackingError(f"{path.name}: NumMarkers is {promised}, but row 4 names {len(names)} markers. {AGAIN}")
    body = [(number, line) for number, line in enumerate(lines[5:], start=6) if line.strip()]
    values = np.full((len(body), 2 + 3 * len(names)), np.nan)
    for row, (number, line) in enumerate(body):
        cells = [cell.strip() for cell in (line.split("\t") if "\t" in line else line.split())]
        while len(cells) > values.shape[1] and not cells[-1]:
            cells.pop()
        if len(cells) > values.shape[1]:
            needed = f"{len(names)} markers need {values.shape[1]}"
            raise TrackingError(f"{path.name}: row {number} has {len(cells)} cells; {needed}. {AGAIN}")
        try:
            values[row, : len(cells)] = [float(cell or "nan") for cell in cells]
        except ValueError as error:
            raise TrackingError(f"{path.name}: row {number}: {error}. {AGAIN}") from None
    times = values[:, 1]
    untimed = np.flatnonzero(~np.isfinite(values[:, :2]).all(1))
    if len(untimed):
        raise TrackingError(f"{path.name}: row {body[untimed[0]][0]} has no frame number or no time. {AGAIN}")
    back = np.flatnonzero((np.diff(times) <= 0) | (np.diff(values[:, 0]) <= 0))
    if len(back):
        k = int(back[0])
        raise TrackingError(
            f"{path.name}: row {body[k + 1][0]} (frame {values[k + 1, 0]:g}, {times[k + 1]:g} s) stands after frame "
            f"{values[k, 0]:g} at {times[k]:g} s. Sort the rows by frame, one row a frame."
        )
    at = METRES[unit] * values[:, 2:].reshape(len(body), len(names), 3)
    at[~np.isfinite(at).all(2)] = np.nan
    promised = header.get("NumFrames", "")
    short = promised.isdigit() and int(promised) != len(body)
    frame = values[:, 0].astype(int)
    return checked(
        Points(
            source=path.name,
            names=names,
            frame=frame - min(1, int(frame[0]) if len(frame) else 0),  # TRC counts from 1
            at=at,
            score=np.full(at.shape[:2], np.nan),
            time_s=times,
            notes=(f"{path.name} promises {promised} frames and holds {len(body)}.",) if short else (),
        )
    )


def write_trc(points: Points, path: Path) -> Path:
    """Write metres in W as a TRC file in millimetres, to a nanometre; a marker not seen is left empty."""
    if points.time_s is None or points.in_pixels:
        raise TrackingError(f"{points.source} has no metres and times to write as TRC.")
    count, names = len(points.frame), points.names
    rate = 1 / float(np.median(np.diff(points.time_s))) if count > 1 else 1.0
    titles = "DataRate CameraRate NumFrames NumMarkers Units OrigDataRate OrigDataStartFrame OrigNumFrames"
    facts = (f"{rate:.6g}", f"{rate:.6g}", count, len(names), "mm", f"{rate:.6g}", points.frame[0] + 1, count)
    rows = [
        f"PathFileType\t4\t(X/Y/Z)\t{path.name}",
        titles.replace(" ", "\t"),
        "\t".join(map(str, facts)),
        "Frame#\tTime\t" + "\t\t\t".join(names) + "\t\t",
        "\t\t" + "\t".join(f"X{k}\tY{k}\tZ{k}" for k in range(1, len(names) + 1)),
        "",
    ]
    for frame, time_s, row in zip(points.frame, points.time_s, points.at.reshape(count, -1), strict=True):
        cells = ("" if np.isnan(cell) else f"{1e3 * cell:.6f}" for cell in row)
        rows.append("\t".join((str(frame + 1), f"{time_s:.9f}", *cells)))
    path.write_text("\n".join(rows) + "\n", encoding="utf-8", newline="")
    return path
