"""What an uncertain camera does to places on the bed: an error that all frames of a clip share."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from backend.observe.plane import Plane
from backend.observe.viewpoint import Viewpoint


def placing_slopes(
    view: Viewpoint,
    plane: Plane,
    xy_m: Float[np.ndarray, "n 2"],
    height_m: Float[np.ndarray, "n"],
    marker: Int[np.ndarray, "n"],
    markers: int,
) -> Float[np.ndarray, "n 2 all"]:
    """How far points on the bed are misplaced [m] per error of lens, pose and heights (as in CameraPose.covariance).

    A point at (x, y) and a height, of the marker of that index, is seen by the true camera and placed by `view`.
    """
    toward = np.sign(plane.from_world(view.p_WC)[2])
    by_view, by_point = view.slopes(plane.at(np.c_[xy_m, toward * height_m]))
    axes = plane.axes()
    by_height = np.zeros((len(xy_m), 2, markers))
    by_height[np.arange(len(xy_m)), :, marker] = toward * by_point @ axes[2]
    return np.linalg.solve(by_point @ axes[:2].T, np.concatenate([by_view, by_height], 2))


def placing_sd_m(
    slopes: Float[np.ndarray, "n 2 all"], covariance: Float[np.ndarray, "all all"]
) -> Float[np.ndarray, "n"]:
    """Standard deviation per axis [m] of each place."""
    return np.sqrt(np.einsum("nij,jk,nik->n", slopes, covariance, slopes) / 2)
