"""Where one frame stands in another, in the millimetres of CAD."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from backend.mechanism.drawing_error import DrawingError

if TYPE_CHECKING:
    import cadquery as cq

RIGID = 1e-9  # an orthonormal matrix computed in double precision is off by 1e-15, a scaled or mirrored one by far more
ROUNDING = 1e-12  # what is smaller than this share of its neighbours is the rounding of sines and cosines


@dataclass(frozen=True)
class Placement:
    """X_AB, the pose of frame B in frame A.

    rotation: R_AB, its columns are B's axes in A.
    position_mm: p_AB, from A's origin to B's, in A [mm].
    """

    rotation: Float[np.ndarray, "3 3"] = field(default_factory=lambda: np.eye(3))
    position_mm: Float[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))

    def __matmul__(self, other: Placement) -> Placement:
        """X_AC = X_AB @ X_BC."""
        return Placement(self.rotation @ other.rotation, self.point(other.position_mm))

    def inverse(self) -> Placement:
        """X_BA."""
        return Placement(self.rotation.T, -self.rotation.T @ self.position_mm)

    def point(self, p: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
        """Coordinates in A of a point given in B [mm]."""
        return self.rotation @ p + self.position_mm

    def direction(self, d: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
        """Coordinates in A of a direction given in B."""
        return self.rotation @ d

    def location(self) -> cq.Location:
        """The same pose for CadQuery."""
        import cadquery as cq
        from OCP.gp import gp_Trsf  # pyright: ignore[reportAttributeAccessIssue]

        transform = gp_Trsf()
        rows = np.column_stack([self.rotation, self.position_mm])
        transform.SetValues(*(float(entry) for entry in rows.ravel()))
        return cq.Location(transform)

    def json(self) -> dict[str, list[float]]:
        """The pose as mechanism.json writes it: metres and a unit quaternion [w, x, y, z]."""
        return {
            "position_m": metres(self.position_mm),
            "quaternion_wxyz": without_rounding(quaternion(self.rotation), 1.0),
        }


def placement_of(location: cq.Location, part: str) -> Placement:
    """The pose in a CadQuery location; DrawingError naming the part when it scales or mirrors."""
    transform = location.wrapped.Transformation()
    matrix = np.array([[transform.Value(row, column) for column in (1, 2, 3, 4)] for row in (1, 2, 3)])
    rotation = matrix[:, :3]
    error = float(np.max(np.abs(rotation.T @ rotation - np.eye(3))))
    if error > RIGID or np.linalg.det(rotation) < 0.0:
        raise DrawingError(
            f'part "{part}" stands in a scaled or mirrored location (scale {transform.ScaleFactor():g}); '
            "scale or mirror the solid itself, and place it with a rigid location"
        )
    return Placement(rotation, matrix[:, 3])


def quaternion(rotation: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "4"]:
    """Unit quaternion [w, x, y, z] of a rotation (Shepperd 1978); its first entry that is not zero is positive."""
    trace = float(np.trace(rotation))
    squares = np.array([trace, *np.diag(rotation)])
    largest = int(np.argmax(squares))
    skew = np.array(
        [
            rotation[2, 1] - rotation[1, 2],
            rotation[0, 2] - rotation[2, 0],
            rotation[1, 0] - rotation[0, 1],
        ]
    )
    if largest == 0:
        q = np.array([1.0 + trace, *skew])
    else:
        i = largest - 1
        q = np.array([skew[i], *(rotation[i] + rotation[:, i])])
        q[largest] = 1.0 + 2.0 * rotation[i, i] - trace
    q /= np.linalg.norm(q)
    # q and -q turn alike: one of them is chosen so that two runs write the same file.
    return q if next(entry for entry in q if abs(entry) > RIGID) > 0.0 else -q


def frame_along(axis: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """A rotation whose z is the unit vector `axis`, and whose x is the nearest coordinate axis left over."""
    x = np.zeros(3)
    x[int(np.argmin(np.abs(np.round(axis, 9))))] = 1.0
    return frame_with_x(axis, x)


def frame_with_x(axis: Float[np.ndarray, "3"], x: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """A rotation whose z is the unit vector `axis`, and whose x is `x` made perpendicular to it."""
    x = x - (x @ axis) * axis
    x = x / np.linalg.norm(x)
    return np.column_stack([x, np.cross(axis, x), axis])


def without_rounding(values: Float[np.ndarray, "n"], scale: float) -> list[float]:
    """Plain numbers, with what is below 1e-12 of `scale` written as 0: it is rounding, and differs by machine."""
    return [0.0 if abs(value) < ROUNDING * scale else float(value) for value in values]


def metres(position_mm: Float[np.ndarray, "3"]) -> list[float]:
    """A position in metres."""
    return without_rounding(position_mm * 1e-3, 1e-3)
