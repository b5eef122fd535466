"""Verdicts of finished chunks, on disk as they come, so that an ensemble that was killed goes on where it was."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from backend.fit.journal import Journal
from backend.jam.batch import Verdicts

FILE = "jam.kept.jsonl"


class KeptChunks:
    """Verdicts (`ends`) by the number of their chunk's first sample."""

    def __init__(self, journal: Journal):
        self.journal = journal
        self.ends = {told["first"]: _verdicts(told) for told in journal.entries}

    @classmethod
    def of(cls, path: Path, content: str, *, resume: bool) -> KeptChunks:
        """Begin anew, or go on; ValueError with the remedy where there is nothing to go on with.

        content: a fingerprint of what is asked and of the samples.
        """
        return cls(Journal.of(path, content, resume=resume, work="ensemble"))

    def note(self, first: int, seen: Verdicts) -> None:
        """One more chunk is done."""
        self.ends[first] = seen
        told = {name: getattr(seen, name).astype(int).tolist() for name in ("jammed", "rests", "lost")}
        onset = [None if np.isnan(at) else at for at in seen.onset_s.tolist()]
        self.journal.add({"first": first, **told, "onset_s": onset})


def _verdicts(told: dict) -> Verdicts:
    jammed, rests, lost = (np.array(told[name], dtype=bool) for name in ("jammed", "rests", "lost"))
    return Verdicts(jammed, rests, np.array(told["onset_s"], dtype=float), lost)  # null is NaN
