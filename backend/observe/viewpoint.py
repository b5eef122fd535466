"""A camera where it stands: pixels of points in the world, and how they move with lens, pose and point.

The derivatives are written out, so that reading a clip needs no JAX; a fit chains them with those of the motion.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from backend.observe.camera import PARAMETERS, Camera, CameraPose
from backend.observe.lens import Lens, bend, bend_slopes, straighten
from backend.observe.plane import Plane

LENS, POSE = len(PARAMETERS), 6


@dataclass(frozen=True)
class Viewpoint:
    """values: of the lens, in the order of camera.PARAMETERS; R_CW: from W to right, down, ahead; p_WC: pinhole [m]."""

    values: Float[np.ndarray, "9"]
    R_CW: Float[np.ndarray, "3 3"]
    p_WC: Float[np.ndarray, "3"]

    @classmethod
    def of(cls, camera: Camera, pose: CameraPose) -> Viewpoint:
        """A saved camera at its saved pose."""
        turned = Rotation.from_quat(pose.quaternion_wxyz, scalar_first=True)
        return cls(camera.values(), turned.as_matrix().T, np.array(pose.position_m))

    @property
    def lens(self) -> Lens:
        """Its lens."""
        fx, fy, cx, cy, *bends = self.values.tolist()
        return Lens(focal_px=(fx, fy), centre_px=(cx, cy), **dict(zip(PARAMETERS[4:], bends, strict=True)))

    @property
    def quaternion_wxyz(self) -> tuple[float, ...]:
        """From the camera's axes to W."""
        return tuple(Rotation.from_matrix(self.R_CW.T).as_quat(scalar_first=True).tolist())

    def moved(self, change: Float[np.ndarray, "15"]) -> Viewpoint:
        """Lens values added, then turned about the camera's own axes [rad], then shifted in W [m]."""
        turn = Rotation.from_rotvec(change[LENS : LENS + 3]).as_matrix()
        return replace(
            self, values=self.values + change[:LENS], R_CW=turn @ self.R_CW, p_WC=self.p_WC + change[LENS + 3 :]
        )

    def pixels(self, p_W: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 2"]:
        """Where world points [m] are seen."""
        p_C = (p_W - self.p_WC) @ self.R_CW.T
        lens = self.lens
        return self.values[2:4] + lens.focal() * bend(p_C[:, :2] / p_C[:, 2:], lens)

    def slopes(self, p_W: Float[np.ndarray, "n 3"]) -> tuple[Float[np.ndarray, "n 2 15"], Float[np.ndarray, "n 2 3"]]:
        """d(pixels)/d(change), as `moved` takes it, and d(pixels)/d(point)."""
        p_C = (p_W - self.p_WC) @ self.R_CW.T
        x, y, z = p_C.T
        xy, lens = p_C[:, :2] / p_C[:, 2:], self.lens
        seen, (by_slope, by_bend) = bend(xy, lens), bend_slopes(xy, lens)
        zero = np.zeros_like(x)
        perspective = np.stack([np.stack([1 / z, zero, -x / z**2], -1), np.stack([zero, 1 / z, -y / z**2], -1)], -2)
        by_point_C = lens.focal()[:, None] * (by_slope @ perspective)
        cross = np.stack(
            [np.stack([zero, z, -y], -1), np.stack([-z, zero, x], -1), np.stack([y, -x, zero], -1)], -2
        )  # d(turned point)/d(turn) = -[p]x
        by_point = by_point_C @ self.R_CW
        focal = seen[:, :, None] * np.eye(2)
        centre = np.broadcast_to(np.eye(2), focal.shape)
        bends = lens.focal()[:, None] * by_bend
        return np.concatenate([focal, centre, bends, by_point_C @ cross, -by_point], 2), by_point

    def on_plane(
        self, px: Float[np.ndarray, "n 2"], plane: Plane, height_m: Float[np.ndarray, "n"]
    ) -> Float[np.ndarray, "n 2"]:
        """Bed coordinates [m] where the rays through pixels meet these heights above the bed, towards the camera."""
        ray = plane.axes() @ self.R_CW.T @ np.c_[straighten(px, self.lens, self.values[2:4]), np.ones(len(px))].T
        eye = plane.from_world(self.p_WC)
        return eye[:2] + (ray[:2] * ((height_m * np.sign(eye[2]) - eye[2]) / ray[2])).T
