"""How well each point is known, judged from the dot's own track.

The noise that a single picture predicts is several times too small: compression, lighting and the pixel
grid err too.  What a smooth motion cannot explain is noise, so differences along the track, in which
slow motion cancels, measure it.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import gammainc, gammaincinv

FLOOR_PX = 0.02  # a still dot repeats its error unseen: its error on the pixel grid is about this large
UNMEASURED_PX = 0.1  # taken where a clip is too short to tell
ENOUGH = 16  # differences; fewer tell the noise no better than a factor of two
ORDERS = (3, 5)  # the fifth cancels the fast swings that the third leaves in, and blurs impacts more


def difference_noise(
    times_s: Float[np.ndarray, "frame"], px: Float[np.ndarray, "frame d"], order: int
) -> Float[np.ndarray, "d d"] | None:
    """Covariance of white noise [px^2], from differences of the given order; None with too few points.

    Of points in space, in metres, it is a covariance in m^2.

    Divided differences, scaled to carry unit noise: they cancel a polynomial in time also where frames are
    unevenly spaced.  Rows with NaN break the chain.  The 5% largest are impacts or blunders and are left out.
    """
    width = order + 1
    if len(times_s) < width + ENOUGH:
        return None
    t = np.lib.stride_tricks.sliding_window_view(times_s, width)
    p = np.lib.stride_tricks.sliding_window_view(px, width, axis=0)
    t = (t - t.mean(1, keepdims=True)) / np.ptp(t, axis=1, keepdims=True)
    apart = t[:, :, None] - t[:, None, :] + np.eye(width)
    weight = 1 / apart.prod(2)
    weight /= np.linalg.norm(weight, axis=1, keepdims=True)
    rest = np.einsum("fw,fdw->fd", weight, p)
    rest = rest[np.isfinite(rest).all(1)]
    if len(rest) < ENOUGH:
        return None
    scale = np.maximum(1.4826 * np.median(np.abs(rest), axis=0), 1e-9)
    size = np.linalg.norm(rest / scale, axis=1)
    cut = np.quantile(size, 0.95)
    kept = rest[size <= cut]
    # A round normal cloud cut at 95% keeps this part of its variance (r^2 / 2 is gamma of order d / 2).
    d = px.shape[1]
    inner = float(gammainc(d / 2 + 1, gammaincinv(d / 2, 0.95))) / 0.95
    return kept.T @ kept / len(kept) / inner


def track_noise(
    times_s: Float[np.ndarray, "frame"], at: Float[np.ndarray, "frame d"]
) -> Float[np.ndarray, "d d"] | None:
    """Covariance of a track's noise, from the order of differences that leaves less motion in; None if too short."""
    tried = [difference_noise(times_s, at, order) for order in ORDERS]
    usable = [c for c in tried if c is not None]
    return min(usable, key=lambda c: float(np.trace(c))) if usable else None


def point_covariance(
    times_s: Float[np.ndarray, "frame"],
    px: Float[np.ndarray, "frame marker 2"],
    single_px2: Float[np.ndarray, "frame marker 2 2"] | None,
    whole: Bool[np.ndarray, "frame marker"],
) -> Float[np.ndarray, "frame marker 2 2"]:
    """Covariance of every point [px^2]: its track's noise, more where a picture was noisier than usual.

    px holds NaN where nothing was seen; single_px2 is what each picture predicts by itself, or None; only `whole`
    points are judged.  A bare dot's pictures tell how far two ways of placing it disagree, which lasts for many
    pictures and so leaves no differences along the track: no point is better than that, on the mean over its
    pictures.
    """
    track = np.where(whole[..., None], px, np.nan)
    noise: list[np.ndarray | None] = []
    for m in range(px.shape[1]):
        noise.append(track_noise(times_s, track[:, m]))
    measured = [c for c in noise if c is not None]
    usual = np.mean(measured, axis=0) if measured else UNMEASURED_PX**2 * np.eye(2)
    own = np.stack([usual if c is None else c for c in noise]) + FLOOR_PX**2 * np.eye(2)
    if single_px2 is None:
        return np.broadcast_to(own, (*whole.shape, 2, 2))
    size = np.trace(single_px2, axis1=2, axis2=3)
    typical = np.nanmedian(np.where(whole, size, np.nan), axis=0) if whole.any(0).all() else np.nanmax(size) + 1
    along = own[None] * np.maximum(1.0, size / typical)[..., None, None]
    seen = whole & np.isfinite(size)
    count = np.maximum(seen.sum(0), 1)[:, None, None]
    told = np.where(seen[..., None, None], single_px2, 0).sum(0) / count
    lasting = np.trace(told, axis1=1, axis2=2) > np.trace(along, axis1=2, axis2=3)
    return np.where(lasting[..., None, None], told[None], along)
