"""Mass properties: from the numbers that Fusion gives to those of a rigid body."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from .placement import Matrix, Placement, Vector, metres, minus, product, transposed

KG_CM2 = 1e-4  # kg m²


@dataclass(frozen=True)
class MassProperties:
    """Of a rigid piece, in some frame F.

    mass [kg]; center: p_FC, centre of mass in F [cm]; inertia: rows of the tensor about the centre of mass, in
    F's axes; products are tensor entries, xy = -∫ x y dm [kg cm²].
    """

    mass: float
    center: Vector
    inertia: Matrix

    def in_frame(self, X_GF: Placement) -> MassProperties:
        """The same piece seen from a frame G."""
        R = X_GF.rotation
        return MassProperties(self.mass, X_GF.point(self.center), product(product(R, self.inertia), transposed(R)))

    def json(self) -> dict:
        """The `inertial` block of mechanism.json; nothing is rounded but products that are zero by symmetry."""
        I = self.inertia
        floor = 1e-12 * (I[0][0] + I[1][1] + I[2][2])
        entries = {"xx": I[0][0], "yy": I[1][1], "zz": I[2][2], "xy": I[0][1], "xz": I[0][2], "yz": I[1][2]}
        return {
            "mass_kg": self.mass,
            "center_of_mass_m": metres(self.center),
            "inertia_kg_m2": {name: 0.0 if abs(value) < floor else value * KG_CM2 for name, value in entries.items()},
        }


def from_fusion(mass: float, center: Sequence[float], moments: Sequence[float], integrals: bool) -> MassProperties:
    """From getXYZMomentsOfInertia: xx, yy, zz, xy, yz, xz about the origin, in the axes of the same frame.

    integrals: whether the products come as +∫ x y dm, and not as the tensor's entries.
    """
    xx, yy, zz, xy, yz, xz = (float(moment) for moment in moments)
    if integrals:
        xy, yz, xz = -xy, -yz, -xz
    about_origin = ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))
    shift = point_mass(mass, center)
    inertia = tuple(minus(row, away) for row, away in zip(about_origin, shift))
    return MassProperties(float(mass), tuple(float(entry) for entry in center), inertia)


def point_mass(mass: float, at: Sequence[float]) -> Matrix:
    """Inertia about the origin of a mass at a point: what the parallel axis theorem adds."""
    x, y, z = at
    return (
        (mass * (y * y + z * z), -mass * x * y, -mass * x * z),
        (-mass * x * y, mass * (x * x + z * z), -mass * y * z),
        (-mass * x * z, -mass * y * z, mass * (x * x + y * y)),
    )


def combined(pieces: Sequence[MassProperties]) -> MassProperties:
    """The pieces as one rigid body, all in the same frame (parallel axis theorem)."""
    mass = math.fsum(piece.mass for piece in pieces)
    center = tuple(math.fsum(piece.mass * piece.center[axis] for piece in pieces) / mass for axis in range(3))
    shifts = [point_mass(piece.mass, minus(piece.center, center)) for piece in pieces]
    inertia = tuple(
        tuple(
            math.fsum(piece.inertia[row][column] + shift[row][column] for piece, shift in zip(pieces, shifts))
            for column in range(3)
        )
        for row in range(3)
    )
    return MassProperties(mass, center, inertia)


def is_possible(inertia: Matrix, mass: float, size: float) -> bool:
    """Whether some matter within `size` [cm] could have it: positive definite, and the triangle inequality.

    The second moments S = ½ tr(I) 1 - I of real matter are positive semidefinite, which says both.
    """
    half = 0.5 * (inertia[0][0] + inertia[1][1] + inertia[2][2])
    S = [[(half if i == j else 0.0) - inertia[i][j] for j in range(3)] for i in range(3)]
    slack = 1e-9 * max(mass * size * size, 1e-300)
    minors = [S[0][0], S[1][1], S[2][2]]
    pairs = [S[i][i] * S[j][j] - S[i][j] * S[i][j] for i, j in ((0, 1), (0, 2), (1, 2))]
    whole = (
        S[0][0] * (S[1][1] * S[2][2] - S[1][2] * S[2][1])
        - S[0][1] * (S[1][0] * S[2][2] - S[1][2] * S[2][0])
        + S[0][2] * (S[1][0] * S[2][1] - S[1][1] * S[2][0])
    )
    return (
        all(entry > -slack for entry in minors)
        and all(entry > -slack * half for entry in pairs)
        and whole > -slack * half * half
    )
