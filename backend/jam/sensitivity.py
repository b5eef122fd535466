"""Samples of an ensemble, and the share that each parameter has in whether they jam: Sobol' indices.

The first part of the table are Saltelli's matrices A, B and, for every parameter, A with its column of B; the rest
is drawn independently.  Indices: `scipy.stats.sobol_indices`.  Sources: Saltelli et al. (2010), Variance based
sensitivity analysis of model output; Owen (1998), scrambled nets.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy import stats

from backend.jam.distribution import Truncated

FEWEST = 16  # rows of A: with fewer, an index may as well be guessed
RESAMPLES = 400  # of the bootstrap: its 95% limits are then known to a tenth of their distance


@dataclass(frozen=True)
class Design:
    """values: one row a sample, SI.  rows: n of A and B, a power of two, or 0 where samples are too few for indices."""

    values: Float[np.ndarray, "samples parameters"]
    rows: int

    @property
    def independent(self) -> Bool[np.ndarray, "samples"]:
        """All but the mixed matrices, whose samples share all columns but one with one of A."""
        mask = np.ones(len(self.values), dtype=bool)
        mask[2 * self.rows : (2 + self.values.shape[1]) * self.rows] = False
        return mask


@dataclass(frozen=True)
class Indices:
    """First-order and total share of each parameter in the variance of jammed (1) or free (0), with 95% intervals."""

    first: Float[np.ndarray, "parameters"]
    total: Float[np.ndarray, "parameters"]
    first_ci95: Float[np.ndarray, "parameters 2"]
    total_ci95: Float[np.ndarray, "parameters 2"]
    rows: int


def design(distributions: Sequence[Truncated], samples: int, seed: int) -> Design:
    """A table of exactly so many samples; n (d + 2) of them serve the indices, n the largest power of two that fits."""
    d = len(distributions)
    rng = np.random.default_rng(seed)
    n = 1 << max(samples // (d + 2), 1).bit_length() - 1
    if n < FEWEST:
        return Design(_placed(distributions, rng.random((samples, d))), 0)
    both = stats.qmc.Sobol(2 * d, rng=rng).random(n)
    a, b = both[:, :d], both[:, d:]
    mixed = np.tile(a, (d, 1, 1))
    mixed[np.arange(d), :, np.arange(d)] = b.T
    rest = rng.random((samples - n * (d + 2), d))
    return Design(_placed(distributions, np.concatenate([a, b, mixed.reshape(-1, d), rest])), n)


def _placed(distributions: Sequence[Truncated], shares: np.ndarray) -> np.ndarray:
    inside = np.clip(shares, 1e-12, 1 - 1e-12)  # a net may hold 0 itself, whose quantile is infinite
    return np.stack([one.ppf(inside[:, k]) for k, one in enumerate(distributions)], axis=1)


def indices(table: Design, jammed: Bool[np.ndarray, "samples"], lost: Bool[np.ndarray, "samples"]) -> Indices | None:
    """Indices of an ensemble's verdicts; None where there are none: too few samples, or all came out alike."""
    n, d = table.rows, table.values.shape[1]
    if n == 0:
        return None
    outcome = jammed[: n * (d + 2)].astype(float).reshape(d + 2, n)
    known = ~lost[: n * (d + 2)].reshape(d + 2, n).any(axis=0)
    if not known.any() or np.ptp(outcome[:2, known]) == 0.0:
        return None
    # A row that lost a sample is set to the mean throughout: numerator and variance lose it alike, so that their
    # ratio is that of the rows without it, while n stays the power of two that scipy asks for.
    outcome[:, ~known] = outcome[:2, known].mean()
    first, total = _sobol(outcome, np.arange(n))
    rng = np.random.default_rng(0)
    again = np.array([_sobol(outcome, rng.integers(0, n, n)) for _ in range(RESAMPLES)])
    low, high = np.quantile(again, [0.025, 0.975], axis=0)
    return Indices(first, total, np.stack([low[0], high[0]], -1), np.stack([low[1], high[1]], -1), int(known.sum()))


def _sobol(outcome: Float[np.ndarray, "matrices n"], rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    chosen = outcome[:, None, rows]
    found = stats.sobol_indices(func={"f_A": chosen[0], "f_B": chosen[1], "f_AB": chosen[2:]}, n=len(rows))
    return np.atleast_1d(found.first_order), np.atleast_1d(found.total_order)
