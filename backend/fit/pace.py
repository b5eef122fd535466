"""How far a fit is and how long it may still take, though no one knows how many iterations a search needs."""

from __future__ import annotations

import time
from collections.abc import Callable
from threading import RLock

Progress = Callable[[float, str], None]
USUAL = 4.0  # iterations after which half of a piece of work is taken as done
TRUSTED_S = 2.0  # of work before its speed says anything


class Pace:
    """Pieces of work of stated weights, which are their usual costs in iterations, told as one share of the whole.

    planned: weight of all pieces. The time left is what the rest takes at the price of an iteration since the first:
    compiling comes before it and does not count, nor do iterations that a piece turned out not to need. Several
    threads may tell of theirs, one at a time.
    """

    def __init__(self, tell: Progress, planned: float, clock: Callable[[], float] = time.perf_counter):
        self._tell, self.planned, self._clock = tell, planned, clock
        self._done = self._piece = self._steps = self._part = self._share = self._worked = 0.0
        self._first: float | None = None
        self._lock = RLock()

    def enter(self, weight: float, words: str = "") -> None:
        """Leave the last piece of work and begin the next."""
        with self._lock:
            self._done += self._piece
            if self._first is not None and not self._steps:
                self._worked += self._piece
            self._piece, self._steps, self._part = weight, 0.0, 0.0
            self.planned = max(self.planned, self._done + weight)
            if words:
                self.tell(0.0, words)

    def expect(self, weight: float) -> None:
        """More work than was planned lies ahead."""
        with self._lock:
            self.planned += weight

    def step(self, words: str) -> None:
        """One more iteration of this piece of work."""
        with self._lock:
            self._steps += 1.0
            if self._first is None:
                self._first = self._clock()
            else:
                self._worked += 1.0
            self.tell(self._steps / (self._steps + USUAL), words)

    def tell(self, part: float, words: str) -> None:
        """This part (0 to 1) of the piece of work is done."""
        with self._lock:
            self._part = part
            self._share = max(self._share, min((self._done + part * self._piece) / self.planned, 1.0))
            left = self.left_s()
            self._tell(self._share, words if left is None else f"{words}, about {_rounded(left)} left")

    def left_s(self) -> float | None:
        """Time left [s]; None while too little was done to say."""
        if self._first is None:
            return None
        spent = self._clock() - self._first
        worked = self._worked + (0.0 if self._steps else self._part * self._piece)
        if spent <= TRUSTED_S or not worked:
            return None
        return spent / worked * max(self.planned - self._done - self._part * self._piece, 0.0)


def _rounded(seconds: float) -> str:
    """As exact as such a guess deserves."""
    if seconds < 90.0:
        return f"{max(5 * round(seconds / 5), 5)} s"
    return f"{round(seconds / 60)} min" if seconds < 5400.0 else f"{seconds / 3600:.1f} h"
