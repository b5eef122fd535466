"""Whether bed file, drawing and picture can speak of the same things: units, lengths, the pose at the start."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np
from jaxtyping import Float

from backend.observe.bars import Bar
from backend.observe.bed import Bed, BedMark
from backend.observe.label import drawn_positions, rotation
from backend.observe.project import AbstractView, calibrate, mark_residuals_px, parallax_per_height
from backend.observe.tracking_error import TrackingError

LEAST, MOST = 0.02, 30.0  # of the picture's diagonal: a drawing is seen larger than a dot, and not much larger than it
FAR_M = 100.0  # no linkage is filmed from so far away
NEAR, GUESSED = 0.5, 3.0  # of the camera's height: no dots are higher; where that height is a guess, by a phone's lens
BESIDE, AGREE = 0.03, 0.005  # of the diagonal: more than an unknown lens does; what it may do
ENOUGH = 5  # marks: four that are left agree whatever they are
LONGER, KNOWN = 0.05, 0.02  # more than unknown heights and lens do to lengths; than drawings and prints are off by
LONGER_M = 1e-3
STRAY = 0.25  # of the drawing's extent: a start so far from the drawn pose is more likely a wrong name or axis
METRES = "All lengths are in metres: 300 mm is 0.3."


def check_marks(bed: Bed, view: AbstractView, size_px: tuple[int, int]) -> None:
    """Refuse marks that cannot all be where the bed file says, naming what would mend them.  Raises TrackingError."""
    off, diagonal_px = mark_residuals_px(bed, view), float(np.hypot(*size_px))
    if not len(off) or off.max() < BESIDE * diagonal_px:
        return

    def agree(marks: Sequence[BedMark]) -> bool:
        other = bed.model_copy(update={"marks": tuple(marks)})
        try:
            return bool(mark_residuals_px(other, calibrate(other, *size_px)).max() < AGREE * diagonal_px)
        except TrackingError:  # no view at all
            return False

    every, told = list(bed.marks), "Check their places and their numbers."
    for mark in every if len(every) > ENOUGH else ():
        if agree([other for other in every if other is not mark]):
            told = f"Without {mark.id} the others agree: check its metres, or leave it out."
    for a, b in combinations(range(len(every)), 2):
        at = {a: _moved(every[a], every[b]), b: _moved(every[b], every[a])}
        if agree([at.get(k, mark) for k, mark in enumerate(every)]):
            told = f"With the places of {every[a].id} and {every[b].id} swapped they agree."
    worst = bed.marks[int(off.argmax())].id
    raise TrackingError(
        f"The bed marks contradict each other: {worst} is seen {off.max():.0f} px from where the others put it. {told}"
    )


def _moved(mark: BedMark, to: BedMark) -> BedMark:
    return mark.model_copy(update={"x_m": to.x_m, "y_m": to.y_m})


def check_units(
    mechanism: Any, bed: Bed, view: AbstractView, heights_m: Float[np.ndarray, "marker"], size_px: tuple[int, int]
) -> None:
    """Refuse a bed file or a drawing in another unit, by what it would look like.  Raises TrackingError."""
    middle, diagonal_px = 0.5 * np.array(size_px)[None], np.hypot(*size_px)
    camera_m = parallax_per_height(view, middle, size_px[0])[1]
    known = bed.lens is not None or bed.camera_height_m is not None
    if np.abs(heights_m).max() > (NEAR if known else GUESSED) * camera_m:
        raise TrackingError(
            f"marker_height_m puts dots {1e3 * np.abs(heights_m).max():.0f} mm above the bed, and the camera is about "
            f"{1e3 * camera_m:.0f} mm up. {METRES}"
        )
    at = bed.plane.from_world(_places(mechanism))[:, :2]
    span_m, span_px = (float(np.hypot(*np.ptp(p, axis=0))) for p in (at, view.pixels(at, np.zeros(len(at)))))
    if 0 < span_px < LEAST * diagonal_px or span_px > MOST * diagonal_px:
        raise TrackingError(
            f"By the bed file the drawing, {1e3 * span_m:.3g} mm across, would be {span_px:.2g} px across in a picture "
            f"of {size_px[0]} x {size_px[1]}: bed file or drawing is in another unit. {METRES}"
        )
    if camera_m > FAR_M:
        raise TrackingError(f"By the bed file the camera would be about {camera_m:.0f} m away. {METRES}")


def drawn_extent_m(mechanism: Any) -> float:
    """How large the drawing is [m], markers and joints."""
    return float(np.linalg.norm(np.ptp(_places(mechanism), axis=0)))


def _places(mechanism: Any) -> Float[np.ndarray, "n 3"]:
    """Where markers and joints are drawn, in W [m]."""
    poses = {body.id: body.pose for body in mechanism.bodies}
    joints = [
        np.asarray(poses[j.body_a].position_m) + rotation(poses[j.body_a].quaternion_wxyz) @ j.frame_a.position_m
        for j in mechanism.joints
    ]
    return np.array([*drawn_positions(mechanism).values(), *joints], float)


def warn_lengths(
    bars: Sequence[Bar], markers: Sequence[str], at_m: Float[np.ndarray, "marker 2"], bed: Bed
) -> list[str]:
    """Whether dots that keep their distance are seen as far apart as they are drawn.

    at_m: places on the bed in one picture, NaN where a marker was not seen.
    """
    more = KNOWN if bed.lens and bed.marker_height_m is not None else LONGER
    drawn = np.array([bar.length_m for bar in bars])
    seen = np.array([np.hypot(*(at_m[bar.a] - at_m[bar.b])) for bar in bars])
    known = np.isfinite(seen)
    if not known.any():
        return []
    ratio = np.where(known, seen / drawn, 1.0)
    usual = float(np.median(ratio[known]))
    alike = abs(usual - 1) > more
    wrong = np.abs(ratio / (usual if alike else 1.0) - 1) * drawn
    off = (wrong > LONGER_M) & (wrong > more * drawn) & known

    def told(k: int) -> str:
        a, b = markers[bars[k].a], markers[bars[k].b]
        return f"{a} to {b} {1e3 * seen[k]:.1f} mm, drawn {1e3 * drawn[k]:.1f} mm"

    if alike and off.mean() < 0.5:
        return [
            f"Distances are seen {usual:.3g} times as large as they are drawn ({told(int(np.argmax(drawn * known)))}). "
            "Check the bed file's metres, the size at which tags were printed, the dots' height, and the drawing."
        ]
    if off.any():
        return [
            f"The mechanism in the picture is not the one that is drawn: {told(int(np.argmax(wrong * known)))}. "
            "Check the drawing, and which point has which name."
        ]
    return []


def warn_start(
    drawn: Mapping[str, Float[np.ndarray, "3"]],
    names: Sequence[str],
    world_m: Float[np.ndarray, "marker 3"],
    extent_m: float,
    remedy: str,
) -> list[str]:
    """Whether the first places are where the drawing has them: wrong names and turned axes show here.

    world_m: NaN where nothing was measured.  extent_m: of the drawing.
    """
    expected = np.array([drawn[name] for name in names])
    known = np.isfinite(world_m).any(1)
    away = np.where(known, np.sqrt(np.nansum((world_m - expected) ** 2, axis=1)), np.nan)
    if extent_m == 0 or not known.any() or np.nanmedian(away) <= STRAY * extent_m:
        return []
    far = [name for name, d in zip(names, away, strict=True) if d > STRAY * extent_m]
    shown = ", ".join(far[:8]) + (f" and {len(far) - 8} more" if len(far) > 8 else "")
    median_mm = 1e3 * float(np.nanmedian(away))
    return [f"The points start {median_mm:.0f} mm (median) from where the drawing has them: {shown}. {remedy}"]
