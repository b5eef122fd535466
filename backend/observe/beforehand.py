"""What is known of a camera and of the dots' heights before a clip is looked at, as normal priors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from backend.observe.bed import Bed
from backend.observe.bundle import Prior
from backend.observe.camera import Camera
from backend.observe.project import PHONE_FOCAL

# Main cameras of phones and small cameras, 45 to 90 degrees across; action cameras bend more and want the board.
FOCAL_SD = 0.25  # of the focal length
ASPECT_SD = 5e-4  # of fx against fy: pixels are square
CENTRE_SD = 0.01  # of the picture's longer side
BEND_SD = {"k1": 0.1, "k2": 0.05, "p1": 5e-4, "p2": 5e-4, "k3": 0.0}
UNKNOWN_HEIGHT_M, UNKNOWN_HEIGHT_SD_M = 0.010, 0.020  # of all dots together: bars lie on a bed, or on posts
LAYER_SD_M = 0.005  # of one dot against the others: bars are stacked


def unknown_lens(width_px: int, height_px: int) -> tuple[Float[np.ndarray, "9"], Float[np.ndarray, "9 9"]]:
    """Values (camera.PARAMETERS) and covariance of a camera that nobody calibrated."""
    longer = max(width_px, height_px)
    focal = PHONE_FOCAL * longer
    values = np.array([focal, focal, (width_px - 1) / 2, (height_px - 1) / 2, 0, 0, 0, 0, 0])
    covariance = np.diag(np.r_[0, 0, [(CENTRE_SD * longer) ** 2] * 2, [sd**2 for sd in BEND_SD.values()]])
    covariance[:2, :2] = (FOCAL_SD * focal) ** 2 + (ASPECT_SD * focal) ** 2 * np.eye(2)
    return values, covariance


def known_heights(
    bed: Bed, markers: Sequence[str]
) -> tuple[Float[np.ndarray, "marker"], Float[np.ndarray, "marker marker"]]:
    """Heights above the bed [m] and their covariance."""
    given = bed.marker_height_m
    listed = given if isinstance(given, dict) else dict.fromkeys(markers if given is not None else (), given)
    known = np.array([name in listed for name in markers])
    heights = np.array([listed.get(name, UNKNOWN_HEIGHT_M) for name in markers], float)
    together = np.outer(~known, ~known) * UNKNOWN_HEIGHT_SD_M**2
    return heights, together + np.diag(np.where(known, bed.marker_height_sd_m, LAYER_SD_M) ** 2)


def before(
    lens: tuple[Float[np.ndarray, "9"], Float[np.ndarray, "9 9"]],
    heights: tuple[Float[np.ndarray, "marker"], Float[np.ndarray, "marker marker"]],
) -> Prior:
    """Lens and heights, known apart from each other."""
    (values, of_lens), (heights_m, of_heights) = lens, heights
    n, m = len(values), len(heights_m)
    covariance = np.zeros((n + m, n + m))
    covariance[:n, :n], covariance[n:, n:] = of_lens, of_heights
    return Prior.of(values, heights_m, covariance)


def before_of(camera: Camera, markers: Sequence[str], bed: Bed) -> Prior:
    """A calibrated lens and the heights: those that were found with it, unless the bed gives others."""
    pose = camera.pose
    found = None if pose is None else pose.found_heights_m() or None
    if pose is None or list(pose.marker_height_m) != list(markers) or bed.marker_height_m != found:
        return before((camera.values(), np.array(camera.covariance)), known_heights(bed, markers))
    whole = np.array(pose.covariance)
    kept = np.r_[0:9, 15 : len(whole)]
    return Prior.of(camera.values(), np.array([*pose.marker_height_m.values()]), whole[np.ix_(kept, kept)])
