"""What noise remembers from one sample to the next.

A tracker's error is seldom of one kind: a part is new in every frame, another, of light, compression or a shaken stand,
fades over several. A share of the variance is then an AR(1) series and the rest is white (an ARMA(1, 1) series in all),
whose correlation starts low and falls slowly; AR(1) alone would take what fades slowly for motion.
"""

from __future__ import annotations

from collections.abc import Sequence
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


def remembered(
    series: Sequence[Float[np.ndarray, " n"]], intervals: Sequence[Float[np.ndarray, " n"]], plain: float
) -> Memory:
    """Memory of short series about an unknown mean each, by restricted likelihood (Patterson and Thompson 1971): AR(1)
    with the coefficient `plain`, unless a white part beside it is plainly the better account.

    intervals: when each sample was taken, in sampling intervals.
    """
    alike: dict[tuple[float, ...], list[np.ndarray]] = {}
    for values, at in zip(series, intervals, strict=True):
        for k in range(0, values.size, LONGEST):
            when = at[k : k + LONGEST]
            if when.size > 2:
                alike.setdefault(tuple(np.round(when - when[0], 1)), []).append(values[k : k + LONGEST])
    groups = [(np.array(when), np.stack(many, 1)) for when, many in alike.items()]
    if not any(np.ptp(many, axis=0).any() for _, many in groups):
        return Memory()

    def surprise(memory: Memory) -> float:
        squares, free, width = 0.0, 0, 0.0
        for when, many in groups:
            kept = memory.share * memory.coefficient ** np.abs(when[:, None] - when)
            root = cholesky(kept + (1.0 - memory.share) * np.eye(when.size), lower=True)
            white = solve_triangular(root, np.column_stack([np.ones(when.size), many]), lower=True)
            level, rows = white[:, 0], white[:, 1:]
            squares += float(np.sum(rows**2) - np.sum((level @ rows) ** 2) / (level @ level))
            width += many.shape[1] * (2.0 * float(np.sum(np.log(np.diag(root)))) + np.log(level @ level))
            free += rows.size - many.shape[1]
        return 0.5 * (free * np.log(squares / free) + width)

    def of(odds: np.ndarray) -> Memory:
        share, a = expit(np.clip(odds, -6.0, 6.0))
        return Memory(float(min(a, 0.98)), float(share))

    begin = min((np.array([logit(share), logit(a)]) for share, a in BEGIN), key=lambda odds: surprise(of(odds)))
    found = of(minimize(lambda odds: surprise(of(odds)), begin, method="Nelder-Mead", options={"xatol": CLOSE}).x)
    alone = Memory(plain)
    return found if surprise(alone) - surprise(found) > BEYOND_CHANCE else alone
