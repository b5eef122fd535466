"""Where every fit of a search ended, on disk as it ends, so that a search that was killed goes on where it was.

A search of one study asks the same fits in the same order every time; a fit that was kept costs one look at its end.
"""

from __future__ import annotations

import hashlib
import json
import os
import threading
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from backend.fit.checkpoint import digest
from backend.mechanism.study import Study

FILE = "diagnosis.kept.jsonl"
DIGITS = 6  # of a number: it may differ in its last bits from one machine to the next


class Kept:
    """Ends of fits by what was free, how much of the records counted and where the search began.

    path: the file (none: nothing is kept). The first line says which study it belongs to.
    """

    def __init__(self, path: Path | None = None, belongs_to: str = ""):
        self.path, self.belongs_to = path, belongs_to
        self._ends: dict[str, tuple[np.ndarray, str]] = {}
        self._asked: Counter[str] = Counter()
        self._writing = threading.Lock()
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(json.dumps({"study": belongs_to}) + "\n", encoding="utf-8")

    @classmethod
    def of(cls, path: Path, study: Study, without: frozenset[str], *, resume: bool) -> Kept:
        """Begin anew, or go on; ValueError with the remedy where there is nothing to go on with."""
        belongs_to = digest(study, sorted(without), {})
        if not resume:
            return cls(path, belongs_to)
        try:
            lines = path.read_text(encoding="utf-8").splitlines()
        except FileNotFoundError:
            raise ValueError(
                f"{path} does not exist, so there is no diagnosis to resume: start it without --resume, or name the "
                "--out of the one that was cut off."
            ) from None
        told = [read for line in lines if (read := _read(line)) is not None]
        if not told or told[0].get("study") != belongs_to:
            raise ValueError(
                f"{path} belongs to another diagnosis: the study or what is left out has changed since. Start again "
                "without --resume."
            )
        made = cls()
        made.path, made.belongs_to = path, belongs_to
        made._ends = {t["fit"]: (np.array(t["x"], float), t["status"]) for t in told[1:]}
        # A crash may have cut off the last line, and may come again: the whole lines take the file's place at once.
        part = path.with_name(path.name + ".part")
        part.write_text("".join(json.dumps(t) + "\n" for t in told), encoding="utf-8")
        os.replace(part, path)
        return made

    def __len__(self) -> int:
        return len(self._ends)

    def asked(self, fit: str) -> str:
        """The fit's name this time.

        One from the same start may be asked again, when more is known of the noise or the step; a search that
        goes on asks as often, in the same order.
        """
        self._asked[fit] += 1
        return f"{fit}.{self._asked[fit]}"

    def end_of(self, fit: str) -> tuple[Float[np.ndarray, " x"], str] | None:
        """Where this fit ended, and how; None where it was not kept."""
        return self._ends.get(fit)

    def note(self, fit: str, x: Float[np.ndarray, " x"], status: str) -> None:
        """One more fit ended."""
        self._ends[fit] = (x, status)
        if self.path is None:
            return
        line = json.dumps({"fit": fit, "x": x.tolist(), "status": status})
        with self._writing, self.path.open("a", encoding="utf-8") as file:
            file.write(line + "\n")
            file.flush()
            os.fsync(file.fileno())

    def remove(self) -> None:
        """The diagnosis is finished: nothing is left to resume."""
        if self.path is not None:
            self.path.unlink(missing_ok=True)


def name_of(what: str, numbers: Sequence[float] | Float[np.ndarray, " n"]) -> str:
    """Which fit: a fingerprint of its words and of the numbers that decide its course."""
    rounded = ",".join(f"{v:.{DIGITS}g}" for v in numbers)
    return hashlib.sha256(f"{what}|{rounded}".encode()).hexdigest()[:24]


def _read(line: str) -> dict | None:
    """A last line that a crash cut off is no line."""
    try:
        return json.loads(line)
    except json.JSONDecodeError:
        return None
