"""Text of a file that a person may have saved with any program."""

from __future__ import annotations

import codecs
from pathlib import Path


class NotText(ValueError):
    """A file whose bytes are no text that is read here; says where, and how to save it."""


def read_text(path: Path) -> str:
    """UTF-8 text, or UTF-16 where the file says so by its mark; without that mark.  Raises OSError, NotText."""
    data = path.read_bytes()
    marked = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    try:
        return data.decode("utf-16" if marked else "utf-8-sig")
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        byte = f"byte 0x{data[error.start]:02x} in line {line}"
        raise NotText(f"is not UTF-8 text: {byte}; save it as UTF-8 (of a table: CSV UTF-8)") from None
