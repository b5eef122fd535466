"""Bed tags: marks on the bed that name themselves, found in a picture by their centres."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from backend.observe.kit import tag_dictionary
from backend.observe.tracking_error import TrackingError


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
    return {i: diagonals_meet(np.asarray(c, float).reshape(4, 2)) for i, c in zip(seen, corners, strict=True)}


def _parameters() -> cv2.aruco.DetectorParameters:
    found = cv2.aruco.DetectorParameters()
    # A tag's outer corners refined one by one move inwards by up to 0.8 px, all four alike: their diagonals
    # still meet in the centre.
    found.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    return found


def diagonals_meet(corners_px: Float[np.ndarray, "4 2"]) -> Float[np.ndarray, "2"]:
    """Where the diagonals of a quadrilateral cross: the picture of the square's centre, whatever the view."""
    a, b, c, d = np.c_[corners_px, np.ones(4)]
    x, y, w = np.cross(np.cross(a, c), np.cross(b, d))
    return np.array([x / w, y / w])
