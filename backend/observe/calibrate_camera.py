"""A camera's lens from pictures of the kit's board."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool

from backend.observe.board_views import BoardView, Progress, choose_views, look_for_board
from backend.observe.camera import Camera, Deviations
from backend.observe.lens_fit import LensFit, fit_lens
from backend.observe.project import PHONE_FOCAL
from backend.observe.tracking_error import TrackingError

MOST_VIEWS = 40
LEAST_VIEWS = 8
LEANING_DEG, LEAST_LEANING = 10.0, 4  # a board square to the camera shows the ratio of focal length to distance alone
LEAST_COVERAGE, GOOD_COVERAGE = 0.35, 0.7  # of the picture's area
FOCAL_LIMIT = 0.01  # relative sd beyond which a focal length is not known
OFF = 3.0  # times the usual misfit: a view in which the board was bent, blurred or misread
BENT_M = 3e-4  # a board this far from flat deserves a better plate; smaller bends are fitted and not spoken of
RAISED_MM, HEIGHT_MM = 10.0, 800.0  # the bed of which warnings speak
ADVICE = (
    "Film the flat board for half a minute, still for a second in each of 20 places: the middle, edges and corners "
    "of the picture, leaning 20 to 40 degrees to another side each time."
)
GRID = (48, 27)  # cells in which coverage is counted
PLACES = np.array(
    [["upper left", "top", "upper right"], ["left", "middle", "right"], ["lower left", "bottom", "lower right"]]
)


def calibrate_camera(files: Sequence[str | Path], progress: Progress | None = None) -> Camera:
    """The camera that took these photos or clips of the board.

    Raises TrackingError, with what to film, where the views do not settle the lens.
    """
    sighting = look_for_board(files, progress)
    chosen = choose_views(sighting.views, sighting.size_px, MOST_VIEWS)
    if len(chosen) < LEAST_VIEWS:
        raise TrackingError(
            f"{len(chosen)} different sharp views of the board are found ({len(sighting.views)} of "
            f"{sighting.looked} pictures show it); {LEAST_VIEWS} are needed, 20 are good. {ADVICE}"
        )
    return camera_from(chosen, sighting.size_px)


def camera_from(views: Sequence[BoardView], size_px: tuple[int, int]) -> Camera:
    """The camera behind these views of the board, in pictures of one size (width, height) [px]."""
    leaning = np.array([_lean_deg(v, size_px) for v in views])
    if (leaning > LEANING_DEG).sum() < LEAST_LEANING:
        raise TrackingError(
            f"The board is nearly square to the camera in all {len(views)} views (at most {leaning.max():.0f} degrees "
            f"off): a long lens far away looks the same as a short one near by. {ADVICE}"
        )
    seen = _covered(views, size_px)
    if seen.mean() < LEAST_COVERAGE:
        raise TrackingError(
            f"The board covers {100 * seen.mean():.0f}% of the picture over all {len(views)} views, little of the "
            f"{_thin(seen)}: how the lens bends is not seen there. {ADVICE}"
        )
    kept, notes = list(views), []
    fit = fit_lens(kept, size_px)
    while len(kept) > LEAST_VIEWS and (off := fit.view_rms_px > OFF * np.median(fit.view_rms_px)).any():
        worst = int(fit.view_rms_px.argmax()) if len(kept) - off.sum() < LEAST_VIEWS else None
        drop = off if worst is None else np.arange(len(kept)) == worst
        notes += [f"{v.source} was left out: it misfits by {e:.2g} px." for v, e in _where(kept, fit.view_rms_px, drop)]
        kept = [v for v, gone in zip(kept, drop, strict=True) if not gone]
        fit = fit_lens(kept, size_px)
    focal_sd = float(np.sqrt(np.diag(fit.covariance)[:2] / fit.values[:2] ** 2).max())
    if focal_sd > FOCAL_LIMIT:
        raise TrackingError(
            f"The focal length is known to {100 * focal_sd:.1f}% only ({len(kept)} views, misfit {fit.rms_px:.2g} px); "
            f"{100 * FOCAL_LIMIT:.0f}% is the limit. {ADVICE}"
        )
    seen = _covered(kept, size_px)
    if fit.bend_m > BENT_M:
        notes.append(f"The board is bent by {1e3 * fit.bend_m:.1f} mm; that was allowed for, a flat plate is better.")
    notes = [_coverage_note(seen), _focal_note(fit, size_px), *notes]
    return _camera(fit, size_px, len(kept), float(seen.mean()), tuple(notes))


def _where(views: Sequence[BoardView], misfit: np.ndarray, mask: np.ndarray) -> list[tuple[BoardView, float]]:
    return [(v, float(e)) for v, e, gone in zip(views, misfit, mask, strict=True) if gone]


def _lean_deg(view: BoardView, size_px: tuple[int, int]) -> float:
    """Angle between the board and the picture's plane, judged with a phone's usual lens."""
    focal = PHONE_FOCAL * max(size_px)
    K = np.array([[focal, 0, (size_px[0] - 1) / 2], [0, focal, (size_px[1] - 1) / 2], [0, 0, 1]])
    _, turn, _ = cv2.solvePnP(view.board_m, view.px, K, None, flags=cv2.SOLVEPNP_IPPE)
    return float(np.rad2deg(np.arccos(min(1.0, abs(cv2.Rodrigues(turn)[0][2, 2])))))


def _covered(views: Sequence[BoardView], size_px: tuple[int, int]) -> Bool[np.ndarray, "row column"]:
    """Which cells of the picture some view's corners enclose."""
    seen = np.zeros(GRID[::-1], np.uint8)
    for view in views:
        hull = cv2.convexHull((view.px * np.array(GRID) / np.array(size_px)).astype(np.float32))
        cv2.fillConvexPoly(seen, np.floor(hull).astype(np.int32), 1)
    return seen.astype(bool)


