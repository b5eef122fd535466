"""A pandas table of numbers inside HDF5, read and written without PyTables.

pandas lays a DataFrame out in one of two ways.  `fixed`: the columns' levels and labels are plain arrays, each block
of columns is one matrix.  `table`: one compound dataset, whose columns' names are pickled into attributes; only
lists, tuples and strings are unpickled here, so that a file cannot run anything.
"""

from __future__ import annotations

import io
import pickle
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import h5py
import numpy as np
from jaxtyping import Float

from backend.observe.tracking_error import TrackingError

Column = tuple[str, ...]


@dataclass(frozen=True)
class Table:
    """columns: one tuple of labels a column; index: one entry a row; values (row, column)."""

    columns: tuple[Column, ...]
    index: np.ndarray
    values: Float[np.ndarray, "row column"]


class _Plain(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        raise pickle.UnpicklingError(f"{module}.{name} is more than text")


def kind(group: Any) -> str:
    """What pandas stored in a group: `frame` (fixed), `frame_table` (table), another kind, or nothing."""
    return _text(group.attrs.get("pandas_type", b"")) if isinstance(group, h5py.Group) else ""


def read_frame(group: Any, source: str, remedy: str) -> Table:
    """The table in a group.  Raises TrackingError with the remedy where its layout cannot be read."""
    try:
        if kind(group) == "frame":
            return _fixed(group)
        if kind(group) == "frame_table":
            return _table(group)
        found = kind(group) or "nothing of pandas"
    except (KeyError, ValueError, IndexError, TypeError, OSError, EOFError, pickle.UnpicklingError) as error:
        found = f"{kind(group)}, but {error}"
    raise TrackingError(f"{source}: the table {group.name} has a layout that cannot be read ({found}). {remedy}")


def _fixed(group: Any) -> Table:
    columns = _levels(group, "axis0")
    where = {column: k for k, column in enumerate(columns)}
    index = np.asarray(group["axis1"])
    values = np.full((len(index), len(columns)), np.nan)
    for block in range(int(group.attrs["nblocks"])):
        matrix = np.asarray(group[f"block{block}_values"], float)
        own = [where[column] for column in _levels(group, f"block{block}_items")]
        # PyTables turns a matrix over on its way to the file and marks it so; an untouched one is column by row.
        turned = bool(group[f"block{block}_values"].attrs.get("transposed", False))
        values[:, own] = matrix if turned else matrix.T
    return Table(columns, index, values)


def _levels(group: Any, axis: str) -> tuple[Column, ...]:
    if _text(group.attrs[f"{axis}_variety"]) != "multi":
        return tuple((_text(name),) for name in np.asarray(group[axis]))
    count = int(group.attrs[f"{axis}_nlevels"])
    levels = [[_text(name) for name in np.asarray(group[f"{axis}_level{k}"])] for k in range(count)]
    labels = [np.asarray(group[f"{axis}_label{k}"]).tolist() for k in range(count)]
    return tuple(tuple(level[at] for level, at in zip(levels, row, strict=True)) for row in zip(*labels, strict=True))


def _table(group: Any) -> Table:
    rows = group["table"]
    fields = [name for name in rows.dtype.names or () if name.startswith("values_block_")]
    columns: list[Column] = []
    blocks = []
    for field in fields:
        columns += [tuple(map(str, column)) for column in _unpickled(rows.attrs[f"{field}_kind"])]
        blocks.append(np.asarray(rows[field], float).reshape(len(rows), -1))
    values = np.concatenate(blocks, axis=1)
    if values.shape[1] != len(columns):
        raise ValueError(f"{len(columns)} columns are named and {values.shape[1]} are there")
    return Table(tuple(columns), np.asarray(rows["index"]), values)


def _unpickled(cell: Any) -> Any:
    data = cell if isinstance(cell, bytes) else str(cell).encode("latin-1")
    return _Plain(io.BytesIO(bytes(data))).load()


def _text(cell: Any) -> str:
    return cell.decode("utf-8", "replace") if isinstance(cell, bytes) else str(cell)


def write_frame(
    file: h5py.File, key: str, columns: Sequence[Column], levels: Sequence[str], index: np.ndarray, values: np.ndarray
) -> None:
    """Write a table of float64 in pandas' fixed layout, as PyTables would: `pandas.read_hdf` reads it.

    levels: the name of each level of the columns.  values (row, column).
    """
    _tag(file, CLASS="GROUP", PYTABLES_FORMAT_VERSION="2.1", TITLE="", VERSION="1.0")
    group = file.create_group(key)
    _tag(group, CLASS="GROUP", TITLE="", VERSION="1.0", encoding="UTF-8", errors="strict", pandas_type="frame")
    _tag(group, axis0_variety="multi", axis1_variety="regular", block0_items_variety="multi")
    for name, number in (("ndim", 2), ("nblocks", 1), ("axis0_nlevels", len(levels))):
        group.attrs[name] = np.int64(number)
    group.attrs["block0_items_nlevels"] = np.int64(len(levels))
    for axis in ("axis0", "block0_items"):
        for k, level in enumerate(levels):
            words = list(dict.fromkeys(column[k] for column in columns))
            stored = _array(group, f"{axis}_level{k}", np.array([word.encode() for word in words]))
            _tag(stored, kind="string", name=level, nan_rep="", **{f"{axis}_name{level}": level})
            _array(group, f"{axis}_label{k}", np.array([words.index(column[k]) for column in columns], np.int64))
    rows = _array(group, "axis1", np.asarray(index, np.int64))
    _tag(rows, kind="integer")
    rows.attrs["name"] = np.bytes_(pickle.dumps(None, protocol=0))  # the index has no name
    _array(group, "block0_values", np.asarray(values, np.float64))


def _array(group: h5py.Group, name: str, values: np.ndarray) -> h5py.Dataset:
    stored = group.create_dataset(name, data=values)
    _tag(stored, CLASS="ARRAY", FLAVOR="numpy", TITLE="", VERSION="2.4")
    stored.attrs["transposed"] = np.uint8(1)
    return stored


def _tag(node: Any, **attributes: str) -> None:
    for name, word in attributes.items():
        data = word.encode()
        # PyTables gives a fixed string marked as UTF-8 back as text, any other as bytes, which pandas cannot use.
        node.attrs.create(name, data, dtype=h5py.string_dtype("utf-8", max(1, len(data))))
