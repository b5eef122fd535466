"""Where the bed lies in the world."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from pydantic import model_validator

from backend.observe.described import Described, Number

Vector = tuple[Number, Number, Number]


class Plane(Described):
    """Where the bed lies in the world W: its origin [m] and the directions of its x and y, orthonormal.

    A flat bed is the default; an upright rig has x_axis (1, 0, 0) and y_axis (0, 0, 1).
    """

    origin_m: Vector = (0.0, 0.0, 0.0)
    x_axis: Vector = (1.0, 0.0, 0.0)
    y_axis: Vector = (0.0, 1.0, 0.0)

    @model_validator(mode="after")
    def _orthonormal(self) -> Plane:
        axes = np.array([self.x_axis, self.y_axis])
        if np.abs(axes @ axes.T - np.eye(2)).max() > 1e-6:
            raise ValueError(f"x_axis {self.x_axis} and y_axis {self.y_axis} are not unit vectors at a right angle")
        return self

    def axes(self) -> Float[np.ndarray, "3 3"]:
        """Rows: the bed's x, y and normal (x cross y), in W."""
        x, y = np.array(self.x_axis), np.array(self.y_axis)
        return np.stack([x, y, np.cross(x, y)])

    def from_world(self, p_W: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
        """Bed coordinates (x, y, along the normal) [m] of world positions [m]."""
        return (np.asarray(p_W, float) - np.array(self.origin_m)) @ self.axes().T

    def at(self, p_bed: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
        """World positions [m] of bed coordinates (x, y, along the normal) [m]."""
        return np.array(self.origin_m) + np.asarray(p_bed, float) @ self.axes()

    def to_world(self, xy_m: Float[np.ndarray, "*batch 2"]) -> Float[np.ndarray, "*batch 3"]:
        """World positions [m] of points in the bed; what runs along the normal is not measured: NaN.

        Where the normal is no world axis, all three coordinates are those of the point in the plane.
        """
        world = np.array(self.origin_m) + np.asarray(xy_m) @ self.axes()[:2]
        unseen = np.abs(np.abs(self.axes()[2]) - 1) < 1e-9
        return np.where(unseen, np.nan, world)
