"""Where one frame stands in another, with plain tuples: Fusion's Python has no numpy."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

Vector = tuple  # of three floats
Matrix = tuple  # of three rows

IDENTITY: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
RIGID = 1e-6  # Fusion gives directions with nine digits or more; a scaled or mirrored one is off by far more
ROUNDING = 1e-12  # what is smaller than this share of its neighbours is the rounding of sines and cosines


class NotRigid(ValueError):
    """A transform scales, shears or mirrors."""


def dot(a: Sequence[float], b: Sequence[float]) -> float:
    """a · b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Sequence[float], b: Sequence[float]) -> Vector:
    """a × b."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def plus(a: Sequence[float], b: Sequence[float], share: float = 1.0) -> Vector:
    """a + share b."""
    return (a[0] + share * b[0], a[1] + share * b[1], a[2] + share * b[2])


def minus(a: Sequence[float], b: Sequence[float]) -> Vector:
    """a - b."""
    return plus(a, b, -1.0)


def length(a: Sequence[float]) -> float:
    """|a|."""
    return math.sqrt(dot(a, a))


def unit(a: Sequence[float]) -> Vector:
    """a / |a|; ValueError for a zero or non-finite vector."""
    size = length(a)
    if not (math.isfinite(size) and size > 0.0):
        raise ValueError(f"direction {tuple(a)} has length {size:g}")
    return (a[0] / size, a[1] / size, a[2] / size)


def apply(matrix: Matrix, vector: Sequence[float]) -> Vector:
    """matrix · vector."""
    return (dot(matrix[0], vector), dot(matrix[1], vector), dot(matrix[2], vector))


def product(a: Matrix, b: Matrix) -> Matrix:
    """a · b."""
    columns = transposed(b)
    return tuple(tuple(dot(row, column) for column in columns) for row in a)


def transposed(a: Matrix) -> Matrix:
    """aᵀ."""
    return tuple(zip(*a))


@dataclass(frozen=True)
class Placement:
    """X_AB, the pose of frame B in frame A.

    rotation: R_AB as rows; its columns are B's axes in A.  position: p_AB, in A [cm, as Fusion gives it].
    """

    rotation: Matrix = IDENTITY
    position: Vector = (0.0, 0.0, 0.0)

    @classmethod
    def from_rows(cls, entries: Sequence[float]) -> Placement:
        """From the sixteen numbers of a Fusion Matrix3D, row by row; NotRigid when it scales or mirrors."""
        if len(entries) != 16:
            raise NotRigid(f"has {len(entries)} numbers, not 16")
        rows = [tuple(float(entry) for entry in entries[at : at + 4]) for at in (0, 4, 8)]
        if not all(math.isfinite(entry) for row in rows for entry in row):
            raise NotRigid("holds a number that is not finite")
        rotation = tuple(row[:3] for row in rows)
        square = product(transposed(rotation), rotation)
        error = max(abs(square[i][j] - IDENTITY[i][j]) for i in range(3) for j in range(3))
        if error > RIGID or dot(rotation[0], cross(rotation[1], rotation[2])) < 0.0:
            raise NotRigid(f"scales or mirrors (its axes are off orthonormal by {error:.3g})")
        return cls(rotation, tuple(row[3] for row in rows))

    def __matmul__(self, other: Placement) -> Placement:
        """X_AC = X_AB @ X_BC."""
        return Placement(product(self.rotation, other.rotation), self.point(other.position))

    def inverse(self) -> Placement:
        """X_BA."""
        back = transposed(self.rotation)
        return Placement(back, apply(back, (-self.position[0], -self.position[1], -self.position[2])))

    def point(self, p: Sequence[float]) -> Vector:
        """Coordinates in A of a point given in B."""
        return plus(apply(self.rotation, p), self.position)

    def direction(self, d: Sequence[float]) -> Vector:
        """Coordinates in A of a direction given in B."""
        return apply(self.rotation, d)

    def json(self) -> dict:
        """The pose as mechanism.json writes it: metres and a unit quaternion [w, x, y, z]."""
        return {
            "position_m": metres(self.position),
            "quaternion_wxyz": without_rounding(quaternion(self.rotation), 1.0),
        }


def quaternion(rotation: Matrix) -> Sequence[float]:
    """Unit quaternion [w, x, y, z] of a rotation (Shepperd 1978); its first entry that is not zero is positive."""
    (a, b, c), (d, e, f), (g, h, i) = rotation
    trace = a + e + i
    largest = max((trace, 0), (a, 1), (e, 2), (i, 3))[1]
    q = (
        (1 + trace, h - f, c - g, d - b),
        (h - f, 1 + a - e - i, b + d, c + g),
        (c - g, b + d, 1 - a + e - i, f + h),
        (d - b, c + g, f + h, 1 - a - e + i),
    )[largest]
    norm = math.sqrt(sum(entry * entry for entry in q))
    # q and -q turn alike: one of them is chosen so that two exports write the same file.
    sign = math.copysign(norm, next(entry for entry in q if abs(entry) > 1e-9 * norm))
    return [entry / sign for entry in q]


def frame_along(axis: Sequence[float]) -> Matrix:
    """A rotation whose z is the unit vector `axis`, and whose x is the nearest coordinate axis left over."""
    sizes = [abs(round(entry, 9)) for entry in axis]
    start = IDENTITY[sizes.index(min(sizes))]
    x = unit(plus(start, axis, -dot(start, axis)))
    return transposed((x, cross(axis, x), tuple(axis)))


def about_z(angle: float) -> Matrix:
    """Turn by an angle about z [rad]."""
    c, s = math.cos(angle), math.sin(angle)
    return ((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0))


def metres(position_cm: Sequence[float]) -> list:
    """A position in metres."""
    return without_rounding([entry * 1e-2 for entry in position_cm], 1e-3)


def without_rounding(values: Sequence[float], scale: float) -> list:
    """The numbers, with what is below 1e-12 of `scale` written as 0."""
    return [0.0 if abs(value) < ROUNDING * scale else float(value) for value in values]
