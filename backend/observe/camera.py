"""A camera's lens as calibrated and saved: camera.json, made once and used for every clip at the same setting."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float
from pydantic import ValidationError

from backend.observe.described import Described, Number
from backend.observe.lens import Lens
from backend.observe.plane import Plane, Vector
from backend.observe.tracking_error import TrackingError

CAMERA = "camera.json"  # what a clip's own camera is written to
PARAMETERS = ("fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2", "p1", "p2", "k3")
Pair = tuple[Number, Number]
POSE_PARAMETERS = ("turn_x_rad", "turn_y_rad", "turn_z_rad", "x_m", "y_m", "z_m")
GUESSED_M = 0.01  # beforehand.py guesses heights to 20 mm; bars and marks tell them to a few
SAME_SHAPE = 0.002  # relative: 1920 x 1080 and 854 x 480 have one shape


class Values(Described):
    """What PARAMETERS name."""

    focal_px: Pair
    centre_px: Pair
    k1: Number
    k2: Number
    p1: Number
    p2: Number
    k3: Number


class Deviations(Values):
    """Standard deviation of each value of a camera; zero where it was held fixed."""


class CameraPose(Described):
    """Where a camera stood, and how high above the bed the markers are that it saw.

    position_m: the pinhole, in W.  quaternion_wxyz: from the camera's axes (right, down, ahead) to W.  plane: the bed.
    marker_height_m: above it, towards the camera.  covariance: of PARAMETERS, then POSE_PARAMETERS (a turn about the
    camera's own axes, after the quaternion; the position in W), then the heights in their order.
    """

    position_m: Vector
    quaternion_wxyz: tuple[Number, Number, Number, Number]
    plane: Plane = Plane()
    marker_height_m: dict[str, Number]
    covariance: tuple[tuple[Number, ...], ...]

    def found_heights_m(self) -> dict[str, float]:
        """The heights that were found or given, by marker [m], without those that were only guessed."""
        sd = np.sqrt(np.diag(np.array(self.covariance))[len(PARAMETERS) + len(POSE_PARAMETERS) :])
        return {name: h for (name, h), s in zip(self.marker_height_m.items(), sd, strict=True) if s < GUESSED_M}


class Camera(Values):
    """A calibrated lens, in pixels of the upright picture; (0, 0) is the centre of the upper left pixel.

    covariance: of PARAMETERS, in that order.  coverage: the part of the picture in which the board was seen.  pose:
    where it stood, for a camera that did not move since.
    """

    image_size_px: tuple[int, int]
    sd: Deviations
    covariance: tuple[tuple[Number, ...], ...]
    reprojection_rms_px: Number
    views: int
    coverage: Number
    notes: tuple[str, ...] = ()
    pose: CameraPose | None = None

    def values(self) -> Float[np.ndarray, "9"]:
        """The numbers in the order of PARAMETERS."""
        return np.array([*self.focal_px, *self.centre_px, self.k1, self.k2, self.p1, self.p2, self.k3])

    def for_picture(self, width_px: int, height_px: int) -> tuple[Camera, list[str]]:
        """The camera in pixels of a picture of this size, and what to warn of.

        A picture of the same shape is taken for the same view, more or less finely resolved.  Raises
        TrackingError for other shapes: which part of the sensor they show is not known.
        """
        made_w, made_h = self.image_size_px
        sizes = f"the camera file was made from {made_w} x {made_h} pictures, the clip has {width_px} x {height_px}"
        remedy = "Film the board again at the clip's setting and run linktwin calibrate on it."
        if (made_w > made_h) != (width_px > height_px) and made_w != made_h:
            raise TrackingError(f"The clip is turned: {sizes}. Hold the camera alike for board and clip. {remedy}")
        scale = width_px / made_w
        if abs(height_px / made_h / scale - 1) > SAME_SHAPE:
            raise TrackingError(f"The lens does not fit: {sizes}, another shape. {remedy}")
        if width_px == made_w:
            return self, []
        return self._scaled(scale, (width_px, height_px)), [
            f"The lens was scaled by {scale:.3g}, for {sizes}. That holds only where both settings show the same "
            f"part of the scene; many cameras crop at high rates. {remedy}"
        ]

    def lens_for(self, width_px: int, height_px: int) -> tuple[Lens, list[str]]:
        """The lens of `for_picture`, and what to warn of."""
        camera, warnings = self.for_picture(width_px, height_px)
        bends = {name: getattr(camera, name) for name in PARAMETERS[4:]}
        return Lens(focal_px=camera.focal_px, centre_px=camera.centre_px, **bends), warnings

    def _scaled(self, scale: float, size_px: tuple[int, int]) -> Camera:
        def by(values: Pair, offset: float = 0.0) -> Pair:
            return ((values[0] + offset) * scale - offset, (values[1] + offset) * scale - offset)

        def spread(rows: tuple[tuple[float, ...], ...]) -> tuple[tuple[float, ...], ...]:
            size = np.where(np.arange(len(rows)) < 4, scale, 1.0)  # focal lengths and centre are pixels
            return tuple(tuple(row) for row in (np.array(rows) * np.outer(size, size)).tolist())

        sd = self.sd.model_copy(update={"focal_px": by(self.sd.focal_px), "centre_px": by(self.sd.centre_px)})
        pose = self.pose and self.pose.model_copy(update={"covariance": spread(self.pose.covariance)})
        return self.model_copy(
            update={
                "image_size_px": size_px, "focal_px": by(self.focal_px), "centre_px": by(self.centre_px, 0.5), "sd": sd,
                "covariance": spread(self.covariance), "reprojection_rms_px": self.reprojection_rms_px * scale,
                "pose": pose,
            }
        )  # fmt: skip


def read_camera(path: str | Path) -> Camera:
    """A camera from its file.  Raises TrackingError for a file that is none."""
    try:
        return Camera.model_validate_json(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise TrackingError(
            f"The camera file {path} cannot be read ({error.strerror}). Give its path from the bed file's folder."
        ) from error
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"])) or "the file"
        raise TrackingError(
            f"{path} is no camera file ({where}: {first['msg']}). Make one with linktwin calibrate."
        ) from error


def warn_stale(folder: str | Path) -> list[str]:
    """Whether a folder, to which tracks without a camera are written, holds a camera of something else."""
    path = Path(folder) / CAMERA
    if not path.exists():
        return []
    return [
        f"{path} was there before and is not of these tracks, which have no camera file: do not name it for them. Give "
        "another --out, or remove it where it is of no use."
    ]


def write_camera(camera: Camera, path: str | Path) -> Path:
    """Write camera.json; the folder is made where it is missing."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(camera.model_dump_json(indent=1) + "\n", encoding="utf-8")
    return path
