"""How long a rolling shutter takes from a picture's first row to its last, told by the motion itself.

Bars keep their lengths.  Read row by row, the ends of a bar that moves along itself are caught at different times, and
the bar seems longer or shorter: 3.5 ms are a millimetre for a bar of a third of the picture at 1 m/s.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from backend.observe.bars import Bar

LONGEST_S = 0.05
CLEAR = 5.0  # deviations from zero, or from what the bed file says
WORTH_S = 2e-4  # 0.1 mm at 1 m/s and half a picture apart
BLOCKS = 16  # of the clip: errors of one block may all be alike, those of two are not
FEWEST = 40  # pictures of a bar


@dataclass(frozen=True)
class Readout:
    """Time from the first row to the last [s], and its deviation."""

    seconds: float
    sd_s: float

    @property
    def clear(self) -> bool:
        """Whether there is a rolling shutter to speak of."""
        return CLEAR * self.sd_s < self.seconds < LONGEST_S and self.seconds > WORTH_S

    def contradicts(self, stated_s: float) -> bool:
        """Whether it is not what a bed file says."""
        return abs(self.seconds - stated_s) > max(CLEAR * self.sd_s, WORTH_S)


def readout_of(
    time_s: Float[np.ndarray, " frame"],
    at_m: Float[np.ndarray, "frame marker 2"],
    row: Float[np.ndarray, "frame marker"],
    bars: Sequence[Bar],
) -> Readout | None:
    """The readout that keeps bars at one length each; None where too little moves, or is seen, to tell.

    at_m: places on the bed, each picture as of one time; NaN where not seen.  row: 0 first, 1 last.

    The length itself is free for every bar, and so is what a lens or a height a little wrong does to it: a change with
    the bar's place and, twice, with its direction.
    """
    if len(time_s) < FEWEST:
        return None
    speed = np.gradient(at_m, time_s, axis=0)
    block = (np.arange(len(time_s)) * BLOCKS) // len(time_s)
    score, power, told = np.zeros(BLOCKS), np.zeros(BLOCKS), []
    for bar in bars:
        apart, middle = at_m[:, bar.a] - at_m[:, bar.b], (at_m[:, bar.a] + at_m[:, bar.b]) / 2
        length = np.hypot(*apart.T)
        late = speed[:, bar.a] * row[:, bar.a, None] - speed[:, bar.b] * row[:, bar.b, None]
        stretch = np.sum(apart * late, 1) / length
        known = np.isfinite(stretch)
        if known.sum() < FEWEST:
            continue
        turn = 2 * np.arctan2(apart[known, 1], apart[known, 0])
        else_ = np.c_[np.ones(known.sum()), middle[known], np.cos(turn), np.sin(turn)]
        Q = _span(else_)
        y, x = (v[known] - Q @ (Q.T @ v[known]) for v in (length, stretch))
        told.append((block[known], x, y))
    if not told:
        return None
    seconds = 0.0
    for _ in range(ROUNDS):  # least squares, far misses counted less (Huber)
        score[:], power[:], spread = 0.0, 0.0, _spread(told, seconds)
        for at, x, y in told:
            left = (y - seconds * x) / spread
            weight = np.minimum(1.0, HUBER / np.maximum(np.abs(left), 1e-12)) / spread**2
            np.add.at(score, at, weight * x * (y - seconds * x))
            np.add.at(power, at, weight * x**2)
        if not power.sum() > 0:
            return None
        seconds += score.sum() / power.sum()
    free = BLOCKS / (BLOCKS - 1)
    return Readout(float(seconds), float(np.sqrt(free * np.sum(score**2)) / power.sum()))


ROUNDS, HUBER = 6, 1.5


def _span(columns: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n r"]:
    U, s, _ = np.linalg.svd(columns / np.linalg.norm(columns, axis=0).clip(1e-300), full_matrices=False)
    return U[:, s > 1e-6 * s[0]]


def _spread(told: list, seconds: float) -> float:
    left = np.concatenate([y - seconds * x for _, x, y in told])
    return max(1.4826 * float(np.median(np.abs(left))), 1e-9)
