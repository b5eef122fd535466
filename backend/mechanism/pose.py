"""Where a frame stands: the position of its origin and the rotation of its axes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated

import numpy as np
from pydantic import AfterValidator, Field

from backend.mechanism.part import Part, Vector3

NORM_TOLERANCE = (
    1e-3  # a quaternion typed with three digits is off by less; one in another order, or of angles, by more
)
ROUNDING = 1e-12  # below this a quaternion is kept as written, so that reading and writing is the identity


def _unit(quaternion: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    norm = math.hypot(*quaternion)
    if abs(norm - 1.0) > NORM_TOLERANCE:
        raise ValueError(
            f"has norm {norm:.9g}, not 1; a rotation is a unit quaternion [w, x, y, z]: divide all four by the norm"
        )
    if abs(norm - 1.0) <= ROUNDING:
        return quaternion
    w, x, y, z = (component / norm for component in quaternion)
    return w, x, y, z


Quaternion = Annotated[
    tuple[float, float, float, float],
    Field(strict=False, description="unit quaternion [w, x, y, z], rotates frame coordinates into the parent's"),
    AfterValidator(_unit),
]


class Pose(Part):
    """Pose of a frame in its parent: X_WB for a body in the world, X_BF for a joint frame in its body.

    position_m: origin of the frame, in the parent's axes [m].
    quaternion_wxyz: rotates coordinates of the frame into coordinates of the parent.
    """

    position_m: Vector3 = (0.0, 0.0, 0.0)
    quaternion_wxyz: Quaternion = (1.0, 0.0, 0.0, 0.0)

    def rotation(self) -> np.ndarray:
        """The (3, 3) matrix whose columns are the frame's axes, in the parent's coordinates."""
        w, x, y, z = self.quaternion_wxyz
        return np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )

    def place(self, point: Sequence[float] | np.ndarray) -> np.ndarray:
        """A point of the frame (3,), in the parent's coordinates."""
        return np.array(self.position_m) + self.rotation() @ np.array(point)


class Frame(Pose):
    """A joint's frame, drawn in a body: its z is the joint's axis."""
