"""How high the dots are where the drawing says it: its markers are points of bodies, in three dimensions."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from backend.observe.bed import DRAWN, Bed
from backend.observe.tracking_error import TrackingError

FLAT_M = 1e-4  # markers this near to the marks' plane are in it


def raised_as_drawn(bed: Bed, drawn_m: Mapping[str, Float[np.ndarray, "3"]]) -> tuple[Bed, list[str]]:
    """The bed with the drawing's heights where its marker_height_m is "drawn", and what to warn of.

    bed: its marks have pixels, which say on what side of them the camera is.  drawn_m: each marker in W, in the drawn
    pose [m].  Raises TrackingError where the drawing has no marker above the marks.
    """
    if bed.marker_height_m != DRAWN:
        return bed, []
    heights = _toward(bed) * bed.plane.from_world(np.array(list(drawn_m.values())))[:, 2]
    lowest, highest = float(heights.min()), float(heights.max())
    remedy = (
        "Give the place of the marks' plane in the drawing (plane.origin_m), or measured heights (marker_height_m)."
    )
    if highest < FLAT_M:
        raise TrackingError(
            f'marker_height_m is "drawn", and the drawing has no marker above the bed marks: they are at '
            f"{1e3 * lowest:.1f} to {1e3 * highest:.1f} mm. {remedy}"
        )
    below = [f"{m} ({1e3 * h:.1f} mm)" for m, h in zip(drawn_m, heights, strict=True) if h < -FLAT_M]
    notes = [f"The drawing has markers below the bed marks: {', '.join(below)}. {remedy}"] if below else []
    return bed.model_copy(update={"marker_height_m": dict(zip(drawn_m, heights.tolist(), strict=True))}), notes


def _toward(bed: Bed) -> float:
    """+1 where the camera is on the side of the plane's normal, else -1."""
    if bed.stick:  # x to the right and y up in the picture
        return 1.0
    slope = np.linalg.lstsq(np.c_[bed.metres(), np.ones(len(bed.marks))], bed.pixels(), rcond=None)[0][:2]
    return -float(np.sign(np.linalg.det(slope)))  # v runs down
