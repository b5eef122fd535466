"""Where a calibrated camera stood in a clip, and what is not known of it: the camera file beside the tracks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from backend.observe.bed import Bed
from backend.observe.beforehand import before_of
from backend.observe.bundle import Dots
from backend.observe.camera import Camera
from backend.observe.placing import placing_sd_m, placing_slopes
from backend.observe.viewpoint import Viewpoint
from backend.observe.without_board import MISFIT, adjusted, camera_of, mark_sd_px

STILL = 3.0  # sigmas rms by which the marks may miss the saved pose of a camera that has not moved
CLOCK_SD = 5e-5  # of a camera's clock: the usual tolerance of a quartz
FEW = 400  # places by which the error of all is judged


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


def shared_error(
    camera: Camera, markers: Sequence[str], px: Float[np.ndarray, "frame marker 2"], interval_s: float
) -> tuple[float, list[dict[str, Any]]]:
    """What all points of a clip share: their deviation per axis [m], and tolerances by which a study can say so.

    The tolerances stand for the whole covariance where a study cannot name the camera: scale and turn of the places
    about the world's origin, and the clock (the release is seen to a frame).
    """
    if camera.pose is None:
        raise ValueError("the camera has no pose")
    pose, view = camera.pose, Viewpoint.of(camera, camera.pose)
    heights = np.array([pose.marker_height_m[name] for name in markers])
    frame, marker = np.nonzero(np.isfinite(px[..., 0]))
    few = slice(None, None, max(1, len(frame) // FEW))
    frame, marker = frame[few], marker[few]
    xy = view.on_plane(px[frame, marker], pose.plane, heights[marker])
    slopes = placing_slopes(view, pose.plane, xy, heights[marker], marker, len(heights))
    covariance = np.array(pose.covariance)
    # Shift, scale and turn of all places, by least squares: d = (a + s x - t y, b + s y + t x).
    x, y = (xy - pose.plane.from_world(np.zeros(3))[:2]).T
    one, none = np.ones_like(x), np.zeros_like(x)
    fields = np.stack([np.stack([one, none, x, -y], -1), np.stack([none, one, y, x], -1)], 1).reshape(-1, 4)
    gain = np.linalg.pinv(fields) @ slopes.reshape(len(fields), -1)
    scale, turn = np.sqrt(np.diag(gain @ covariance @ gain.T))[2:].tolist()
    told = {
        "camera_scale": scale, "camera_rotation": turn,
        "time_offset": interval_s / np.sqrt(12.0), "frame_rate_error": CLOCK_SD,
    }  # fmt: skip
    sd_m = float(np.sqrt(np.mean(placing_sd_m(slopes, covariance) ** 2)))
    return sd_m, [{"kind": kind, "on": ["camera"], "sd": float(sd)} for kind, sd in told.items()]
