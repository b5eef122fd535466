"""What experiments leave of a choice of causes, and its slopes, whitened."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from backend.diagnose.probe import Probe
from backend.diagnose.subject import Subject

PLACES = ("m", "rad")  # units of channels that tell where something is
ACROSS_START = 3e-4  # rad or mechanism lengths; ten times as much of a rate
ACROSS = 0.05  # of a number's sd before any data, each way


class Seer:
    """Whitened (measured - predicted) and slopes of the prediction, all runs of a subject."""

    def __init__(self, subject: Subject, probes: Sequence[Probe], fraction: float = 1.0):
        self.subject, self.probes = subject, probes
        self.white = [subject.noise.whitening(p.data, i, fraction) for i, p in enumerate(probes)]
        self.white = [w if p.lying is None else w.beside(p.lying) for w, p in zip(self.white, probes, strict=True)]
        ends = np.cumsum([0, *[w.keep.size for w in self.white]]).tolist()
        self.rows = tuple(slice(a, b) for a, b in pairwise(ends))
        self.count = ends[-1]

    def __call__(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(r, J)."""
        few, ends = self._ends(x)
        r, J = np.zeros(self.count), np.zeros((self.count, x.size))

        def one(i: int) -> None:
            p, white, rows = self.probes[i], self.white[i], self.rows[i]
            seen, slope = p.predict(x[:few], x[ends[i] : ends[i + 1]])
            r[rows] = white(p.data.value - seen)
            slope = white(slope)
            J[rows, :few], J[rows, ends[i] : ends[i + 1]] = slope[:, :few], slope[:, few:]

        self.subject.over(one, range(len(self.probes)))
        return r, J

    def left(self, x: np.ndarray) -> Float[np.ndarray, " n"]:
        """r alone."""
        few, ends = self._ends(x)
        r = np.zeros(self.count)

        def one(i: int) -> None:
            p = self.probes[i]
            r[self.rows[i]] = self.white[i](p.data.value - p.seen(x[:few], x[ends[i] : ends[i + 1]]))

        self.subject.over(one, range(len(self.probes)))
        return r

    def across(self, x: np.ndarray, J: np.ndarray, sd: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
        """Slopes by differences: where walls rub, pins stick and slip within a step, and exact slopes say how that step
        reacts; through a record of them they grow past all bounds.

        sd: of the choice's parameters before any data. J: exact ones, which stay where a motion is lost.
        """
        few, ends = self._ends(x)
        made, every = J.copy(), range(len(self.probes))
        ways = [(dict.fromkeys(every, k), float(ACROSS * sd[k])) for k in range(few)]
        for c in range(max(p.unknowns for p in self.probes)):  # each run's own moves no other: all at once
            runs = [i for i in every if self.probes[i].unknowns > c]
            far = ACROSS_START * (10.0 if c >= self.probes[runs[0]].mobility else 1.0)
            ways.append(({i: int(ends[i]) + c for i in runs}, far))
        for column_of, far in ways:
            below, above, moved = x.copy(), x.copy(), list(column_of.values())
            below[moved] = np.maximum(x[moved] - far, lower[moved])
            above[moved] = np.minimum(x[moved] + far, upper[moved])
            change = self.left(below) - self.left(above)
            for i, column in column_of.items():
                slope = change[self.rows[i]] / (above[column] - below[column])
                made[self.rows[i], column] = np.where(np.isfinite(slope), slope, J[self.rows[i], column])
        return made

    def _ends(self, x: np.ndarray) -> tuple[int, np.ndarray]:
        """Number of shared numbers, and where each run's own begin."""
        few = 0 if self.probes[0].ties is None else self.probes[0].ties.shape[1]
        return few, few + np.cumsum([0, *[p.unknowns for p in self.probes]])

    def miss(self, x: np.ndarray) -> float:
        """Rms of what the prediction misses, in radians or mechanism lengths; what joints carry is no place."""
        few, ends = self._ends(x)
        length, squares, count = float(self.subject.model.scale.length_m), 0.0, 0
        for i, (p, white) in enumerate(zip(self.probes, self.white, strict=True)):
            seen, _ = p.predict(x[:few], x[ends[i] : ends[i + 1]])
            unit = np.array([c.unit for c in p.data.channels])[p.data.channel]
            off = ((p.data.value - seen) / np.where(unit == "m", length, 1.0))[white.keep]
            off = off[np.isin(unit, PLACES)[white.keep]]
            squares, count = squares + float(off @ off), count + off.size
        return float(np.sqrt(squares / max(count, 1)))
