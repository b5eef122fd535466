"""Least squares for a lens over views of one printed board (Zhang 2000), which need not be quite flat.

Paper on a plate bends: 0.3 mm over the board would move the focal length by 0.5% and hardly show in the misfit.
The board's height is therefore fitted too, as a quadratic in its plane.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from jaxtyping import Bool, Float

from backend.observe.board_views import BoardView
from backend.observe.kit import BOARD_COLUMNS, BOARD_ROWS, BOARD_SQUARE_M, board_corners_m
from backend.observe.tracking_error import TrackingError

NOTICEABLE = 3.0  # standard deviations below which k3 is left at zero: far out it would only carry noise
PASSES = 3  # the bend is nearly linear in the pixels: the third pass would move it by less than a micrometre
HALF_M = BOARD_SQUARE_M * np.array([BOARD_COLUMNS, BOARD_ROWS]) / 2


@dataclass(frozen=True)
class LensFit:
    """Values and covariance in the order of camera.PARAMETERS; misfit [px]; the board's greatest bend [m]."""

    values: Float[np.ndarray, "9"]
    covariance: Float[np.ndarray, "9 9"]
    rms_px: float
    view_rms_px: Float[np.ndarray, "view"]
    bend_m: float


def fit_lens(views: Sequence[BoardView], size_px: tuple[int, int]) -> LensFit:
    """The lens that explains all views; k3 stays zero where they do not show it.

    Raises TrackingError where the views settle no lens.
    """
    fit = _fit(views, size_px, 0)
    if abs(fit.values[8]) < NOTICEABLE * np.sqrt(fit.covariance[8, 8]):
        fit = _fit(views, size_px, cv2.CALIB_FIX_K3)
    return fit


def _shape(board_m: Float[np.ndarray, "corner 3"]) -> Float[np.ndarray, "corner 3"]:
    """How the corners rise with each of the three bends; what is linear belongs to the pose."""
    u, v = ((board_m[:, :2] - HALF_M) / HALF_M.max()).T
    return np.stack([u**2, u * v, v**2], 1)


def _raised(view: BoardView, bend_m: Float[np.ndarray, "3"]) -> Float[np.ndarray, "corner 3"]:
    return view.board_m + np.outer(_shape(view.board_m) @ bend_m, [0, 0, 1])


def _fit(views: Sequence[BoardView], size_px: tuple[int, int], flags: int) -> LensFit:
    seen = [v.px.astype(np.float32) for v in views]
    free = np.r_[np.ones(8, bool), not flags & cv2.CALIB_FIX_K3]
    K: Any = None
    bends: Any = None
    bend = np.zeros(3)
    for k in range(PASSES):
        board = [_raised(v, bend).astype(np.float32) for v in views]
        try:
            rms, K, bends, turns, shifts, _, _, each = cv2.calibrateCameraExtended(
                board, seen, size_px, K, bends, flags=flags | (cv2.CALIB_USE_INTRINSIC_GUESS if k else 0)
            )
            step, covariance = _normal(views, bend, K, bends, turns, shifts, free)
        except (cv2.error, np.linalg.LinAlgError) as error:
            raise TrackingError(
                f"The {len(views)} views of the board settle no lens: {str(error).strip()}. Film it leaning to all "
                "sides, in the middle, edges and corners of the picture."
            ) from error
        if k < PASSES - 1:
            bend = bend + step
    bends = np.ravel(bends)[:5]
    values = np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2], *bends])
    full = np.zeros((9, 9))
    full[np.ix_(free, free)] = covariance
    heights = _shape(board_corners_m()) @ bend
    return LensFit(values, full, float(rms), np.ravel(each), float(np.ptp(heights)))


def _normal(
    views: Sequence[BoardView],
    bend_m: Float[np.ndarray, "3"],
    K: Any,
    bends: Any,
    turns: Any,
    shifts: Any,
    free: Bool[np.ndarray, "9"],
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "free free"]]:
    """The next step of the bend, and the lens's covariance with bend and poses set free (Schur complement).

    Each view's own pull on the lens is summed as well: corners of one picture err together, and counting them
    as independent would promise too much (White 1980).  The wider of the two deviations counts.
    """
    count = int(free.sum()) + 3
    information, pulls, squares, corners = np.zeros((count, count)), [], 0.0, 0
    for view, turn, shift in zip(views, turns, shifts, strict=True):
        at = _raised(view, bend_m)
        px, slope = cv2.projectPoints(at, turn, shift, K, bends)
        rise = np.array([0.0, 0.0, 1e-5])
        up, down = (cv2.projectPoints(at + d, turn, shift, K, bends)[0].reshape(-1, 2) for d in (rise, -rise))
        lift = ((up - down) / (2 * rise[2]))[:, :, None] * _shape(view.board_m)[:, None]
        pose, rest = slope[:, :6], np.c_[slope[:, 6:15][:, free], lift.reshape(-1, 3)]
        rest = rest - pose @ np.linalg.lstsq(pose, rest, rcond=None)[0]
        left = (view.px - px.reshape(-1, 2)).ravel()
        information += rest.T @ rest
        pulls.append(rest.T @ left)
        squares, corners = squares + float(left @ left), corners + len(left) - 6
    inverse = np.linalg.inv(information)
    gathered = np.array(pulls)
    independent = inverse * squares / (corners - count)
    together = inverse @ (gathered.T @ gathered) @ inverse * len(views) / (len(views) - 1)
    wider = np.sqrt(np.maximum(1.0, np.diag(together) / np.diag(independent)))
    covariance = independent * np.outer(wider, wider)
    return inverse[-3:] @ gathered.sum(0), covariance[:-3, :-3]
