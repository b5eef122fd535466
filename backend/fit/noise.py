"""How noisy is a channel, from the record itself.

Order of trust: the sigma written in the data; the scatter of static frames, while the mechanism is held
still; third differences of the motion. A quantised encoder held still scatters by nothing at all, so every
estimate is floored at quantum / sqrt(12), the standard deviation of rounding (Widrow and Kollár 2008, 1.2).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

MAD_TO_SIGMA = 1.4826  # of a Gaussian
ENOUGH_STATIC = 8  # below this the scatter of static frames is itself 25% uncertain
ROUNDING = 1e-13  # of a channel's largest value: what sums of it scatter by, all equal
FAR = 5.0  # robust sd: a still frame so far from the others is a wild one
FEWEST = 5  # samples that tell a third difference from chance
Source = Literal["given", "static", "third_difference", "others"]


@dataclass(frozen=True)
class Noise:
    """Standard deviation of each sample of one channel, in the channel's unit, and where it came from.

    NaN where the channel cannot tell: it repeats itself, or has too few samples.
    """

    sigma: Float[np.ndarray, " n"]
    source: Source


def channel_noise(
    time_s: Float[np.ndarray, " n"],
    value: Float[np.ndarray, " n"],
    given: Float[np.ndarray, " n"] | None = None,
    release_s: float = -np.inf,
) -> Noise:
    """Noise of one channel; `given` may hold NaN where the data leave sigma empty."""
    given = np.full(value.shape, np.nan) if given is None else np.asarray(given, float)
    known = np.isfinite(given) & (given > 0)
    if np.all(known):
        return Noise(given, "given")
    estimate, source = _estimate(time_s, value, release_s)
    estimate = max(estimate, quantum(value) / np.sqrt(12.0))
    rounding = ROUNDING * float(np.max(np.abs(value)))
    if estimate <= rounding and value.size >= FEWEST:  # a picture coded as it was repeats its places, however far off
        estimate, source = third_difference_sigma(time_s, value), "third_difference"
    if estimate <= rounding:
        estimate = float(np.median(given[known])) if np.any(known) else np.nan
    return Noise(np.where(known, given, estimate), source)


def _estimate(time_s, value, release_s) -> tuple[float, Source]:
    held = value[time_s < release_s]
    if held.size >= ENOUGH_STATIC:
        away = np.abs(held - np.median(held))
        return float(np.std(held[calm(away, away, quantum(value))], ddof=1)), "static"
    return third_difference_sigma(time_s, value) if value.size >= FEWEST else 0.0, "third_difference"


def calm(away: Float[np.ndarray, " n"], alike: Float[np.ndarray, " m"], step: float) -> Bool[np.ndarray, " n"]:
    """Which of still frames, so far off their median, are not wild beside those that are `alike`. step: of a quantised
    channel, whose values may be one for the most part.
    """
    width = MAD_TO_SIGMA * float(np.median(alike)) or step
    return away <= FAR * width if width > 0.0 else np.ones(away.size, bool)


def third_difference_sigma(time_s: Float[np.ndarray, " n"], value: Float[np.ndarray, " n"]) -> float:
    """Robust sigma of white noise on a smooth motion.

    Third divided differences over each four neighbours cancel every quadratic exactly, also on uneven times;
    scaled to unit weight norm they keep the noise's variance. The median ignores impacts and outliers.
    """
    t = np.lib.stride_tricks.sliding_window_view(np.asarray(time_s, float), 4)
    y = np.lib.stride_tricks.sliding_window_view(np.asarray(value, float), 4)
    gaps = t[:, :, None] - t[:, None, :]
    gaps = gaps / np.maximum(gaps.max(axis=(1, 2), keepdims=True), 1e-300)
    weights = 1.0 / np.prod(np.where(np.eye(4, dtype=bool), 1.0, gaps), axis=2)
    weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    return float(MAD_TO_SIGMA * np.median(np.abs(np.sum(weights * y, axis=1))))


def quantum(value: Float[np.ndarray, " n"]) -> float:
    """The step of a quantised channel, or 0 when its values are not multiples of one step.

    A step counts when the differences of all values that repeat are whole multiples of it, to 5%, and enough do (white
    noise on a continuous channel never does); wild samples, which no counter made, stand alone.
    """
    levels, times = np.unique(value, return_counts=True)
    if levels.size < 2 or levels.size > 0.9 * value.size:
        return 0.0
    if np.sum(times > 1) >= FEWEST:
        levels = levels[times > 1]
    steps = np.diff(levels)
    smallest = float(steps[steps > 1e-9 * np.ptp(levels)].min(initial=np.inf))
    if not np.isfinite(smallest):
        return 0.0
    few = steps[steps < 20.0 * smallest] / smallest  # rounding in the file blurs large multiples
    for parts in range(1, 11):  # a channel that moves fast skips counts: its smallest difference holds several
        if np.all(np.abs(parts * few - np.round(parts * few)) < 0.05):
            return smallest / parts
    return 0.0


def lag_one(residual: Float[np.ndarray, " n"]) -> float:
    """AR(1) coefficient of a residual series: 0 for white noise, near 1 for slow misfit."""
    r = residual - residual.mean()
    power = float(r @ r)
    return float(np.clip(r[1:] @ r[:-1] / power, -0.99, 0.999)) if power > 0 and r.size > 2 else 0.0


def whiten_ar1(rows: Float[np.ndarray, "n ..."], coefficient: float) -> Float[np.ndarray, "n ..."]:
    """Rows of an AR(1) series as independent unit rows (Prais and Winsten 1954). Linear: serves r and J.

    The marginal variance stays 1: innovations are divided by sqrt(1 - coefficient^2).
    """
    innovation = np.sqrt(1.0 - coefficient**2)
    return np.concatenate([rows[:1], (rows[1:] - coefficient * rows[:-1]) / innovation])


def whiten_ar1_transposed(weight: Float[np.ndarray, " n"], coefficient: float) -> Float[np.ndarray, " n"]:
    """W' weight, where W rows = whiten_ar1(rows)."""
    after = weight[1:] / np.sqrt(1.0 - coefficient**2)
    return np.concatenate([weight[:1], after]) - coefficient * np.concatenate([after, np.zeros(1)])
