"""Lines of JSON, each on disk before work goes on; the first says what they belong to."""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from backend.source import source_digest

HEAD = "belongs_to"


class Journal:
    """What was found so far. entries: those that an earlier process wrote, in order."""

    def __init__(self, path: Path, belongs_to: str, entries: Iterable[dict[str, Any]] = ()):
        self.path, self.entries = path, list(entries)
        self._writing = threading.Lock()
        path.parent.mkdir(parents=True, exist_ok=True)
        # A crash may have cut off the last line, and may come again: the whole lines take the file's place at once.
        part = path.with_name(path.name + ".part")
        part.write_text("".join(_line(told) for told in ({HEAD: belongs_to}, *self.entries)), encoding="utf-8")
        os.replace(part, path)

    @classmethod
    def of(cls, path: Path, belongs_to: str, *, resume: bool, work: str) -> Journal:
        """Begin anew, or go on; ValueError with the remedy where there is nothing to go on with.

        belongs_to: a fingerprint of all that decides what is found, beside the code. work: what the user would call it.
        """
        belongs_to = f"{belongs_to} {source_digest()}"
        if not resume:
            return cls(path, belongs_to)
        try:
            lines = path.read_text(encoding="utf-8").splitlines()
        except FileNotFoundError:
            raise ValueError(
                f"{path} does not exist, so there is no {work} to resume: start it without --resume, or name the "
                "--out of the one that was cut off."
            ) from None
        told = [read for line in lines if (read := _read(line)) is not None]
        if not told or told[0].get(HEAD) != belongs_to:
            raise ValueError(
                f"{path} belongs to another {work}: what it reads, an option or linktwin itself has changed since. "
                "Start again without --resume."
            )
        return cls(path, belongs_to, told[1:])

    def add(self, entry: dict[str, Any]) -> None:
        """One more, on disk when this returns."""
        with self._writing, self.path.open("a", encoding="utf-8") as file:
            file.write(_line(entry))
            file.flush()
            os.fsync(file.fileno())


def _line(told: dict[str, Any]) -> str:
    return json.dumps(told, separators=(",", ":")) + "\n"


def _read(line: str) -> dict[str, Any] | None:
    """A last line that a crash cut off is no line."""
    try:
        return json.loads(line)
    except json.JSONDecodeError:
        return None
