"""What to tell the person who filmed: how much was seen, how well, and what would spoil it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Float

from backend.observe.bed import Bed
from backend.observe.follow_bed import FEWEST
from backend.observe.place import Record
from backend.observe.project import AbstractView, mark_residuals_px, parallax_per_height
from backend.observe.shared_error import LEAN_DEG
from backend.observe.targets import Targets
from backend.observe.video import Video

LOST = 0.1  # of a clip at its end
RARE = 0.5  # of its pictures
TOLD_M = 1e-4  # a lens that does less is not spoken of
UNKNOWN_HEIGHT_M = 0.005  # the example height of a warning: a bar's thickness


def warn_height(bed: Bed, view: AbstractView, px: np.ndarray, width_px: int) -> list[str]:
    """What dots above the marks' plane do to the places, in millimetres, where that is not corrected."""
    if bed.marker_height_m is None and bed.stick:  # whose length is one in the plane of the motion
        return []
    if bed.marker_height_m is not None and (bed.lens or bed.camera_height_m or not _raised(bed)):
        return []
    per_height, camera_m = parallax_per_height(view, px, width_px)
    about = "" if bed.lens or bed.camera_height_m else " (judged from a phone's usual lens)"
    camera = f"the camera is about {1e3 * camera_m:.0f} mm up{about}"
    if bed.marker_height_m is None:
        return [
            f"How far the dots are above the plane of the bed marks is unknown and taken as zero; {camera}, so "
            f"dots {1e3 * UNKNOWN_HEIGHT_M:.0f} mm up are placed up to {1e3 * UNKNOWN_HEIGHT_M * per_height:.1f} mm "
            'too far out. Give marker_height_m, or "drawn" for the drawing\'s, and lens or camera_height_m, with the '
            "bed marks."
        ]
    highest = max(map(abs, _listed(bed)))
    return [
        f"The dots are {1e3 * highest:.1f} mm above the bed marks, which needs the camera's height to correct; "
        f"{camera}, so they are placed up to {1e3 * highest * per_height:.1f} mm too far out. "
        "Give lens or camera_height_m."
    ]


def warn_lens(off_m: Float[np.ndarray, "n"]) -> list[str]:
    """What a lens that nobody calibrated may do to the places, in millimetres."""
    if not off_m.size or off_m.max() < TOLD_M:
        return []
    return [
        "The lens is unknown and taken as ideal: one that bends as a phone's may places dots "
        f"{1e3 * np.median(off_m):.1f} mm off, up to {1e3 * off_m.max():.1f} mm. Calibrate it once "
        "(linktwin calibrate) and name camera.json in the bed file."
    ]


def warn_spatial(joint: str, view: AbstractView, px: np.ndarray, width_px: int) -> list[str]:
    """What leaving the plane would do to the places, in millimetres, where a joint lets parts leave it ("": none)."""
    if not joint:
        return []
    off_m = UNKNOWN_HEIGHT_M * parallax_per_height(view, px, width_px)[0]
    return [
        f"By the drawing the mechanism may leave the bed's plane, or lean, at {joint}; it is measured as flat. Dots "
        f"that rise by {1e3 * UNKNOWN_HEIGHT_M:.0f} mm are placed up to {1e3 * off_m:.1f} mm too far out, and bars "
        "that lean look short. Measure what moves in the plane alone, or take tracks of all three coordinates "
        "(linktwin convert)."
    ]


def _listed(bed: Bed) -> list[float]:
    heights = bed.marker_height_m
    if isinstance(heights, dict):
        return list(heights.values())
    return [heights if isinstance(heights, float) else 0.0]  # those of the drawing are a dict by now


def _raised(bed: Bed) -> bool:
    return any(_listed(bed))


def warn_marks(bed: Bed, view: AbstractView) -> list[str]:
    """Which bed mark disagrees with the others, if any."""
    off = mark_residuals_px(bed, view)
    if not len(off):
        return []
    worst = int(off.argmax())
    if off[worst] < 3.0:
        return []
    name = bed.marks[worst].id
    return [
        f"Bed mark {name} is {off[worst]:.1f} px from where the other marks put it; check its metres, "
        + ("and that it lies flat." if name.startswith("tag ") else "and its pixels.")
    ]


