"""What noise remembers from one sample to the next.

A tracker's error is seldom of one kind: a part is new in every frame, another, of light, compression or a shaken stand,
fades over several. A share of the variance is then an AR(1) series and the rest is white (an ARMA(1, 1) series in all),
whose correlation starts low and falls slowly; AR(1) alone would take what fades slowly for motion.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import minimize
from scipy.special import expit, logit

BEYOND_CHANCE = 4.0  # log likelihood by which a white part has to be the better account
LONGEST = 128  # samples of a series that are read at once
BEGIN = [(share, a) for share in (0.15, 0.3, 0.5, 0.7) for a in (0.6, 0.8, 0.93)]
CLOSE = 1e-2  # of share and coefficient, in log odds
STEEP = 1e3  # times what short series lose beyond their bound


@dataclass(frozen=True)
class Memory:
    """share: of the variance that is remembered. coefficient: how much of it is left after one sampling interval."""

    coefficient: float = 0.0
    share: float = 1.0

    def __bool__(self) -> bool:
        return self.coefficient * self.share != 0.0

    def foretelling(self, intervals: Float[np.ndarray, " n-1"]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(n) each: how much of what is remembered lasts until a sample, how far an innovation is believed to be
        remembered, and its sd, of a series of unit variance (Kalman 1960).
        """
        lasts = np.concatenate([[0.0], self.coefficient**intervals])
        believed, width, known = np.ones(lasts.size), np.ones(lasts.size), 0.0
        for i, last in enumerate(lasts.tolist()):
            spread = self.share * (1.0 - last**2) + last**2 * known
            whole = spread + 1.0 - self.share
            believed[i], width[i] = spread / whole, whole
            known = spread * (1.0 - spread / whole)
        return lasts, believed, np.sqrt(width)

    def mean_takes(self, count: int) -> float:
        """How many samples' worth of variance the mean of so many takes away."""
        lags = np.arange(1, count)
        return float(1.0 + 2.0 * self.share * np.sum((1.0 - lags / count) * self.coefficient**lags)) if self else 1.0


@dataclass(frozen=True)
class Series:
    """Short series about an unknown mean each, those that were sampled alike together: when, in sampling intervals, and
    values, one column each.
    """

    groups: tuple[tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n series"]], ...]

    @classmethod
    def of(cls, series: Sequence[Float[np.ndarray, " n"]], intervals: Sequence[Float[np.ndarray, " n"]]) -> Series:
        """intervals: when each sample was taken, in sampling intervals."""
        alike: dict[tuple[float, ...], list[np.ndarray]] = {}
        for values, at in zip(series, intervals, strict=True):
            for k in range(0, values.size, LONGEST):
                when = at[k : k + LONGEST]
                if when.size > 2:
                    alike.setdefault(tuple(np.round(when - when[0], 1)), []).append(values[k : k + LONGEST])
        return cls(tuple((np.array(when), np.stack(many, 1)) for when, many in alike.items()))

    @property
    def still(self) -> bool:
        """Whether none of them varies."""
        return not any(np.ptp(many, axis=0).any() for _, many in self.groups)

    def surprise(self, memory: Memory) -> float:
        """Minus the restricted log likelihood of a memory (Patterson and Thompson 1971), of whichever sd."""
        squares, free, width = self._read(memory)
        return 0.5 * (free * np.log(squares / free) + width)

    def sd(self, memory: Memory) -> float:
        """What one sample varies by, had they this memory."""
        squares, free, _ = self._read(memory)
        return float(np.sqrt(squares / free))

    def _read(self, memory: Memory) -> tuple[float, int, float]:
        squares, free, width = 0.0, 0, 0.0
        for when, many in self.groups:
            kept = memory.share * memory.coefficient ** np.abs(when[:, None] - when)
            root = cholesky(kept + (1.0 - memory.share) * np.eye(when.size), lower=True)
            white = solve_triangular(root, np.column_stack([np.ones(when.size), many]), lower=True)
            level, rows = white[:, 0], white[:, 1:]
            squares += float(np.sum(rows**2) - np.sum((level @ rows) ** 2) / (level @ level))
            width += many.shape[1] * (2.0 * float(np.sum(np.log(np.diag(root)))) + np.log(level @ level))
            free += rows.size - many.shape[1]
        return squares, free, width


def remembered(
    series: Sequence[Float[np.ndarray, " n"]], intervals: Sequence[Float[np.ndarray, " n"]], plain: float
) -> Memory:
    """Memory of short series: AR(1) with the coefficient `plain`, unless a white part beside it is plainly the better
    account. intervals: when each sample was taken, in sampling intervals.
    """
    told = Series.of(series, intervals)
    if told.still:
        return Memory()
    begin = min((_odds(Memory(a, share)) for share, a in BEGIN), key=lambda odds: told.surprise(_of(odds)))
    found, alone = _likeliest(told.surprise, begin), Memory(plain)
    return found if told.surprise(alone) - told.surprise(found) > BEYOND_CHANCE else alone


def bettered(known: Memory, short: Series, long: Series, open_: float) -> Memory:
    """The memory that longer series have, as far as the short ones leave it open: nothing slow is told by these, but
    what the longer ones hold besides noise has a memory, too. open_: log likelihood that may be lost of the short ones.
    """
    bound = short.surprise(known) + open_
    beyond = lambda memory: max(short.surprise(memory) - bound, 0.0)  # noqa: E731
    found = _likeliest(lambda memory: long.surprise(memory) + STEEP * beyond(memory), _odds(known))
    return found if beyond(found) < open_ and long.surprise(found) < long.surprise(known) else known


def _likeliest(surprise: Callable[[Memory], float], begin: Float[np.ndarray, " 2"]) -> Memory:
    return _of(minimize(lambda odds: surprise(_of(odds)), begin, method="Nelder-Mead", options={"xatol": CLOSE}).x)


def _of(odds: Float[np.ndarray, " 2"]) -> Memory:
    share, a = expit(np.clip(odds, -6.0, 6.0))
    return Memory(float(min(a, 0.98)), float(share))


def _odds(memory: Memory) -> Float[np.ndarray, " 2"]:
    return np.array([logit(memory.share), logit(memory.coefficient)])
