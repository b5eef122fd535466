"""Columns of a CSV file, as text; what is wrong with its rows is told with the row and the remedy."""

from __future__ import annotations

import csv
import io
from collections import Counter
from pathlib import Path

from backend.mechanism.drawing_error import DrawingError
from backend.mechanism.text_file import NotText, read_text

SEPARATORS = {";": "semicolons", "\t": "tabs", "|": "bars"}
SHOWN = 5  # names of columns


def csv_columns(path: Path) -> dict[str, tuple[str, ...]]:
    """Column -> its cells in the file's order, blanks around them removed.  Raises DrawingError."""
    try:
        text = read_text(path)
        rows = list(csv.reader(io.StringIO(text, newline=""), strict=True))
    except NotText as error:
        raise DrawingError(str(error), str(path)) from None
    except (OSError, csv.Error, ValueError) as error:
        raise DrawingError(f"cannot be read as CSV ({error}); check the path and the file", str(path)) from None
    if not rows or not any(rows[0]):
        raise DrawingError("is empty; the first row names the columns", str(path))
    header = [cell.strip() for cell in rows[0]]
    while rows and not rows[-1]:
        rows.pop()
    for problem in (_separated(rows), _of_wrong_length(rows, header), _twice(header)):
        if problem:
            raise DrawingError(problem, str(path))
    # Blanks after commas are how many write a list: no name ends in one, and a blank cell holds nothing.
    cells = [tuple(map(str.strip, column)) for column in zip(*rows[1:], strict=True)] or [()] * len(header)
    return dict(zip(header, cells, strict=True))


def _separated(rows: list[list[str]]) -> str | None:
    """Of values that something else than commas separates, as spreadsheets of many countries write them."""
    (first, *others) = rows[0]
    mark = next((mark for mark in SEPARATORS if mark in first), None)
    if others or mark is None:
        return None
    decimal = any(len(row) > 1 for row in rows[1:])
    return (
        f"its values are separated by {SEPARATORS[mark]}{' and its numbers have decimal commas' if decimal else ''}; "
        f"separate values by commas{' and write numbers with points' if decimal else ''}, as in "
        f"{','.join(cell.strip() for cell in first.split(mark)[:3])},... 0.004,..."
    )


def _of_wrong_length(rows: list[list[str]], header: list[str]) -> str | None:
    wrong = [(number, row) for number, row in enumerate(rows[1:], start=2) if len(row) != len(header)]
    if not wrong:
        return None
    number, row = wrong[0]
    if number == len(rows):
        remedy = "the file was cut off: copy it again, or delete that row"
    else:
        remedy = "a row is a list of values separated by commas; correct it"
    count = f" ({len(wrong)} rows like this)" if len(wrong) > 1 else ""
    return f"row {number} has {len(row)} values, the header names {len(header)}{count}; {remedy}"


def _twice(header: list[str]) -> str | None:
    twice = sorted(name for name, count in Counter(header).items() if count > 1)
    more = f" and {len(twice) - SHOWN} more" if len(twice) > SHOWN else ""
    return f"column {', '.join(twice[:SHOWN])}{more} stands twice in the header; keep one" if twice else None
