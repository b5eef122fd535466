"""Bars do not stretch: the distance of two dots on one bar tells what errors the tracks really have.

Differences along one track see only what changes from picture to picture.  Compression errs for many pictures in a row;
the distance of two dots that one body carries shows that too, whatever the motion and the play of the pins.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from jaxtyping import Float

ENOUGH = 40  # distances; fewer tell no factor
MOST = 25.0


def stretch_factor(
    at_m: Float[np.ndarray, "frame marker 2"],
    sigma_m: Float[np.ndarray, "frame marker"],
    bodies: Sequence[str],
) -> float:
    """How many times larger the tracks' variances are than stated, at least 1; NaN points are left out.

    bodies: what carries each marker.  The constant part of a distance (a sticker out of place) does not count.
    """
    ratio = []
    for a, b in combinations(range(len(bodies)), 2):
        if bodies[a] != bodies[b]:
            continue
        length = np.hypot(*(at_m[:, a] - at_m[:, b]).T)
        known = np.isfinite(length)
        if known.sum() >= ENOUGH:
            off = length[known] - np.median(length[known])
            ratio.append(off**2 / (sigma_m[known, a] ** 2 + sigma_m[known, b] ** 2))
    if not ratio:
        return 1.0
    squared = np.concatenate(ratio)
    usual = squared[squared <= np.quantile(squared, 0.99)]  # a blunder is no measure of noise
    return float(np.clip(usual.mean() / TRIMMED, 1.0, MOST))


TRIMMED = 0.925  # what is left of a chi-square of one degree's mean without its largest hundredth
