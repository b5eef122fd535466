"""The dots of a picture as of one time, although a rolling shutter reads their rows one after another.

The ends of a bar keep their distance at one time only: at 1 m/s a millisecond is a millimetre.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from jaxtyping import Float

COVARIANCE = ("cov_xx_px2", "cov_xy_px2", "cov_xy_px2", "cov_yy_px2")


def pictures(
    tracks: pd.DataFrame, markers: Sequence[str], usual_px2: float
) -> tuple[Float[np.ndarray, "frame marker 2"], Float[np.ndarray, "frame marker 2 2"]]:
    """Pixels of every marker in every picture at the middle of the dots' times, NaN where unseen, and covariances.

    tracks: rows of markers that were seen; a picture is one value of `frame`, or of `time_s` where that is missing.
    usual_px2: variance per axis where the tracks state none.
    """
    frame, row = np.unique(tracks["frame" if "frame" in tracks else "time_s"].to_numpy(float), return_inverse=True)
    index = {name: k for k, name in enumerate(markers)}
    column = np.array([index[str(name)] for name in tracks["marker"]], int)
    shape = (len(frame), len(markers))
    px, time_s = np.full((*shape, 2), np.nan), np.full(shape, np.nan)
    px[row, column], time_s[row, column] = tracks[["x_px", "y_px"]].to_numpy(float), tracks["time_s"].to_numpy(float)
    cov = np.broadcast_to(usual_px2 * np.eye(2), (*shape, 2, 2)).copy()
    if COVARIANCE[0] in tracks:
        given = tracks[list(COVARIANCE)].to_numpy(float).reshape(-1, 2, 2)
        cov[row, column] = np.where(np.isfinite(given), given, cov[row, column])
    return at_one_time(time_s, px), cov


def at_one_time(
    time_s: Float[np.ndarray, "frame marker"], px: Float[np.ndarray, "frame marker 2"]
) -> Float[np.ndarray, "frame marker 2"]:
    """Every point carried to the median time of its picture, along the parabola through three pictures.

    A point that is not of that time and lacks a neighbour becomes NaN; so do all of a picture without points.
    """
    seen = np.isfinite(time_s).any(1)
    middle = np.full(len(time_s), np.nan)
    middle[seen] = np.nanmedian(time_s[seen], axis=1)
    late = middle[:, None] - time_s
    made = np.where((late == 0)[..., None], px, np.nan)
    if len(px) < 3:
        return made
    t, u = (np.stack([v[:-2], v[1:-1], v[2:]]) for v in (time_s, px))
    at = middle[1:-1, None]
    weight = [
        (at - t[j]) * (at - t[k]) / ((t[i] - t[j]) * (t[i] - t[k])) for i, j, k in ((0, 1, 2), (1, 0, 2), (2, 0, 1))
    ]
    carried = np.einsum("ifm,ifmd->fmd", np.stack(weight), u)
    made[1:-1] = np.where((late[1:-1] == 0)[..., None], px[1:-1], carried)
    return made
