"""Where every fit of a search ended, on disk as it ends, so that a search that was killed goes on where it was.

A search of one study asks the same fits in the same order every time; a fit that was kept costs one look at its end.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from backend.fit.checkpoint import digest
from backend.fit.journal import Journal
from backend.mechanism.study import Study

FILE = "diagnosis.kept.jsonl"
DIGITS = 6  # of a number: it may differ in its last bits from one machine to the next


class Kept:
    """Ends of fits by what was free, how much of the records counted and where the search began, on disk or (without a
    journal) for this process alone.
    """

    def __init__(self, journal: Journal | None = None):
        self.journal = journal
        told = journal.entries if journal else ()
        self._ends: dict[str, tuple[np.ndarray, str]] = {t["fit"]: (np.array(t["x"], float), t["status"]) for t in told}
        self._asked: Counter[str] = Counter()

    @classmethod
    def of(cls, path: Path, study: Study, without: frozenset[str], *, resume: bool) -> Kept:
        """Begin anew, or go on; ValueError with the remedy where there is nothing to go on with."""
        return cls(Journal.of(path, digest(study, sorted(without), {}), resume=resume, work="diagnosis"))

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
        if self.journal is not None:
            self.journal.add({"fit": fit, "x": x.tolist(), "status": status})

    def remove(self) -> None:
        """The diagnosis is finished: nothing is left to resume."""
        if self.journal is not None:
            self.journal.path.unlink(missing_ok=True)


def name_of(what: str, numbers: Sequence[float] | Float[np.ndarray, " n"]) -> str:
    """Which fit: a fingerprint of its words and of the numbers that decide its course."""
    rounded = ",".join(f"{v:.{DIGITS}g}" for v in numbers)
    return hashlib.sha256(f"{what}|{rounded}".encode()).hexdigest()[:24]
