"""From pixels to metres on the bed, and back.

Two views of a flat bed: a homography, which needs nothing but four marks and holds for dots in the plane of
the marks; and a pinhole with a known lens, whose pose follows from the marks and which also holds for dots
above that plane (Hartley and Zisserman, Multiple View Geometry, 2nd ed., ch. 4 and 8).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float

from backend.observe.bed import Bed
from backend.observe.lens import Lens, bend, straighten
from backend.observe.tracking_error import TrackingError

Points = Float[np.ndarray, "n 2"]
PHONE_FOCAL = 0.78  # focal length over picture width of a phone's main camera (65 degrees across)


class AbstractView(ABC):
    """How the camera sees the bed.  Heights are above the plane of the marks, towards the camera [m]."""

    @abstractmethod
    def metres(self, px: Points, height_m: Float[np.ndarray, "n"]) -> Points:
        """Bed coordinates [m] of points seen at pixels `px`."""

    @abstractmethod
    def pixels(self, xy_m: Points, height_m: Float[np.ndarray, "n"]) -> Points:
        """Pixels at which points of the bed are seen."""

    def slope(self, px: Points, height_m: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n 2 2"]:
        """d(metres)/d(pixels), by central differences over one pixel."""
        half = 0.5 * np.eye(2)
        return np.stack([self.metres(px + d, height_m) - self.metres(px - d, height_m) for d in half], -1)


def apply(H: Float[np.ndarray, "3 3"], p: Points) -> Points:
    """Points through a homography."""
    q = np.c_[p, np.ones(len(p))] @ H.T
    return q[:, :2] / q[:, 2:]


@dataclass(frozen=True)
class HomographyView(AbstractView):
    """A plane seen through an ideal lens.

    Raised dots are corrected only where the camera's height is known: they look too far from the point
    below the camera by height / camera height.  That point is taken to be the picture's middle.
    """

    H: Float[np.ndarray, "3 3"]
    nadir_px: Float[np.ndarray, "2"]
    camera_height_m: float | None

    def _shrink(self, height_m: np.ndarray) -> np.ndarray:
        return 1 - (height_m / self.camera_height_m if self.camera_height_m else 0 * height_m)[:, None]

    def metres(self, px: Points, height_m: Float[np.ndarray, "n"]) -> Points:
        """Bed coordinates [m], drawn towards the nadir for raised dots."""
        nadir = apply(self.H, self.nadir_px[None])
        return nadir + (apply(self.H, px) - nadir) * self._shrink(height_m)

    def pixels(self, xy_m: Points, height_m: Float[np.ndarray, "n"]) -> Points:
        """Pixels, pushed away from the nadir for raised dots."""
        nadir = apply(self.H, self.nadir_px[None])
        return apply(np.linalg.inv(self.H), nadir + (xy_m - nadir) / self._shrink(height_m))


@dataclass(frozen=True)
class PinholeView(AbstractView):
    """A camera with a known lens at a known pose: x_camera = R @ x_bed + t [m]."""

    lens: Lens
    centre_px: Float[np.ndarray, "2"]
    R: Float[np.ndarray, "3 3"]
    t: Float[np.ndarray, "3"]

    @property
    def position_m(self) -> Float[np.ndarray, "3"]:
        """The pinhole in bed coordinates [m]."""
        return -self.R.T @ self.t

    def metres(self, px: Points, height_m: Float[np.ndarray, "n"]) -> Points:
        """Where the rays through the pixels meet the dots' heights [m]."""
        ray = np.c_[straighten(px, self.lens, self.centre_px), np.ones(len(px))] @ self.R
        eye = self.position_m
        return eye[:2] + ray[:, :2] * ((height_m * np.sign(eye[2]) - eye[2]) / ray[:, 2])[:, None]

    def pixels(self, xy_m: Points, height_m: Float[np.ndarray, "n"]) -> Points:
        """Pixels of the points through the distorted lens."""
        p = np.c_[xy_m, height_m * np.sign(self.position_m[2])] @ self.R.T + self.t
        return self.centre_px + self.lens.focal() * bend(p[:, :2] / p[:, 2:], self.lens)


