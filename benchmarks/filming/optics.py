"""The camera that films: a bent lens, a pose that may shake, rows read one after another.

Bed coordinates are (X, Y, h): the world's x and y, and h above the bed towards the camera.  Row 0 is exposed at a
frame's time; row v later by v / (rows - 1) of the readout.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

Array = np.ndarray
DOWN = np.diag([1.0, -1.0, -1.0])  # right, down and forward of a camera that looks straight down at the bed


@dataclass(frozen=True)
class Shake:
    """A hand's tremor: sums of sines in place [m] and angle [rad], `amount` 1 for an unsteady hand."""

    amount: float = 0.0

    def at(self, time_s: Float[Array, "t"]) -> tuple[Float[Array, "t 3"], Float[Array, "t 3"]]:
        """How far the camera has moved and turned."""
        t = np.asarray(time_s, float)[..., None]
        move = sum(
            a * np.sin(2 * np.pi * f * t + np.array([0.3, 2.1, 4.0]) * k)
            for k, (f, a) in enumerate(((0.9, 1.5e-3), (3.1, 6e-4), (8.7, 1.5e-4)), 1)
        )
        turn = sum(
            a * np.sin(2 * np.pi * f * t + np.array([1.7, 0.2, 3.3]) * k)
            for k, (f, a) in enumerate(((1.3, 2.5e-3), (4.2, 8e-4), (9.5, 2e-4)), 1)
        )
        return self.amount * np.asarray(move), self.amount * np.asarray(turn)


@dataclass(frozen=True)
class Optics:
    """Brown's lens, focal length and centre in pixels; pose: `height_m` above `look_at_m`, tilted; readout [s]."""

    width: int = 1280
    height: int = 720
    focal_px: float = 1600.0
    centre_px: tuple[float, float] = (646.3, 355.2)
    k1: float = -0.045
    k2: float = 0.02
    p1: float = 4e-4
    p2: float = -3e-4
    height_m: float = 0.8
    look_at_m: tuple[float, float] = (0.0, 0.0)
    tilt_deg: tuple[float, float, float] = (1.6, -1.1, 0.7)
    readout_s: float = 3.5e-3
    shake: Shake = Shake()

    @cached_property
    def rays(self) -> Float[Array, "h w 2"]:
        """Slopes x/z, y/z of each pixel's ray in the camera's axes."""
        u, v = np.meshgrid(np.arange(self.width, dtype=float), np.arange(self.height, dtype=float))
        seen = (np.stack([u, v], -1) - self.centre_px) / self.focal_px
        xy = seen.copy()
        for _ in range(30):  # each pass gains more than a digit: k1 r^2 < 0.01
            xy = xy - (self.bend(xy) - seen)
        return xy

    def bend(self, xy: Float[Array, "*n 2"]) -> Float[Array, "*n 2"]:
        """Brown's distortion."""
        x, y = xy[..., 0], xy[..., 1]
        r2 = x * x + y * y
        radial = 1 + self.k1 * r2 + self.k2 * r2 * r2
        return np.stack(
            [
                x * radial + 2 * self.p1 * x * y + self.p2 * (r2 + 2 * x * x),
                y * radial + self.p1 * (r2 + 2 * y * y) + 2 * self.p2 * x * y,
            ],
            -1,
        )

    def pose(self, time_s: Float[Array, "t"]) -> tuple[Float[Array, "t 3 3"], Float[Array, "t 3"]]:
        """Axes (rows: right, down, forward, in bed coordinates) and place [m] of the camera."""
        move, turn = self.shake.at(time_s)
        axes = Rotation.from_euler("xyz", np.deg2rad(self.tilt_deg) + turn).as_matrix() @ DOWN
        away = np.array([*self.look_at_m, 0.0]) - self.height_m * self.forward
        return axes, away + move

    @cached_property
    def forward(self) -> Float[Array, "3"]:
        """Where the steady camera looks, in bed coordinates."""
        return (Rotation.from_euler("xyz", np.deg2rad(self.tilt_deg)).as_matrix() @ DOWN)[2]

    def row_times(self, time_s: float) -> Float[Array, "h"]:
        """When each row of a frame is exposed [s]."""
        return time_s + self.readout_s * np.arange(self.height) / (self.height - 1)

    def slopes(self, time_s: float) -> tuple[Float[Array, "h w 2"], Float[Array, "h 1 3"]]:
        """dX/dh, dY/dh along every pixel's ray, and where the camera is as each row is exposed.

        A pixel sees, at height h, the point place[:2] + slope (h - place[2]).
        """
        axes, place = self.pose(self.row_times(time_s))
        ray = np.concatenate([self.rays, np.ones_like(self.rays[..., :1])], -1)
        ray = np.einsum("hwi,hij->hwj", ray, axes) if self.shake.amount else ray @ axes[0]
        return (ray[..., :2] / ray[..., 2:]).astype(np.float32), place[:, None].astype(np.float32)

    def see(self, p_bed: Float[Array, "n 3"], time_s: Float[Array, "n"]) -> Float[Array, "n 2"]:
        """Pixels of points in bed coordinates [m] at each one's own time."""
        axes, place = self.pose(time_s)
        p = np.einsum("nij,nj->ni", axes, p_bed - place)
        return np.asarray(self.centre_px) + self.focal_px * self.bend(p[:, :2] / p[:, 2:])

    def film(
        self, points: Callable[[Array], Float[Array, "t n 3"]], time_s: float
    ) -> tuple[Float[Array, "n 2"], Float[Array, "n"]]:
        """Where a frame shows moving points, and when it saw each: the time of the row that it lies in."""
        count = points(np.array([time_s])).shape[1]
        when = np.full(count, time_s)
        px = np.zeros((count, 2))
        for _ in range(6):  # the row moves by speed x readout / rows: each pass gains two digits
            px = self.see(points(when)[np.arange(count), np.arange(count)], when)
            when = time_s + self.readout_s * px[:, 1] / (self.height - 1)
        return px, when
