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
UNLIKE = 100.0  # dots that come apart by ten deviations are not on one bar, whatever the drawing says


def stretch_factor(
    at_m: Float[np.ndarray, "frame marker 2"],
    time_s: Float[np.ndarray, "frame marker"],
    sigma_m: Float[np.ndarray, "frame marker"],
    bodies: Sequence[str],
) -> float:
    """How many times larger the tracks' variances are than stated, at least 1; NaN points are left out.

    time_s: each point's own; a rolling shutter sees the ends of a bar one after the other.
    bodies: what carries each marker.  The constant part of a distance (a sticker out of place) does not count.
    """
    ratio, middle = [], np.median(time_s, axis=1, keepdims=True)
    if len(at_m) < ENOUGH:
        return 1.0
    span = np.diff(time_s, axis=0)
    speed = np.diff(at_m, axis=0) / span[..., None]
    speed = 0.5 * (np.concatenate([speed[:1], speed]) + np.concatenate([speed, speed[-1:]]))
    at_m = at_m - speed * (time_s - middle)[..., None]
    for a, b in combinations(range(len(bodies)), 2):
        if bodies[a] != bodies[b]:
            continue
        length = np.hypot(*(at_m[:, a] - at_m[:, b]).T)
        known = np.isfinite(length)
        if known.sum() >= ENOUGH:
            off = length[known] - np.median(length[known])
            squared = off**2 / (sigma_m[known, a] ** 2 + sigma_m[known, b] ** 2)
            if np.median(squared) < UNLIKE:
                ratio.append(squared)
    if not ratio:
        return 1.0
    squared = np.concatenate(ratio)
    usual = squared[squared <= np.quantile(squared, 0.99)]  # a blunder is no measure of noise
    return float(np.clip(usual.mean() / TRIMMED, 1.0, MOST))


TRIMMED = 0.925  # what is left of a chi-square of one degree's mean without its largest hundredth
