"""Bed tags: marks on the bed that name themselves, found in a picture by their centres."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from backend.observe.kit import tag_cells, tag_dictionary
from backend.observe.tracking_error import TrackingError

MARGIN = 1  # cells of white round the tag that belong to what is laid over the picture
SOFT_PX = 5  # both are blurred by this window: the picture's sharpness is not the pattern's
ENOUGH = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 60, 1e-7)


def find_tags(luma: UInt8[np.ndarray, "h w"]) -> dict[int, Float[np.ndarray, "2"]]:
    """Centre [px] of every tag of the kit's family, by id.

    Raises TrackingError where an id is seen twice: two prints of one tag cannot be told apart.
    """
    corners, ids, _ = cv2.aruco.ArucoDetector(tag_dictionary(), _parameters()).detectMarkers(luma)
    seen = [int(i) for i in np.ravel(ids)] if ids is not None else []
    if twice := sorted({i for i in seen if seen.count(i) > 1}):
        raise TrackingError(
            f"Bed tag {', '.join(map(str, twice))} is seen twice in the picture; cover or remove one of the two."
        )
    return {i: _centre(luma, i, np.asarray(c, float).reshape(4, 2)) for i, c in zip(seen, corners, strict=True)}


def _parameters() -> cv2.aruco.DetectorParameters:
    found = cv2.aruco.DetectorParameters()
    found.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_CONTOUR
    return found


def _centre(luma: UInt8[np.ndarray, "h w"], tag: int, corners_px: Float[np.ndarray, "4 2"]) -> Float[np.ndarray, "2"]:
    """The centre of the printed pattern, laid over the picture where they correlate best.

    Outlines alone are whole pixels: the diagonals of their corners meet up to 0.2 px from the centre.  The
    pattern moves under a homography (Evangelidis and Psarakis 2008), whatever the light's level and contrast.
    """
    side = float(np.hypot(*(np.roll(corners_px, -1, 0) - corners_px).T).mean())
    cells = np.pad(tag_cells(tag), MARGIN)
    scale = max(3, round(side / (len(cells) - 2 * MARGIN)))  # the picture's own resolution
    pattern = np.where(np.kron(cells, np.ones((scale, scale))), 30, 200).astype(np.float32)
    edge, length = MARGIN * scale - 0.5, len(pattern) - 2 * MARGIN * scale
    square = edge + length * np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)
    low = np.maximum(np.floor(corners_px.min(0) - side / 3), 0).astype(int)
    high = np.ceil(corners_px.max(0) + side / 3).astype(int)
    crop = luma[low[1] : high[1] + 1, low[0] : high[0] + 1].astype(np.float32)
    start = cv2.getPerspectiveTransform(square, (corners_px - low).astype(np.float32)).astype(np.float32)
    every = np.full(crop.shape, 255, np.uint8)
    middle = np.array([*square.mean(0), 1.0])
    try:
        _, laid = cv2.findTransformECC(pattern, crop, start.copy(), cv2.MOTION_HOMOGRAPHY, ENOUGH, every, SOFT_PX)
    except cv2.error:  # no better place than the outline's
        laid = start
    guess, centre = (np.asarray(H, float) @ middle for H in (start, laid))
    guess, centre = guess[:2] / guess[2], centre[:2] / centre[2]
    return low + (centre if np.hypot(*(centre - guess)) < side / 16 else guess)
