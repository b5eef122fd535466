"""What all points of a clip have wrong together: the view's own error, from its marks and its lens."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from backend.observe.bed import Bed
from backend.observe.camera import PARAMETERS, Camera
from backend.observe.project import AbstractView, calibrate

MARK_SD_PX, TAG_SD_PX = 0.5, 0.04  # a mark clicked by hand; a tag's centre, where neighbours may err alike


def shared_error_m(
    bed: Bed,
    camera: Camera | None,
    view: AbstractView,
    px: Float[np.ndarray, "n 2"],
    height_m: Float[np.ndarray, "n"],
    size_px: tuple[int, int],
) -> float:
    """Standard deviation per axis [m] of what the view does to points seen at `px`, all alike or nearly so.

    bed: with marks in place of tags.  camera: whose lens the bed holds, with its covariance.
    """
    nominal = view.metres(px, height_m)

    def change(other: Bed) -> float:
        return float(((calibrate(other, *size_px).metres(px, height_m) - nominal) ** 2).sum(1).mean() / 2)

    total = 0.0
    for k, mark in enumerate(bed.marks):
        sd = TAG_SD_PX if mark.id.startswith("tag ") else MARK_SD_PX
        for shift in ({"x_px": mark.x_px + sd}, {"y_px": mark.y_px + sd}):
            moved = (*bed.marks[:k], mark.model_copy(update=shift), *bed.marks[k + 1 :])
            total += change(bed.model_copy(update={"marks": moved}))
    if camera is not None:
        values, directions = np.linalg.eigh(np.array(camera.covariance))
        for value, direction in zip(values, directions.T, strict=True):
            if value > 0:
                lens, _ = _moved(camera, np.sqrt(value) * direction).lens_for(*size_px)
                total += change(bed.model_copy(update={"lens": lens}))
    return float(np.sqrt(total))


def _moved(camera: Camera, by: Float[np.ndarray, "9"]) -> Camera:
    value = dict(zip(PARAMETERS, (camera.values() + by).tolist(), strict=True))
    pairs = {"focal_px": (value["fx_px"], value["fy_px"]), "centre_px": (value["cx_px"], value["cy_px"])}
    return camera.model_copy(update=pairs | {name: value[name] for name in PARAMETERS[4:]})
