"""Where a calibrated camera stood in a clip, and what is not known of it: the camera file beside the tracks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from backend.observe.bed import Bed
from backend.observe.beforehand import before_of
from backend.observe.bundle import Dots
from backend.observe.camera import Camera
from backend.observe.project import AbstractView
from backend.observe.shared_error import error_of_camera, error_of_marks_m, error_of_unknown_lens_m
from backend.observe.viewpoint import Viewpoint
from backend.observe.without_board import MISFIT, adjusted, camera_of, mark_sd_px

FEW = 200  # places by which the error of all is judged
STILL = 3.0  # sigmas rms by which the marks may miss the saved pose of a camera that has not moved


class Shared(NamedTuple):
    """What all points of a clip have wrong together: its deviation per axis [m].

    camera, tolerances: of a calibrated camera, as it stood in the clip; and what stands for it in a study that cannot
    name it.  notes: what is to be said of it.  unknown_lens_m: how far off points are placed where no lens is known.
    """

    sd_m: float
    camera: Camera | None = None
    tolerances: tuple[dict[str, Any], ...] = ()
    notes: tuple[str, ...] = ()
    unknown_lens_m: Float[np.ndarray, "n"] = np.zeros(0)


def shared_error(
    given: Camera | None,
    bed: Bed,
    view: AbstractView,
    heights_m: Float[np.ndarray, "marker"],
    markers: Sequence[str],
    px: Float[np.ndarray, "frame marker 2"],
    size_px: tuple[int, int],
    interval_s: float,
) -> Shared:
    """By the covariance of the camera that was given, else by the bed's marks and an unknown lens.

    bed: its marks have pixels.  px: NaN where a marker was not seen.
    """
    if given:
        posed = camera_in_clip(given, bed, markers, px, size_px)
        sd_m, tolerances = error_of_camera(posed, markers, px, interval_s)
        return Shared(sd_m, posed, tuple(tolerances), posed.notes[len(given.notes) :])
    seen = np.argwhere(np.isfinite(px[..., 0]))
    some = seen[:: max(1, len(seen) // FEW)]
    at, heights = px[tuple(some.T)], heights_m[some[:, 1]]
    off = error_of_unknown_lens_m(bed, view, at, heights, size_px)
    sd_m = np.hypot(error_of_marks_m(bed, view, at, heights, size_px), np.sqrt((off**2).mean() / 2))
    return Shared(float(sd_m), unknown_lens_m=off)


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
