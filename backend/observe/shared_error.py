"""What all points of a clip have wrong together: a calibrated camera's covariance, or the marks of any other view."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from backend.observe.bed import Bed
from backend.observe.beforehand import BEND_SD
from backend.observe.camera import Camera
from backend.observe.lens import Lens, straighten
from backend.observe.placing import placing_sd_m, placing_slopes
from backend.observe.project import PHONE_FOCAL, AbstractView, calibrate
from backend.observe.viewpoint import Viewpoint

MARK_SD_PX, TAG_SD_PX = 0.5, 0.04  # a mark clicked by hand; a tag's centre, where neighbours may err alike
CLOCK_SD = 5e-5  # of a camera's clock: the usual tolerance of a quartz
LEAN_DEG = 3.0  # what a hand that holds a phone upright misses
LEAST = 4  # marks, of which a view without a lens is made
FEW = 400  # places by which the error of all is judged


def error_of_marks_m(
    bed: Bed,
    view: AbstractView,
    px: Float[np.ndarray, "n 2"],
    height_m: Float[np.ndarray, "n"],
    size_px: tuple[int, int],
) -> float:
    """Standard deviation per axis [m] of what its marks do to points seen at `px`, all alike or nearly so.

    bed: with marks in place of tags; its lens counts as exact.
    """
    nominal, total = view.metres(px, height_m), 0.0
    for other in _missed(bed):
        total += float(((calibrate(other, *size_px).metres(px, height_m) - nominal) ** 2).sum(1).mean() / 2)
    return float(np.sqrt(total))


def error_of_unknown_lens_m(
    bed: Bed,
    view: AbstractView,
    px: Float[np.ndarray, "n 2"],
    height_m: Float[np.ndarray, "n"],
    size_px: tuple[int, int],
) -> Float[np.ndarray, "n"]:
    """How far off [m] points seen at `px` are placed where no lens is known and it bends as much as one of a phone may
    (k1 by its deviation), and where only the camera's height is, and it leans by LEAN_DEG; 0 where a lens is known.
    """
    off = np.zeros(len(px))
    if bed.lens is None and len(bed.marks) >= LEAST:
        middle, focal_px = (np.array(size_px) - 1) / 2, PHONE_FOCAL * max(size_px)
        if bed.camera_height_m:
            focal_px = bed.camera_height_m / np.sqrt(np.abs(np.linalg.det(view.slope(middle[None], np.zeros(1))[0])))
        lens = Lens(focal_px=float(focal_px), k1=BEND_SD["k1"])

        def straight(at: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
            return middle + lens.focal() * straighten(at, lens, middle)

        moved = [
            mark.model_copy(update={"x_px": float(x), "y_px": float(y)})
            for mark, (x, y) in zip(bed.marks, straight(bed.pixels()), strict=True)
        ]
        other = calibrate(bed.model_copy(update={"marks": tuple(moved)}), *size_px)
        off = np.hypot(*(other.metres(straight(px), height_m) - view.metres(px, height_m)).T)
        if bed.camera_height_m:
            off = np.hypot(off, np.abs(height_m) * np.sin(np.deg2rad(LEAN_DEG)))
    return off


def _missed(bed: Bed) -> Iterator[Bed]:
    """The bed with each coordinate that was read off the picture wrong by one of its deviations."""
    for k, mark in enumerate(bed.marks):
        sd = TAG_SD_PX if mark.id.startswith("tag ") else MARK_SD_PX
        for shift in ({"x_px": mark.x_px + sd}, {"y_px": mark.y_px + sd}):
            moved = (*bed.marks[:k], mark.model_copy(update=shift), *bed.marks[k + 1 :])
            yield bed.model_copy(update={"marks": moved})
    if bed.stick:
        ends = {"a_px": bed.stick.a_px, "b_px": bed.stick.b_px, "origin_px": bed.stick.origin_px or bed.stick.a_px}
        for end, (u, v) in ends.items():
            for at in ((u + MARK_SD_PX, v), (u, v + MARK_SD_PX)):
                yield bed.model_copy(update={"stick": bed.stick.model_copy(update={**ends, end: at})})


def error_of_camera(
    camera: Camera, markers: Sequence[str], px: Float[np.ndarray, "frame marker 2"], interval_s: float
) -> tuple[float, list[dict[str, Any]]]:
    """What a camera that was found in a clip does to its points: their deviation per axis [m], and tolerances by which
    a study can say so.

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
