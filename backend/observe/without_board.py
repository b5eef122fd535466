"""A camera calibrated without a board: from the bed's marks and the bars that move before it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pandas as pd
from jaxtyping import Float

from backend.observe.at_one_time import pictures
from backend.observe.bars import Bar, known_lengths
from backend.observe.bed import Bed, read_bed, spare_camera
from backend.observe.beforehand import before, before_of, known_heights, unknown_lens
from backend.observe.bundle import Bundle, Dots, Marks, Prior, adjust
from backend.observe.camera import PARAMETERS, Camera, CameraPose, Deviations
from backend.observe.drawn_heights import raised_as_drawn
from backend.observe.label import drawn_positions
from backend.observe.placing import placing_sd_m, placing_slopes
from backend.observe.project import calibrate, pose
from backend.observe.seen_bed import bed_in_picture
from backend.observe.shared_error import MARK_SD_PX, TAG_SD_PX
from backend.observe.tracking_error import TrackingError
from backend.observe.uncertainty import UNMEASURED_PX
from backend.observe.video import Video
from backend.observe.viewpoint import LENS, POSE, Viewpoint

FOLLOWED = "followed"  # the folder of the clip's tracks
MOST_FRAMES = 40  # more tell little: what is left is the marks' and the bars' own error
BAR_SD_M = 1e-4  # what a bar's length differs from its drawing
WORTH_SAYING_M, TOO_MUCH_M = 2.5e-4, 3e-3  # expected error of a dot's place: warned of, refused
MISFIT, NONSENSE = 2.0, 6.0  # sigmas rms: what is given disagrees with itself
ODD_BAR = 4.0  # sigmas by which a bar is not as drawn
REMEDY = (
    "Spread eight tags round the whole picture, lean the camera 10 degrees, and film the bars moving through their "
    "whole range; or calibrate with the board (linktwin calibrate board.mp4) and give marker_height_m."
)


def calibrate_from_clip(
    clip: str | Path,
    mechanism: Any,
    bed: Bed | str | Path,
    *,
    out_dir: str | Path,
    progress: Callable[[int, int], None] | None = None,
) -> Camera:
    """Follow the dots of a clip of the moving mechanism, then `camera_from_bars`.

    Its tracks, and what else tracking writes, are left in out_dir/followed: out_dir is the camera's.
    Raises TrackingError where the clip cannot be tracked, or leaves dots worse placed than 3 mm.
    """
    from backend.observe.measure import track_video

    given, bed = bed, read_bed(bed)
    spare_camera(given, out_dir)
    if bed.stick:
        raise TrackingError("One known length tells no camera; give the bed's tags or marks, four or more.")
    first = next(iter(Video(clip, keep_truncated=True)), None)
    if first is None:
        raise TrackingError(f"{Path(clip).name}: not one frame can be decoded. Copy it again.")
    height_px, width_px = first.luma.shape
    beside = Path(out_dir) / FOLLOWED
    tracked = track_video(clip, mechanism, bed, out_dir=beside, preview=False, progress=progress)
    seen, warnings = bed_in_picture(bed, first.luma)
    seen, _ = raised_as_drawn(seen, drawn_positions(mechanism))  # what is amiss there, the tracks have told
    tracks, size_px = tracked.tracks, (width_px, height_px)
    if tracked.shaken:
        tracks = as_in_first_picture(tracks, seen, list(drawn_positions(mechanism)), size_px)
    camera = camera_from_bars(tracks, mechanism, seen, size_px, bed.camera)
    return camera.model_copy(update={"notes": (*warnings, *camera.notes)}) if warnings else camera


def as_in_first_picture(
    tracks: pd.DataFrame, bed: Bed, markers: Sequence[str], size_px: tuple[int, int]
) -> pd.DataFrame:
    """Tracks of a camera that moved, with pixels as if it had stood where it did in the first picture.

    bed: its marks have that picture's pixels. Places become pixels by the lens and the heights that pixels had become
    places by: what is wrong with them is in both views alike, but for what the camera's own motion changes of it.
    """
    heights = dict(zip(markers, bed.heights(markers)[0], strict=True))
    height_m = np.array([heights[str(name)] for name in tracks["marker"]])
    # What runs along the bed's normal was not measured, and nothing of it lies in the bed.
    from_origin_m = np.nan_to_num(tracks[["x_m", "y_m", "z_m"]].to_numpy(float) - np.array(bed.plane.origin_m))
    px = calibrate(bed, *size_px).pixels(from_origin_m @ bed.plane.axes()[:2].T, height_m)
    px[tracks["x_px"].isna().to_numpy()] = np.nan
    return tracks.assign(x_px=px[:, 0], y_px=px[:, 1])


def camera_from_bars(
    tracks: pd.DataFrame,
    mechanism: Any,
    bed: Bed,
    size_px: tuple[int, int],
    camera: Camera | None = None,
    bar_sd_m: float = BAR_SD_M,
) -> Camera:
    """The camera behind a clip's tracks (pixels and their covariance), with its pose and the dots' heights.

    bed: its marks have pixels.  camera: a calibrated lens, of which pose and heights alone are then new.
    Raises TrackingError, in millimetres of error to expect, where they are not settled.
    """
    followed = set(tracks["marker"])
    markers = [name for name in drawn_positions(mechanism) if name in followed]
    bars = known_lengths(mechanism, bed.plane, markers)
    dots = _dots(tracks, markers, bars, bar_sd_m)
    if camera is None and bed.lens is not None:
        raise TrackingError("The bed file gives a lens already; leave it out to have it found, or name a camera file.")
    lens = unknown_lens(*size_px)
    if camera is None:
        prior = before(lens, known_heights(bed, markers))
    else:
        fitted, _ = camera.for_picture(*size_px)
        # An earlier clip found them to millimetres; taken for measured, they would count as known to half of one.
        if camera.pose and bed.marker_height_m == camera.pose.found_heights_m():
            bed = bed.model_copy(update={"marker_height_m": None})
        prior = before_of(fitted.model_copy(update={"pose": None}), markers, bed)
    found = adjusted(bed, prior, dots)
    notes = _notes(found, markers, bars, bar_sd_m)
    return camera_of(found, bed, markers, dots, size_px, (_settled(found, bed, dots, notes), *notes))


def adjusted(bed: Bed, prior: Prior, dots: Dots) -> Bundle:
    """The bundle of a bed's marks and these dots, begun from the pose that the prior's lens sees the marks from."""
    guess = Viewpoint(prior.lens, np.eye(3), np.zeros(3)).lens
    placed = pose(bed, guess, prior.lens[2:4])
    start = Viewpoint(prior.lens, placed.R @ bed.plane.axes(), bed.plane.at(placed.position_m))
    metres_per_px = abs(placed.position_m[2]) / prior.lens[0]
    marks = Marks(bed.metres(), bed.pixels(), mark_sd_px(bed, metres_per_px))
    return adjust(bed.plane, start, prior, marks, dots)


def mark_sd_px(bed: Bed, metres_per_px: float) -> Float[np.ndarray, "mark"]:
    """Deviation of each mark: where it is seen, and where it is on the bed."""
    own = np.array([TAG_SD_PX if m.id.startswith("tag ") else MARK_SD_PX for m in bed.marks])
    return np.hypot(own, bed.mark_sd_m / metres_per_px)


def camera_of(
    found: Bundle,
    bed: Bed,
    markers: Sequence[str],
    dots: Dots,
    size_px: tuple[int, int],
    notes: Sequence[str] = (),
) -> Camera:
    """A bundle as a camera file."""
    covariance = found.covariance
    sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    stands = CameraPose(
        position_m=tuple(found.view.p_WC.tolist()),  # type: ignore[arg-type]
        quaternion_wxyz=found.view.quaternion_wxyz,  # type: ignore[arg-type]
        plane=bed.plane,
        marker_height_m=dict(zip(markers, found.heights_m.tolist(), strict=True)),
        covariance=tuple(tuple(row) for row in covariance.tolist()),
    )
    v, s, names = found.view.values.tolist(), sd.tolist(), PARAMETERS[4:]
    seen = dots.px[np.isfinite(dots.px[..., 0])]
    hull = cv2.convexHull(np.concatenate([bed.pixels(), seen]).astype(np.float32))
    return Camera(
        image_size_px=size_px,
        focal_px=(v[0], v[1]),
        centre_px=(v[2], v[3]),
        **dict(zip(names, v[4:], strict=True)),
        sd=Deviations(focal_px=(s[0], s[1]), centre_px=(s[2], s[3]), **dict(zip(names, s[4:LENS], strict=True))),
        covariance=tuple(tuple(row) for row in covariance[:LENS, :LENS].tolist()),
        reprojection_rms_px=found.mark_rms_px,
        views=max(len(dots.px), 1),
        coverage=min(float(cv2.contourArea(hull)) / (size_px[0] * size_px[1]), 1.0),
        notes=tuple(notes),
        pose=stands,
    )


def expected_error_m(found: Bundle, bed: Bed, dots: Dots) -> float:
    """Root mean square deviation per axis [m] of the places at which the dots were seen."""
    _, marker = np.nonzero(np.isfinite(dots.px[..., 0]))
    px, height = dots.px[np.isfinite(dots.px[..., 0])], found.heights_m[marker]
    xy = found.view.on_plane(px, bed.plane, height)
    slopes = placing_slopes(found.view, bed.plane, xy, height, marker, len(found.heights_m))
    return float(np.sqrt(np.mean(placing_sd_m(slopes, found.covariance) ** 2)))


def _settled(found: Bundle, bed: Bed, dots: Dots, notes: Sequence[str]) -> str:
    """How well dots are placed.  Raises TrackingError where that is not settled."""
    if found.misfit > NONSENSE:
        raise TrackingError(
            f"Bed marks, bars and dots disagree by {found.misfit:.0f} times what they should. Check the marks' places "
            f"on the bed and the drawing's lengths. {' '.join(notes)}"
        )
    sd_m = expected_error_m(found, bed, dots)
    said = f"Dots are placed to {1e3 * sd_m:.2g} mm (one deviation per axis, the same error in every frame)"
    if sd_m > TOO_MUCH_M:
        raise TrackingError(f"{said}: height and lens are not settled. {REMEDY}")
    return f"{said}. {REMEDY}" if sd_m > WORTH_SAYING_M else f"{said}."


def _dots(tracks: pd.DataFrame, markers: Sequence[str], bars: Sequence[Bar], bar_sd_m: float) -> Dots:
    """Frames spread over the clip in which most dots are seen, all dots of one as of one time."""
    whole = tracks["status"].isin(("observed", "ok")) if "status" in tracks else True
    rows = tracks.loc[tracks["x_px"].notna() & whole]
    px, cov = pictures(rows, markers, UNMEASURED_PX**2)
    seen = np.isfinite(px[..., 0]).sum(1)
    full = np.flatnonzero(seen >= 0.8 * seen.max(initial=1))
    if not len(full):
        raise TrackingError("No frame shows a dot, so neither lens nor heights can be found from bars.")
    chosen = full[np.unique(np.linspace(0, len(full) - 1, min(MOST_FRAMES, len(full))).round().astype(int))]
    return Dots(px[chosen], cov[chosen], tuple(bars), bar_sd_m)


def _notes(found: Bundle, markers: Sequence[str], bars: Sequence[Bar], bar_sd_m: float) -> list[str]:
    focal, sd = found.view.values[0], np.sqrt(np.diag(found.covariance))
    notes = [
        f"The focal length is known to {100 * sd[0] / focal:.2g}%, the camera's distance to "
        f"{1e3 * np.linalg.norm(sd[LENS + 3 : LENS + POSE]):.2g} mm; they err together, which moves the dots little."
    ]
    if found.misfit > MISFIT:
        notes.append(
            f"Bed marks, bars and dots disagree by {found.misfit:.1f} times what they should; deviations are widened "
            "for it. Check the marks' places on the bed and the drawing's lengths."
        )
    for bar, longer in zip(bars, found.bar_error_m, strict=True):
        if abs(longer) > ODD_BAR * bar_sd_m:
            notes.append(
                f"{markers[bar.a]} and {markers[bar.b]} are seen {1e3 * (bar.length_m + longer):.2f} mm apart, drawn "
                f"{1e3 * bar.length_m:.2f} mm: measure the part, or correct the drawing."
            )
    return notes
