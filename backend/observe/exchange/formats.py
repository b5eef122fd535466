"""Which tool wrote a file of tracks: told by what stands in it, not by its name alone."""

from __future__ import annotations

from pathlib import Path

import h5py

from backend.observe.exchange import deeplabcut, sleap, trc
from backend.observe.exchange.pandas_hdf import kind
from backend.observe.exchange.points import Points, listed
from backend.observe.tracking_error import TrackingError

OURS = "linktwin tracks"
KNOWN = "Known are linktwin's tracks (CSV), DeepLabCut (CSV, HDF5), SLEAP (analysis HDF5) and TRC."
_READERS = {
    "DeepLabCut CSV": deeplabcut.read_csv,
    "DeepLabCut HDF5": deeplabcut.read_h5,
    "SLEAP analysis HDF5": sleap.read_h5,
    "TRC": trc.read_trc,
}


def format_of(path: Path) -> str:
    """The format of a file.  Raises TrackingError, with what is known, for a file of none."""
    try:
        with path.open("rb") as file:
            head = file.read(4096)
    except OSError as error:
        raise TrackingError(f"{path} cannot be read ({error.strerror}). Check the name.") from error
    if not head:
        raise TrackingError(f"{path.name} is empty (0 bytes). Export the tracks again.")
    if head.startswith(b"PAR1"):
        return OURS
    if h5py.is_hdf5(path):
        return _of_hdf5(path)
    if head.startswith(b"\x89HDF"):
        raise TrackingError(f"{path.name} is an HDF5 file that ends too early. Copy it again.")
    text = head.decode("utf-8-sig", "replace")
    if "\0" in text:
        raise TrackingError(f"{path.name} is no text and no HDF5; a clip is measured by linktwin track. {KNOWN}")
    rows = text.splitlines()
    if text.startswith("PathFileType") or path.suffix.lower() == ".trc":
        return "TRC"
    first = [row.split(",")[0].strip() for row in rows[:4]]
    if "time_s" in rows[0].split(","):
        return OURS
    if {"scorer", "bodyparts", "individuals", "coords"} & set(first):
        return "DeepLabCut CSV"
    raise TrackingError(f"{path.name} is no file of tracks: it begins with {rows[0][:60]!r}. {KNOWN}")


def _of_hdf5(path: Path) -> str:
    try:
        with h5py.File(path) as file:
            held = list(file)
            if "tracks" in held or "node_names" in held:
                return "SLEAP analysis HDF5"
            if any(kind(file[key]) for key in held):
                return "DeepLabCut HDF5"
    except OSError as error:  # h5py's reasons name its own sources
        raise TrackingError(f"{path.name} is an HDF5 file that cannot be read to its end. Copy it again.") from error
    raise TrackingError(f"{path.name} holds {listed(held) or 'nothing'}, which is no table of tracks. {KNOWN}")


def read_points(path: Path) -> Points:
    """The points of a file made elsewhere, under its own names.  Raises TrackingError."""
    found = format_of(path)
    try:
        return _READERS[found](path)
    except OSError as error:
        raise TrackingError(f"{path.name} is an HDF5 file that cannot be read to its end. Copy it again.") from error