def _thin(seen: Bool[np.ndarray, "row column"]) -> str:
    """The ninths of the picture of which less than half is covered."""
    shares = np.array([[part.mean() for part in np.array_split(row, 3, axis=1)] for row in np.array_split(seen, 3)])
    return ", ".join(PLACES[shares < 0.5]) or "rim"


def _coverage_note(seen: Bool[np.ndarray, "row column"]) -> str:
    said = f"The board was seen over {100 * seen.mean():.0f}% of the picture"
    if seen.mean() >= GOOD_COVERAGE:
        return said + "."
    return f"{said}, little of the {_thin(seen)}; dots there are placed less surely. {ADVICE}"


def _focal_note(fit: LensFit, size_px: tuple[int, int]) -> str:
    """What the focal length's uncertainty does to dots that lie above the plane of the bed tags."""
    focal = float(fit.values[:2].mean())
    relative = float(np.sqrt(np.diag(fit.covariance)[:2]).max()) / focal
    edge = float(np.hypot(*size_px)) / 2 / focal  # radius over camera height at the picture's corner
    return (
        f"The focal length is known to {100 * relative:.2g}%: a camera {HEIGHT_MM:.0f} mm up is placed to "
        f"{HEIGHT_MM * relative:.1g} mm, dots {RAISED_MM:.0f} mm above the bed tags to "
        f"{RAISED_MM * edge * relative:.1g} mm at the picture's corner."
    )


def _camera(fit: LensFit, size_px: tuple[int, int], views: int, coverage: float, notes: tuple[str, ...]) -> Camera:
    v, sd = fit.values.tolist(), np.sqrt(np.diag(fit.covariance)).tolist()
    keys = ("k1", "k2", "p1", "p2", "k3")
    return Camera(
        image_size_px=size_px,
        focal_px=(v[0], v[1]),
        centre_px=(v[2], v[3]),
        **dict(zip(keys, v[4:], strict=True)),
        sd=Deviations(focal_px=(sd[0], sd[1]), centre_px=(sd[2], sd[3]), **dict(zip(keys, sd[4:], strict=True))),
        covariance=tuple(tuple(row) for row in fit.covariance.tolist()),
        reprojection_rms_px=fit.rms_px,
        views=views,
        coverage=coverage,
        notes=notes,
    )
