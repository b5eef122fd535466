"""How many independent values a series is worth."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float


def independent(r: Float[np.ndarray, " n"]) -> float:
    """n/m (1 - a)/(1 + a), a its correlation at the lag m.

    m is the lag at which that is most: one for noise with memory, a quarter of a period for a smooth miss, of which the
    number is the same however finely it is sampled.
    """
    n = r.size
    if n < 2 or not np.any(r):
        return float(n)
    power = np.abs(np.fft.rfft(r, 2 * n)) ** 2
    lag = np.arange(1, max(n // 4, 2))
    a = np.maximum(np.fft.irfft(power)[lag] / float(r @ r), 0.0)
    return float(np.max(n / lag * (1.0 - a) / (1.0 + a)))


def independent_of(r: Float[np.ndarray, " n"], rows: Sequence[slice]) -> float:
    """Of several series one behind the other, as `rows` says."""
    return sum(independent(r[run]) for run in rows)
