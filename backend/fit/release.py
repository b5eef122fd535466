"""Where an experiment begins: coordinates and velocities, with covariance, from its first samples alone.

Held still, the static frames average to the start pose and the velocity is zero. Already moving, a local
polynomial over the first window gives both. These are starting values: a fitted experiment refines them,
a held-out one may not look any further.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from backend.fit.noise import quantum
from backend.fit.wild import agreeing

DEGREE = 3  # a window of a third of a period needs curvature and its change
FEW = 10  # samples below which a cubic is no longer checked by its window


@dataclass(frozen=True)
class ChannelStart:
    """Value and rate of one channel at the release, with standard deviations (0 for a rate known)."""

    value: float
    rate: float
    value_sd: float
    rate_sd: float
    samples: int


def held_still(
    time_s: Float[np.ndarray, " n"],
    value: Float[np.ndarray, " n"],
    sigma: Float[np.ndarray, " n"],
    release_s: float,
) -> ChannelStart:
    """Weighted mean of the static frames without wild ones; the first sample serves alone where none precedes the
    release.

    Raises ValueError for an empty channel.
    """
    if value.size == 0:
        raise ValueError("No sample to start from: the channel is empty.")
    still = time_s < release_s
    if not np.any(still):
        still = time_s <= time_s[0]
    value, sigma = value[still], sigma[still]
    # The scatter of static frames, which sigma may be, holds a wild one; a count up or down is none.
    rounding = quantum(value) / np.sqrt(12.0) / float(np.median(sigma))
    kept = agreeing(1.0 / sigma[:, None], value / sigma, rounding)
    weight = kept / sigma**2
    return ChannelStart(float(weight @ value / weight.sum()), 0.0, float(weight.sum() ** -0.5), 0.0, int(kept.sum()))


def moving(
    time_s: Float[np.ndarray, " n"],
    value: Float[np.ndarray, " n"],
    sigma: Float[np.ndarray, " n"],
    release_s: float,
    window_s: float = 0.3,
) -> ChannelStart:
    """Weighted local polynomial over [release, release + window], read off at the release.

    Degree 3, less where samples are few. A window longer than a cubic can follow without its wild samples is halved
    until it can (chi within three of its own sd) or few samples are left. Raises ValueError with fewer than two samples
    in the window.
    """
    span, found = window_s, None
    while True:
        inside = (time_s >= release_s) & (time_s <= release_s + span)
        n = int(inside.sum())
        if found is not None and n < FEW:
            return found
        if n < 2:
            raise ValueError(
                f"{n} sample(s) within {span:g} s of the release at {release_s:g} s: a velocity needs two. "
                "Lengthen release.window_s."
            )
        u, degree = (time_s[inside] - release_s) / span, min(DEGREE, n - 1)
        A, b = np.vander(u, degree + 1, increasing=True) / sigma[inside, None], value[inside] / sigma[inside]
        found, follows = _polynomial(A, b, span)
        if not follows and not np.all(kept := agreeing(A, b, 1.0)):
            found, follows = _polynomial(A[kept], b[kept], span)
        if follows:
            return found
        span *= 0.5


def _polynomial(A: np.ndarray, b: np.ndarray, span_s: float) -> tuple[ChannelStart, bool]:
    """Value and rate where the window begins, and whether its samples follow; rows in sigmas, time in spans."""
    (n, terms), rest = A.shape, max(A.shape[0] - A.shape[1], 1)
    c, *_ = np.linalg.lstsq(A, b, rcond=None)
    cov = np.linalg.pinv(A.T @ A)
    miss = float(np.sqrt(np.sum((A @ c - b) ** 2) / rest))
    sd = np.sqrt(np.diag(cov))
    rate, rate_sd = (c[1], sd[1]) if terms > 1 else (0.0, np.inf)
    start = ChannelStart(float(c[0]), float(rate / span_s), float(sd[0]), float(rate_sd / span_s), n)
    return start, miss < 1.0 + 3.0 / np.sqrt(2.0 * max(n - DEGREE - 1, 1))
