"""The tracks as a table, in the columns that every reader of tracks expects."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

COLUMNS = (
    "time_s", "marker", "x_m", "y_m", "z_m", "sigma_m", "frame",
    "x_px", "y_px", "cov_xx_px2", "cov_xy_px2", "cov_yy_px2", "status",
)  # fmt: skip


def tracks_table(
    markers: Sequence[str],
    times_s: np.ndarray,
    frames: np.ndarray,
    world_m: np.ndarray,
    sigma_m: np.ndarray,
    px: np.ndarray,
    cov_px2: np.ndarray,
    status: np.ndarray,
) -> pd.DataFrame:
    """One row per frame and marker: (frame, marker, ...) arrays; NaN where there is no value.

    times_s (..) each point's own [s], world_m (.., 3) [m], sigma_m (..) one standard deviation per axis [m],
    px (.., 2), cov_px2 (.., 2, 2), status (..) one of observed, occluded, predicted, outlier.
    """
    each = len(markers)
    flat = {
        "time_s": times_s.ravel(),
        "marker": np.tile(np.asarray(markers, object), len(frames)),
        "sigma_m": sigma_m.ravel(),
        "frame": np.repeat(frames, each),
        "cov_xx_px2": cov_px2[..., 0, 0].ravel(),
        "cov_xy_px2": cov_px2[..., 0, 1].ravel(),
        "cov_yy_px2": cov_px2[..., 1, 1].ravel(),
        "status": status.ravel(),
    }
    flat |= {f"{axis}_m": world_m[..., k].ravel() for k, axis in enumerate("xyz")}
    flat |= {f"{axis}_px": px[..., k].ravel() for k, axis in enumerate("xy")}
    return pd.DataFrame({column: flat[column] for column in COLUMNS}, copy=False)


def write_tracks(tracks: pd.DataFrame, path: Path) -> Path:
    """Write CSV; lengths keep a nanometre, times a nanosecond."""
    tracks.to_csv(path, index=False, float_format="%.10g")
    return path
