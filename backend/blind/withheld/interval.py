"""95% intervals of scores: Wilson's of a share (1927), the percentile bootstrap of anything else (Efron 1979)."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

Z95 = 1.959963984540054


def wilson(hits: int, count: int) -> tuple[float, float]:
    """Interval of a share; all of [0, 1] of nothing."""
    if not count:
        return 0.0, 1.0
    share, z2 = hits / count, Z95**2
    middle = (share + z2 / (2 * count)) / (1 + z2 / count)
    half = Z95 * np.sqrt(share * (1 - share) / count + z2 / (4 * count**2)) / (1 + z2 / count)
    return max(0.0, float(middle - half)), min(1.0, float(middle + half))


def bootstrap(
    values: Sequence[float], statistic: Callable[[np.ndarray], float], draws: int = 2000
) -> tuple[float, float]:
    """Interval of a statistic of independent values; nan of nothing."""
    if not len(values):
        return float("nan"), float("nan")
    rng, data = np.random.default_rng(0), np.asarray(values, float)
    many = [statistic(data[rng.integers(0, len(data), len(data))]) for _ in range(draws)]
    low, high = np.percentile(many, [2.5, 97.5])
    return float(low), float(high)
