"""Tables of an experiment: what was seen, measured and driven."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from backend.mechanism.apart import joints_of
from backend.mechanism.csv_rows import csv_columns
from backend.mechanism.drawing_error import DrawingError, known
from backend.mechanism.effect import joint_type_faults, kind_named
from backend.mechanism.header import header_faults
from backend.mechanism.joint import WITHOUT_COORDINATE
from backend.mechanism.mechanism import Drawn, Mechanism

if TYPE_CHECKING:
    import pandas as pd

STATUSES = ("ok", "observed", "occluded", "predicted", "outlier")
PLACES, PIXELS = ("x_m", "y_m", "z_m"), ("x_px", "y_px")  # of a marker in the world, and in the picture
SET_BACK = 3  # times in a file: rows in no order go back more often
SHOWN = 5  # faults listed of one kind; a column of text would otherwise fill the screen


@dataclass(frozen=True)
class TableFormat:
    """Columns of one kind of table.

    keys: whose time runs forward. finite: what every row must give. sigma: the column of the noise;
    it and the extra ones may be left out.  instead: what may be left out where other columns stand.
    """

    keys: tuple[str, ...]
    text: tuple[str, ...]
    numbers: tuple[str, ...]
    finite: tuple[str, ...]
    sigma: str | None = None
    extra: tuple[str, ...] = ()
    instead: tuple[tuple[str, ...], tuple[str, ...]] = ((), ())

    def required(self, header: Sequence[str]) -> tuple[str, ...]:
        """Columns that must stand in the header."""
        spared, others = self.instead
        spared = spared if others and set(others) <= set(header) else ()
        left_out = (self.sigma, *self.extra, *spared)
        return tuple(name for name in (*self.text, *self.numbers) if name not in left_out)


TABLES = {
    "tracks": TableFormat(
        keys=("marker",),
        text=("marker", "status"),
        numbers=(
            *("time_s", "x_m", "y_m", "z_m", "sigma_m"),
            *("frame", "x_px", "y_px", "cov_xx_px2", "cov_xy_px2", "cov_yy_px2"),
        ),
        finite=("time_s",),
        sigma="sigma_m",
        extra=("frame", "x_px", "y_px", "cov_xx_px2", "cov_xy_px2", "cov_yy_px2", "status"),
        instead=(PLACES, PIXELS),
    ),
    "joint_positions": TableFormat(("joint",), ("joint",), ("time_s", "q", "sigma"), ("time_s",), "sigma"),
    "inputs": TableFormat(("effect", "parameter"), ("effect", "parameter"), ("time_s", "value"), ("time_s", "value")),
    "joint_efforts": TableFormat(("joint",), ("joint",), ("time_s", "effort", "sigma"), ("time_s",), "sigma"),
}


def read_table(name: str, path: Path, mechanism: Mechanism) -> pd.DataFrame:
    """One table of an experiment, from CSV or Parquet by suffix, checked against the drawing.

    name: a key of TABLES. Rows keep the file's order; an empty number is NaN: not measured, or sigma to be
    estimated. Raises DrawingError naming file, row (the header is row 1) and remedy.
    """
    if not path.is_file():
        there = "is a folder" if path.is_dir() else "does not exist"
        raise DrawingError(f"{there}; correct the path, which counts from study.json, or put the file there", str(path))
    columns = _parquet(path) if path.suffix.lower() in (".parquet", ".pq") else csv_columns(path)
    form = TABLES[name]
    header, key = list(columns), form.keys[0]
    ids = {"marker": mechanism.markers, "joint": mechanism.joints, "effect": mechanism.effects}[key]
    allowed = (*form.numbers, *form.text)
    problems = list(header_faults(header, form.required(header), allowed, key, [part.id for part in ids]))
    if not problems and not len(next(iter(columns.values()))):
        problems = ["has a header but no rows; record at least one sample"]
    if problems:
        raise DrawingError(problems, str(path))
    table: dict[str, np.ndarray] = {}
    for column, cells in columns.items():
        if column in form.numbers:
            table[column], faults = _numbers(cells, column, column in form.finite)
            problems += _few(faults)
        else:
            table[column] = np.asarray(cells, dtype=object)
    for column in (*form.instead[0], form.sigma):
        if column is not None and column not in table:
            table[column] = np.full(len(columns["time_s"]), np.nan)
    if not problems:
        for check in (_names, _status, _sigma, _order):
            faults = list(check(form, table, mechanism))
            told = list(_set_back(form, table)) if check is _order and len(faults) > SHOWN else []
            problems += told or _few(faults)
    if problems:
        raise DrawingError(problems, str(path))
    return _frame(table)


def _frame(table: dict[str, np.ndarray]) -> pd.DataFrame:
    import pandas as pd  # costs half a second, and reading a drawing does not need it

    return pd.DataFrame(table)


def _parquet(path: Path) -> dict[str, Any]:
    import pandas as pd

    try:
        frame = pd.read_parquet(path)
    except (OSError, ValueError) as error:  # pyarrow's own errors derive from these
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise DrawingError(f"cannot be read as Parquet ({reason}); check the path and the file", str(path)) from None
    return {str(name): frame[name].to_numpy(dtype=object) for name in frame.columns}


def _numbers(cells: Any, column: str, finite: bool) -> tuple[np.ndarray, list[str]]:
    """The cells as floats, and a sentence for each that is none."""
    if not len(cells):
        return np.zeros(0), []
    values = np.full(len(cells), np.nan)
    faults: list[str] = []
    try:
        if any("_" in cell for cell in cells):  # Python would read 1_0 as ten
            raise ValueError
        values = np.array([cell or "nan" for cell in cells], dtype=object).astype(float)
    except (TypeError, ValueError):
        for row, cell in enumerate(cells, start=2):
            try:
                if isinstance(cell, bool | np.bool_) or (isinstance(cell, str) and "_" in cell):
                    raise ValueError
                values[row - 2] = np.nan if cell is None or cell == "" else float(cell)
            except (TypeError, ValueError):
                faults.append(f"row {row}: {column} is {cell!r}; write a number")
    if not faults:
        wrong = ~np.isfinite(values) if finite else np.isinf(values)
        remedy = "it must be a finite number" if finite else "leave it empty when it was not measured"
        if (rows := np.flatnonzero(wrong)).size:
            count = f" ({rows.size} rows like this)" if rows.size > 1 else ""
            faults.append(f"row {rows[0] + 2}: {column} is {cells[rows[0]] or 'empty'}{count}; {remedy}")
    return values, faults


def _names(form: TableFormat, table: dict[str, np.ndarray], mechanism: Mechanism) -> Iterator[str]:
    if form.keys == ("effect", "parameter"):
        yield from _driven(table, mechanism)
        return
    (key,) = form.keys
    types = {joint.id: joint.type for joint in mechanism.joints}
    ids = {marker.id for marker in mechanism.markers} if key == "marker" else types.keys()
    for name, row in _first_rows(table[key]):
        if name not in ids:
            yield f'row {row}: {key} "{name}" is not drawn; rename it or draw it. {known(ids, str(name))}'
        elif (
            key == "joint" and types[name] in WITHOUT_COORDINATE and not (types[name] == "fixed" and "effort" in table)
        ):
            yield (
                f'row {row}: joint "{name}" is {types[name]} and has no single position or effort to measure; '
                "measure markers on its bodies instead"
            )


def _driven(table: dict[str, np.ndarray], mechanism: Mechanism) -> Iterator[str]:
    effects = {effect.id: effect for effect in mechanism.effects}
    drawn = Drawn.of(mechanism)
    rows_of: dict[tuple[Any, Any], list[int]] = {}
    for at, pair in enumerate(zip(table["effect"], table["parameter"], strict=True)):
        rows_of.setdefault(pair, []).append(at)
    for (effect, parameter), its in rows_of.items():
        row = its[0] + 2
        if effect not in effects:
            yield f'row {row}: effect "{effect}" is not drawn; rename it or draw it. {known(effects, str(effect))}'
            continue
        kind = kind_named(effects[effect].kind)
        spec = kind.parameters.get(parameter)
        on = drawn.joints_of(effects[effect].on)
        joints = joints_of(effects[effect], {id: joint.type for id, joint in on.items()})
        if spec is not None and joints and (faults := joint_type_faults(kind, [spec], joints, every=True)):
            yield f"row {row}: {faults[0]}"
        elif spec is None:
            yield f'row {row}: parameter "{parameter}" is unknown to {kind.name}. {known(kind.parameters)}'
        elif spec.size > 1:
            yield f"row {row}: {parameter} is a list of {spec.size} and cannot be driven; drive a number"
        else:
            rows = np.array(its)
            values = table["value"][rows]
            low, high = spec.lower, spec.upper
            wrong = (values < (-np.inf if low is None else low)) | (values > (np.inf if high is None else high))
            for at in rows[wrong][:1]:
                bounds = f"{'-inf' if low is None else low} to {'inf' if high is None else high}"
                value = f"{table['value'][at]:g}"
                yield f"row {at + 2}: {parameter} is {value}, outside its bounds {bounds}; correct it"


def _first_rows(names: Iterable[Any]) -> Iterator[tuple[Any, int]]:
    seen: dict[Any, int] = {}
    for row, name in enumerate(names, start=2):
        seen.setdefault(name, row)
    yield from seen.items()


def _status(form: TableFormat, table: dict[str, np.ndarray], mechanism: Mechanism) -> Iterator[str]:
    if "status" in table:
        for status, row in _first_rows(table["status"]):
            if status not in STATUSES:
                yield f'row {row}: status "{status}" is unknown; write one of {", ".join(STATUSES)}'


def _sigma(form: TableFormat, table: dict[str, np.ndarray], mechanism: Mechanism) -> Iterator[str]:
    if form.sigma is not None:
        for row in np.flatnonzero(table[form.sigma] <= 0.0):
            yield (
                f"row {row + 2}: {form.sigma} is {table[form.sigma][row]:g}; a standard deviation is "
                "above zero: leave it empty to have it estimated"
            )


def _order(form: TableFormat, table: dict[str, np.ndarray], mechanism: Mechanism) -> Iterator[str]:
    latest: dict[Any, tuple[float, int]] = {}
    rows_at: dict[tuple[Any, float], int] = {}
    keys = list(zip(*(table[key] for key in form.keys), strict=True))
    times = table["time_s"].tolist()
    for row, (key, time) in enumerate(zip(keys, times, strict=True), start=2):
        last, at = latest.get(key, (-np.inf, 0))
        if time > last:
            latest[key] = time, row
            continue
        if not rows_at:  # only a table with faults pays for it
            for earlier, sample in enumerate(zip(keys, times, strict=True), start=2):
                rows_at.setdefault(sample, earlier)
        whose = " ".join(f'{name} "{id}"' for name, id in zip(form.keys, key, strict=True))
        if (first := rows_at[key, time]) < row:
            yield f"row {row}: time_s {time:g} s of {whose} is repeated from row {first}; keep one row per sample"
        else:
            yield (
                f"row {row} is out of order: time_s {time:g} s of {whose} stands below {last:g} s in row {at}; "
                "sort the rows by time_s"
            )


def _set_back(form: TableFormat, table: dict[str, np.ndarray]) -> Iterator[str]:
    """The sentence for a clock that was set back, of which many rows stand out of order; none where rows are mixed."""
    keys = list(zip(*(table[key] for key in form.keys), strict=True))
    latest: dict[Any, tuple[float, int]] = {}
    backs: dict[Any, list[tuple[float, float, int]]] = {}
    for row, (key, time) in enumerate(zip(keys, table["time_s"].tolist(), strict=True), start=2):
        last, _ = latest.get(key, (-np.inf, 0))
        if time <= last:
            backs.setdefault(key, []).append((last, time, row))
        latest[key] = time, row
    if max(len(its) for its in backs.values()) <= SET_BACK:
        last, time, row = min((its[0] for its in backs.values()), key=lambda back: back[2])
        yield (
            f"row {row}: time_s goes back from {last:g} s to {time:g} s; where another take begins there, make it a "
            "file and an experiment of its own; otherwise correct its clock"
        )


def _few(faults: list[str]) -> list[str]:
    rest = len(faults) - SHOWN
    return faults if rest <= 0 else [*faults[:SHOWN], f"and {rest} more like the last"]
