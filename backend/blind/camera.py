"""The pinhole camera of the renderer and the flat bed it looks at.

Bed coordinates are (X, Y, h): along the bed's x axis, along its y axis, and above it towards the camera.
Pixel (0, 0) is the centre of the upper left pixel, u runs right and v runs down.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

Array = np.ndarray


@dataclass(frozen=True)
class Sticker:
    """A coloured dot on a white ring lying still on the bed, to lead a tracker astray."""

    x_m: float
    y_m: float
    colour_rgb: tuple[float, float, float] = (0.10, 0.45, 0.15)
    radius_m: float = 0.004


@dataclass(frozen=True)
class Bed:
    """A flat bed: its place in the world W and the marks printed on it.

    marks: id -> (X, Y) [m] in bed coordinates.  x_axis_W and y_axis_W are orthonormal, in W; the camera
    stands on the side of x_axis_W x y_axis_W.
    """

    marks_m: dict[str, tuple[float, float]]
    origin_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    x_axis: tuple[float, float, float] = (1.0, 0.0, 0.0)
    y_axis: tuple[float, float, float] = (0.0, 1.0, 0.0)
    stickers: tuple[Sticker, ...] = field(default=())

    def from_world(self, p_W: Float[Array, "*batch 3"]) -> Float[Array, "*batch 3"]:
        """Bed coordinates (X, Y, h) [m] of world positions [m]."""
        x, y = np.asarray(self.x_axis, float), np.asarray(self.y_axis, float)
        return (np.asarray(p_W, float) - np.asarray(self.origin_m, float)) @ np.stack([x, y, np.cross(x, y)], 1)


@dataclass(frozen=True)
class Camera:
    """A pinhole camera whose axis passes through `look_at_m` on the bed, `height_m` away along that axis.

    tilt_deg: rotations about the camera's own x, y and z axes; zero looks straight down at the bed.
    k1: radial distortion, x_d = x (1 + k1 r^2) in units of the focal length (Brown's model, first term).
    """

    focal_px: float = 1600.0
    height_m: float = 0.8
    width_px: int = 1280
    height_px: int = 720
    look_at_m: tuple[float, float] = (0.0, 0.0)
    tilt_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    k1: float = 0.0

    @property
    def centre_px(self) -> Float[Array, "2"]:
        """The principal point: the middle of the picture."""
        return np.array([(self.width_px - 1) / 2, (self.height_px - 1) / 2])

    @property
    def axes(self) -> Float[Array, "3 3"]:
        """Rows: the camera's right, down and forward directions in bed coordinates."""
        a, b, c = np.deg2rad(np.asarray(self.tilt_deg, float))
        about_x = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
        about_y = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
        about_z = np.array([[np.cos(c), -np.sin(c), 0], [np.sin(c), np.cos(c), 0], [0, 0, 1]])
        return about_z @ about_y @ about_x @ np.diag([1.0, -1.0, -1.0])

    @property
    def position_m(self) -> Float[Array, "3"]:
        """Where the pinhole is, in bed coordinates [m]."""
        return np.array([*self.look_at_m, 0.0]) - self.height_m * self.axes[2]

    def project(self, p_bed: Float[Array, "*batch 3"]) -> Float[Array, "*batch 2"]:
        """Pixels (u, v) of points in bed coordinates [m]."""
        p = (np.asarray(p_bed, float) - self.position_m) @ self.axes.T
        xy = p[..., :2] / p[..., 2:]
        return self.centre_px + self.focal_px * xy * (1 + self.k1 * (xy**2).sum(-1, keepdims=True))

    def slopes(self) -> Float[Array, "height width 2"]:
        """dX/dh and dY/dh along the ray of every pixel.

        The pixel sees, on the plane at height h, the point position[:2] + slope * (h - position[2]).
        """
        u, v = np.meshgrid(np.arange(self.width_px, dtype=float), np.arange(self.height_px, dtype=float))
        seen = (np.stack([u, v], -1) - self.centre_px) / self.focal_px
        xy = seen.copy()
        for _ in range(20 if self.k1 else 0):  # |k1| r^2 < 0.1 here: each pass gains a decimal digit
            xy = seen / (1 + self.k1 * (xy**2).sum(-1, keepdims=True))
        ray = np.concatenate([xy, np.ones_like(xy[..., :1])], -1) @ self.axes
        return (ray[..., :2] / ray[..., 2:]).astype(np.float32)


def stage(
    markers_m: dict[str, Float[Array, "time 3"]],
    *,
    origin_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    x_axis: tuple[float, float, float] = (1.0, 0.0, 0.0),
    y_axis: tuple[float, float, float] = (0.0, 1.0, 0.0),
    fill: float = 0.7,
    focal_px: float = 1600.0,
    width_px: int = 1280,
    height_px: int = 720,
) -> tuple[Camera, Bed]:
    """A camera and a bed with eight marks that frame a whole motion.

    fill: the part of the picture that the motion takes, in its tighter direction.
    """
    bed = Bed({}, origin_m, x_axis, y_axis)
    path = np.concatenate([bed.from_world(p) for p in markers_m.values()])[:, :2]
    low, high = path.min(0), path.max(0)
    x, y = (low + high) / 2
    extent = np.maximum(high - low, 0.02)
    scale_m = float(max(extent[0] / width_px, extent[1] / height_px)) / fill  # one pixel on the bed
    camera = Camera(focal_px, scale_m * focal_px, width_px, height_px, (float(x), float(y)))
    half_w, half_h = 0.46 * width_px * scale_m, 0.44 * height_px * scale_m
    spots = [(-1, -1), (0, -1), (1, -1), (1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0)]
    marks = {f"bed{k}": (float(x + a * half_w), float(y + b * half_h)) for k, (a, b) in enumerate(spots)}
    return camera, Bed(marks, origin_m, x_axis, y_axis)
