"""Where a calibrated camera stood in a clip, and what is not known of it: the camera file beside the tracks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from backend.observe.bed import Bed
from backend.observe.beforehand import before_of
from backend.observe.bundle import Dots
from backend.observe.camera import Camera
from backend.observe.viewpoint import Viewpoint
from backend.observe.without_board import MISFIT, adjusted, camera_of, mark_sd_px

STILL = 3.0  # sigmas rms by which the marks may miss the saved pose of a camera that has not moved


def camera_in_clip(
    camera: Camera,
    bed: Bed,
    markers: Sequence[str],
    px: Float[np.ndarray, "frame marker 2"],
    size_px: tuple[int, int],
) -> Camera:
    """The calibrated camera with its pose in this clip, and the covariance of lens, pose and heights together.

    bed: its marks have pixels.  A saved pose is kept where the marks are still seen from it; else the pose follows from
    the marks, lens and heights staying within what is known of them.
    """
    fitted, _ = camera.for_picture(*size_px)
    if fitted.pose is not None and list(fitted.pose.marker_height_m) == list(markers):
        view = Viewpoint.of(fitted, fitted.pose)
        miss = view.pixels(bed.plane.at(np.c_[bed.metres(), np.zeros(len(bed.marks))])) - bed.pixels()
        scale = abs(bed.plane.from_world(view.p_WC)[2]) / view.values[0]
        if np.sqrt(np.mean((miss / mark_sd_px(bed, scale)[:, None]) ** 2)) < STILL:
            return fitted
    found = adjusted(bed, before_of(fitted, markers, bed), Dots.none(len(markers)))
    notes = list(camera.notes)
    if found.misfit > MISFIT:
        notes.append(
            f"The bed marks are seen {found.misfit:.1f} times as far from where this lens puts them as they should be; "
            "deviations are widened for it. Was the camera calibrated at another setting, or is a mark not where the "
            "bed file says?"
        )
    return camera_of(found, bed, markers, Dots(px, np.zeros((*px.shape, 2))), size_px, notes)
