"""Verdicts of finished chunks, on disk as they come, so that an ensemble that was killed goes on where it was."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np

from backend.jam.batch import Verdicts

FILE = "jam.kept.jsonl"


class KeptChunks:
    """Verdicts by the number of their chunk's first sample.

    path: the file, whose first line says what was asked of which samples.  ends: those that were kept.
    """

    def __init__(self, path: Path, content: str, ends: dict[int, Verdicts]):
        self.path, self.content, self.ends = path, content, ends
        path.parent.mkdir(parents=True, exist_ok=True)
        # A crash may have cut off the last line: the whole ones take the file's place at once.
        part = path.with_name(path.name + ".part")
        lines = [json.dumps({"content": content}), *(_line(first, seen) for first, seen in ends.items())]
        part.write_text("\n".join(lines) + "\n", encoding="utf-8")
        os.replace(part, path)

    @classmethod
    def of(cls, path: Path, content: str, *, resume: bool) -> KeptChunks:
        """Begin anew, or go on; ValueError with the remedy where there is nothing to go on with.

        content: a fingerprint of what is asked and of the samples.
        """
        if not resume:
            return cls(path, content, {})
        try:
            lines = path.read_text(encoding="utf-8").splitlines()
        except FileNotFoundError:
            raise ValueError(
                f"{path} does not exist, so there are no samples to resume: start without --resume, or name the --out "
                "of the run that was cut off."
            ) from None
        told = [read for line in lines if (read := _read(line)) is not None]
        if not told or told[0].get("content") != content:
            raise ValueError(
                f"{path} belongs to other samples: the drawing or an option has changed since. Start again without "
                "--resume."
            )
        return cls(path, content, {one["first"]: _verdicts(one) for one in told[1:]})

    def note(self, first: int, seen: Verdicts) -> None:
        """One more chunk is done."""
        self.ends[first] = seen
        with self.path.open("a", encoding="utf-8") as file:
            file.write(_line(first, seen) + "\n")
            file.flush()
            os.fsync(file.fileno())


def _line(first: int, seen: Verdicts) -> str:
    told = {name: getattr(seen, name).astype(int).tolist() for name in ("jammed", "rests", "lost")}
    onset = [None if np.isnan(at) else at for at in seen.onset_s.tolist()]
    return json.dumps({"first": first, **told, "onset_s": onset}, separators=(",", ":"))


def _verdicts(told: dict) -> Verdicts:
    jammed, rests, lost = (np.array(told[name], dtype=bool) for name in ("jammed", "rests", "lost"))
    return Verdicts(jammed, rests, np.array(told["onset_s"], dtype=float), lost)  # null is NaN


def _read(line: str) -> dict | None:
    """A last line that a crash cut off is no line."""
    try:
        return json.loads(line)
    except json.JSONDecodeError:
        return None