def calibrate(bed: Bed, width_px: int, height_px: int) -> AbstractView:
    """The view that carries the bed's marks from the picture onto the bed.

    A homography where no lens is given, of a stick a similarity; else the pose of a pinhole. Least squares where
    there are more than four marks. Raises TrackingError where the marks allow neither.
    """
    middle = np.array([(width_px - 1) / 2, (height_px - 1) / 2])
    if bed.stick:
        return HomographyView(bed.stick.to_metres(), middle, bed.camera_height_m)
    if bed.lens is None:
        H, _ = cv2.findHomography(bed.pixels(), bed.metres())
        if H is None or not np.isfinite(H).all():
            raise TrackingError("The bed marks fix no view of the bed; check their metres and their pixels.")
        depth = np.c_[bed.pixels(), np.ones(len(bed.marks))] @ H[2]
        if depth.min() * depth.max() <= 0:  # some would be seen behind the camera
            raise TrackingError(
                f"The bed marks {', '.join(m.id for m in bed.marks)} are seen in another order round than they lie on "
                "the bed. Two of them are swapped, or one is far from where the bed file has it."
            )
        return HomographyView(np.asarray(H, float), middle, bed.camera_height_m)
    return pose(bed, bed.lens, middle if bed.lens.centre_px is None else np.array(bed.lens.centre_px))


def pose(bed: Bed, lens: Lens, centre_px: Float[np.ndarray, "2"]) -> PinholeView:
    """Where a camera of this lens stands to see the bed's marks at their pixels.

    Raises TrackingError where the marks allow no pose.
    """
    flat = np.c_[bed.metres(), np.zeros(len(bed.marks))]
    rays = straighten(bed.pixels(), lens, centre_px)
    found, turn, t = cv2.solvePnP(flat, rays[:, None], np.eye(3), None)
    if not found or not np.isfinite(t).all():
        raise TrackingError("The bed marks fix no pose of the camera; check their metres, pixels and the lens.")
    return PinholeView(lens, centre_px, np.asarray(cv2.Rodrigues(turn)[0], float), np.ravel(t).astype(float))


def view_in_picture(bed: Bed, width_px: int, height_px: int) -> AbstractView:
    """The view of a clip of this size.  Raises TrackingError where a bed mark lies outside its picture."""
    far = [m.id for m in bed.marks if not (-1 < m.x_px < width_px and -1 < m.y_px < height_px)]
    if far:
        raise TrackingError(
            f"Bed marks {', '.join(far)} lie outside the {width_px} x {height_px} picture; "
            "take their pixels from a frame of this clip, as it is shown upright."
        )
    return calibrate(bed, width_px, height_px)


def mark_residuals_px(bed: Bed, view: AbstractView) -> Float[np.ndarray, "mark"]:
    """How far each mark is from where the view puts it [px]; zero by construction for four marks."""
    return np.hypot(*(view.pixels(bed.metres(), np.zeros(len(bed.marks))) - bed.pixels()).T)


def parallax_per_height(view: AbstractView, px: Points, width_px: int) -> tuple[float, float]:
    """The worst misplacement [m] per metre of unknown height over the given pixels, and the camera height [m].

    Without a lens the camera height is that of a typical phone.
    """
    flat = np.zeros(len(px))
    on_bed = view.metres(px, flat)
    if isinstance(view, PinholeView):
        eye = view.position_m
        below, height_m = eye[:2], abs(float(eye[2]))
    elif isinstance(view, HomographyView):
        below = apply(view.H, view.nadir_px[None])[0]
        scale = np.sqrt(np.abs(np.linalg.det(view.slope(view.nadir_px[None], flat[:1])[0])))
        height_m = view.camera_height_m or PHONE_FOCAL * width_px * float(scale)
    else:
        raise TypeError(f"no parallax is known for {type(view).__name__}")
    return float(np.hypot(*(on_bed - below).T).max()) / height_m, height_m
