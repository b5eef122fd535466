"""Bed tags: marks on the bed that name themselves, found in a picture by their centres."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from backend.observe.kit import tag_cells, tag_dictionary
from backend.observe.project import apply
from backend.observe.tag_names import FAMILIES, KIT, Tag
from backend.observe.tracking_error import TrackingError

MARGIN = 1  # cells of white round the tag that belong to what is laid over the picture
SOFT_PX = 5  # both are blurred by this window: the picture's sharpness is not the pattern's
LEAST_PX = 12  # a side; fewer pixels hold no tag
ENOUGH = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 60, 1e-7)


class Laid(NamedTuple):
    """A tag's pattern where it lies in a picture: centre and corners [px], and how well the two correlate."""

    centre_px: Float[np.ndarray, "2"]
    corners_px: Float[np.ndarray, "4 2"]
    alike: float


def find_tags(luma: UInt8[np.ndarray, "h w"], asked: Collection[Tag] = ()) -> dict[Tag, Laid]:
    """Every tag of the kit's family, or of the families of those that are asked for.

    Raises TrackingError where one of these is seen twice: two prints of one tag cannot be told apart. Others may be:
    families of few cells are read into what is none.
    """
    families = dict.fromkeys(tag.family for tag in asked) or (KIT,)
    seen = [found for family in families for found in outlines(luma, family)]
    names = [tag for tag, _ in seen]
    if twice := sorted({tag for tag in names if names.count(tag) > 1 and (tag in asked or not asked)}):
        raise TrackingError(
            f"Bed tag {', '.join(map(str, twice))} is seen twice in the picture; cover or remove one of the two."
        )
    return {i: lay(luma, i, corners) for i, corners in seen}


def of_other_family(luma: UInt8[np.ndarray, "h w"], tags: Sequence[Tag]) -> str:
    """A sentence where most of these numbers are seen in another family's patterns; "" where they are not."""
    numbers, asked = {t.number for t in tags}, {t.family for t in tags}
    for family in FAMILIES:
        seen = {tag.number for tag, _ in outlines(luma, family)} if family not in asked else set()
        if 2 * len(seen & numbers) > len(numbers):
            told = ", ".join(map(str, sorted(seen & numbers)))
            return f' Tags {told} of {family} are seen: name them "{family}:{min(seen & numbers)}".'
    return ""


def outlines(
    luma: UInt8[np.ndarray, "h w"],
    family: str = KIT,
    about_px: Float[np.ndarray, "2"] | None = None,
    reach_px: float = 0.0,
) -> list[tuple[Tag, Float[np.ndarray, "4 2"]]]:
    """Name and corners [px] of every tag of a family that is seen, in the whole picture or a square about a point."""
    low = np.zeros(2, int)
    if about_px is not None:
        high = np.ceil(about_px + reach_px).astype(int) + 1
        low = np.maximum(np.floor(about_px - reach_px).astype(int), 0)
        luma = np.ascontiguousarray(luma[low[1] : max(high[1], 0), low[0] : max(high[0], 0)])
        if min(luma.shape) < LEAST_PX:
            return []
    corners, ids, _ = cv2.aruco.ArucoDetector(tag_dictionary(family), _parameters()).detectMarkers(luma)
    seen = [] if ids is None else [Tag(family, int(i)) for i in np.ravel(ids)]
    return [(i, np.asarray(c, float).reshape(4, 2) + low) for i, c in zip(seen, corners, strict=True)]


def _parameters() -> cv2.aruco.DetectorParameters:
    found = cv2.aruco.DetectorParameters()
    found.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_CONTOUR
    return found


def lay(luma: UInt8[np.ndarray, "h w"], tag: Tag, corners_px: Float[np.ndarray, "4 2"], within: float = 1 / 16) -> Laid:
    """The printed pattern, laid over the picture where they correlate best, near the given corners.

    within: of its side, how far the centre may move; where it moves farther it is left, and called not alike.

    Outlines alone are whole pixels: the diagonals of their corners meet up to 0.2 px from the centre.  The
    pattern moves under a homography (Evangelidis and Psarakis 2008), whatever the light's level and contrast.
    """
    side = float(np.hypot(*(np.roll(corners_px, -1, 0) - corners_px).T).mean())
    cells = np.pad(tag_cells(tag.number, tag.family), MARGIN)
    scale = max(3, round(side / (len(cells) - 2 * MARGIN)))  # the picture's own resolution
    pattern = np.where(np.kron(cells, np.ones((scale, scale))), 30, 200).astype(np.float32)
    edge, length = MARGIN * scale - 0.5, len(pattern) - 2 * MARGIN * scale
    square = edge + length * np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)
    low = np.maximum(np.floor(corners_px.min(0) - side / 3), 0).astype(int)
    high = np.ceil(corners_px.max(0) + side / 3).astype(int)
    crop = luma[low[1] : high[1] + 1, low[0] : high[0] + 1].astype(np.float32)
    start = cv2.getPerspectiveTransform(square, (corners_px - low).astype(np.float32)).astype(np.float32)
    every = np.full(crop.shape, 255, np.uint8)
    at = np.r_[square.mean(0)[None], square]
    guess = low + apply(np.asarray(start, float), at)
    try:
        alike, laid = cv2.findTransformECC(pattern, crop, start.copy(), cv2.MOTION_HOMOGRAPHY, ENOUGH, every, SOFT_PX)
    except cv2.error:  # no better place than the outline's
        return Laid(guess[0], guess[1:], 0.0)
    found = low + apply(np.asarray(laid, float), at)
    if np.hypot(*(found[0] - guess[0])) > within * side:
        return Laid(guess[0], guess[1:], 0.0)
    return Laid(found[0], found[1:], float(alike))