def warn_stick(bed: Bed, view: AbstractView, px: np.ndarray, width_px: int) -> list[str]:
    """What one known length leaves open: whether the camera leans, in millimetres, and whether it moved."""
    if not bed.stick:
        return []
    # Leaning, points at r from the middle are r sin(lean) nearer or farther away: r^2 sin(lean) / distance off.
    per_height, camera_m = parallax_per_height(view, px, width_px)
    off = (per_height * camera_m) ** 2 * np.sin(np.deg2rad(LEAN_DEG)) / camera_m
    return [
        f"Scale is that of one known length: a camera that leans by {LEAN_DEG:.0f} degrees would place points up to "
        f"{1e3 * off:.1f} mm off (judged from a phone's usual lens), and one that moves is not noticed. Four bed marks "
        "tell both."
    ]


def warn_blank(followable: np.ndarray) -> list[str]:
    """Whether too few marks show something by which a camera that moves would be noticed."""
    if not len(followable) or followable.sum() >= FEWEST:
        return []
    return [
        f"Too little is seen at {np.sum(~followable)} of {len(followable)} bed marks to follow them through the clip: "
        "a camera that moves is not noticed."
    ]


def warn_lost(seen: Record, markers: Sequence[str], video: Video) -> list[str]:
    """Which markers are not seen again after some time, or hardly ever."""
    known, shown_s = seen.status == "observed", (seen.times_s - seen.times_s[0]) * video.slower + video.begins_s
    count, warnings = len(known), list[str]()
    last = np.where(known.any(0), count - 1 - known[::-1].argmax(0), 0)
    gone = count - 1 - last > LOST * count
    if gone.any():
        ends = [f"{m} after {shown_s[at]:.2f} s" for m, g, at in zip(markers, gone, last, strict=True) if g]
        warnings.append(
            f"Not seen again: {', '.join(ends)}. Look there in the preview; where nothing more is seen, end sooner "
            f"(--to {shown_s[last[gone].min()]:.2f})."
        )
    share = known.mean(0)
    if rare := [f"{m} ({100 * s:.0f}%)" for m, s, g in zip(markers, share, gone, strict=True) if s < RARE and not g]:
        warnings.append(
            f"Seldom seen: {', '.join(rare)} of the pictures. Film with nothing in the way; a dot that is seen in part "
            "counts as an outlier. A lamp's shine on it, or blur longer than it is wide, look the same."
        )
    return warnings


def status_counts(tracks: pd.DataFrame) -> dict[str, dict[str, Any]]:
    """Per marker: how many rows have each status, and the usual deviation [m] of those that were seen."""
    counted: dict[str, dict[str, Any]] = {}
    for name, rows in tracks.groupby("marker", sort=False):
        status = rows.status if "status" in rows else pd.Series("ok", rows.index)
        counts = {str(k): int(n) for k, n in status.value_counts().items()}
        sigma = rows.sigma_m[status.isin(("observed", "ok"))].median()
        counted[str(name)] = {"status": counts, "sigma_m": None if np.isnan(sigma) else float(sigma)}
    return counted


def summarise(
    video: Video,
    tracks: pd.DataFrame,
    targets: Targets,
    view: AbstractView,
    bed: Bed,
    metres_per_px: float,
    warnings: list[str],
    calibration_sd_m: float,
) -> dict[str, Any]:
    """Plain JSON values: frames and rate, status counts per marker, sigma, calibration, warnings."""
    seen = tracks[tracks.status == "observed"]
    look = targets.look
    return {
        "video": video.name,
        "frames": int(tracks.frame.nunique()),
        "frames_per_s": video.frames_per_s,
        "begins_s": video.begins_s,
        "slower": video.slower,
        "duration_s": float(tracks.time_s.max() - tracks.time_s.min()),
        "metres_per_px": float(metres_per_px),
        "dot_radius_px": targets.radius_px if look else None,
        "dot_hue_deg": float(np.rad2deg(look.hue_rad)) if look and look.dark_below is None else None,
        "sigma_m": float(seen.sigma_m.median()),
        "mark_residual_px": float(np.sqrt((mark_residuals_px(bed, view) ** 2).mean())) if bed.marks else None,
        "calibration_sd_m": calibration_sd_m,
        "markers": status_counts(tracks),
        "dots_not_drawn": len(targets.order) - tracks.marker.nunique(),
        "truncated": video.truncated,
        "warnings": warnings,
    }
