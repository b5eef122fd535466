"""A joint from the axes drawn on its two parts: frames in both, the gap between them, and the fit of the pin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from backend.mechanism.drawing_error import DrawingError
from cad_export.axis import Axis
from cad_export.fits import Fit, check_bearing, fit_between
from cad_export.placement import Placement, frame_along, frame_with_x

GAP_MM = 1e-3  # parts placed by arithmetic meet to 1e-12; an assembly solver stops near 1e-6
TILT_DEG = 0.01


@dataclass(frozen=True)
class DrawnJoint:
    """Frames of a joint in the parts that carry it.

    X_AF: the joint's first frame in the first part's frame.  X_BG: the second's in the second's.
    warning: what the drawer should know, or None.
    """

    X_AF: Placement
    X_BG: Placement
    fit: Fit | None = None
    warning: str | None = None


def joint_between(
    id: str, slides: bool, X_WA: Placement, axis_a: Axis, X_WB: Placement, axis_b: Axis | None, drawn_at: float = 0.0
) -> DrawnJoint:
    """The frames of a turning or sliding joint; both axes are in their own part's coordinates.

    slides: whether q is the distance along the axis [mm] rather than the turn about it [rad].
    axis_b: None when the axis is drawn on the first part alone; the second then takes it as it stands.
    drawn_at: q in the drawn pose [rad]; where a sliding joint has both axes, their points say it instead.
    Raises DrawingError when the two axes do not coincide as placed, naming the gap in mm.
    """
    a = axis_a.in_frame(X_WA)
    b = a if axis_b is None else _same_way(axis_b.in_frame(X_WB), a)
    along = np.asarray(a.direction)
    fit = None if slides else fit_between(id, a, None if axis_b is None else b)
    origin_a = np.asarray(a.point_mm) + (0.0 if slides else _meeting(a, b)) * along
    origin_b = _foot(b, np.asarray(b.point_mm) if slides else origin_a)
    warning = _check_gap(id, slides, a, b, origin_a, origin_b, fit)
    if fit is not None:
        check_bearing(id, fit)

    R_WF = X_WA.rotation @ frame_along(X_WA.rotation.T @ along)  # x by A's axes, so that it moves with A
    turn = 0.0 if slides else drawn_at
    x = np.cos(turn) * R_WF[:, 0] + np.sin(turn) * R_WF[:, 1]
    R_WG = frame_with_x(np.asarray(b.direction), x)
    return DrawnJoint(
        X_WA.inverse() @ Placement(R_WF, origin_a),
        X_WB.inverse() @ Placement(R_WG, origin_b),
        fit,
        warning,
    )


def weld(X_WA: Placement, X_WB: Placement) -> DrawnJoint:
    """The frames of a fixed joint: the second part's own frame, as it stands in the first."""
    return DrawnJoint(X_WA.inverse() @ X_WB, Placement())


def _same_way(b: Axis, a: Axis) -> Axis:
    """b pointing as a does: two faces have no common sense of direction."""
    if np.dot(a.direction, b.direction) > 0.0:
        return b
    return Axis(b.point_mm, -np.asarray(b.direction), b.span_mm and (-b.span_mm[1], -b.span_mm[0]), b.cylinder)


def _meeting(a: Axis, b: Axis) -> float:
    """Where along a, from its point, the joint sits: the middle of what both cover [mm]."""
    low_a, high_a = a.span_mm or (0.0, 0.0)
    shift = _along(a, b)
    low_b, high_b = (shift + end for end in (b.span_mm or (0.0, 0.0)))
    if a.span_mm is None:
        return 0.0
    if b.span_mm is None:
        return float(np.clip(shift, low_a, high_a))
    return 0.5 * (max(low_a, low_b) + min(high_a, high_b))


def _along(a: Axis, b: Axis) -> float:
    return float(np.dot(np.asarray(b.point_mm) - np.asarray(a.point_mm), a.direction))


def _foot(line: Axis, point: np.ndarray) -> np.ndarray:
    """The point of a line nearest to a point; a line drawn by its point alone has no other."""
    start, along = np.asarray(line.point_mm), np.asarray(line.direction)
    return start if line.span_mm is None else start + (point - start) @ along * along


def _check_gap(
    id: str, slides: bool, a: Axis, b: Axis, origin_a: np.ndarray, origin_b: np.ndarray, fit: Fit | None
) -> str | None:
    apart = origin_b - origin_a
    if slides:
        apart = apart - (apart @ np.asarray(a.direction)) * np.asarray(a.direction)
    gap_mm = float(np.linalg.norm(apart))
    tilt_deg = float(np.degrees(np.arcsin(min(1.0, np.linalg.norm(np.cross(a.direction, b.direction))))))
    play_mm = (fit.radial_clearance_mm or 0.0) if fit else 0.0
    if gap_mm > max(GAP_MM, play_mm) or tilt_deg > TILT_DEG:
        raise DrawingError(
            f'joint "{id}": the axes on its two parts are {gap_mm:.6g} mm and {tilt_deg:.4g}° apart as placed '
            f"(allowed {max(GAP_MM, play_mm):g} mm, {TILT_DEG:g}°); place the parts so that they meet: the "
            "assembly solver may report success with parts far apart"
        )
    if gap_mm > GAP_MM:
        return f'joint "{id}": the pin stands {gap_mm:.4g} mm off the middle of its hole, within {play_mm:.4g} mm play'
    return None
