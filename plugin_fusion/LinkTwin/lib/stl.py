"""Surface meshes: reading what Fusion wrote, weighing it, and writing it where its body is."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence
from pathlib import Path

from .mass import MassProperties, from_fusion
from .placement import cross, dot, length, minus

HEADER, FACET = 80, struct.Struct("<12fH")


class BadMesh(ValueError):
    """A file is not an STL mesh, or encloses nothing."""


def read(path: Path) -> list:
    """Triangles of a binary or text STL, each nine numbers in the file's own unit; BadMesh otherwise."""
    data = Path(path).read_bytes()
    if len(data) >= HEADER + 4:
        (count,) = struct.unpack_from("<I", data, HEADER)
        if len(data) == HEADER + 4 + count * FACET.size:
            return [facet[3:12] for facet in FACET.iter_unpack(data[HEADER + 4 :])]
    if data[:5].lower() != b"solid":
        raise BadMesh(f"{len(data)} bytes are neither a binary nor a text STL")
    try:
        words = data.decode("ascii", "replace").split()
        points = [tuple(map(float, words[at + 1 : at + 4])) for at, word in enumerate(words) if word == "vertex"]
    except ValueError as error:
        raise BadMesh(f"text STL with a vertex that is no number ({error})") from None
    return [a + b + c for a, b, c in zip(points[0::3], points[1::3], points[2::3])]


def write(path: Path, groups: Iterable[tuple]) -> None:
    """Write a binary STL in millimetres. groups: (triangles, centimetres per unit, X_BM of the mesh in the body)."""
    facets = []
    for triangles, scale, X_BM in groups:
        for t in triangles:
            a, b, c = (X_BM.point([scale * entry for entry in t[at : at + 3]]) for at in (0, 3, 6))
            normal = cross(minus(b, a), minus(c, a))
            size = length(normal) or 1.0
            numbers = [entry / size for entry in normal] + [10.0 * entry for point in (a, b, c) for entry in point]
            facets.append(FACET.pack(*numbers, 0))
    header = b"LinkTwin, millimetres, body axes".ljust(HEADER, b" ")
    Path(path).write_bytes(header + struct.pack("<I", len(facets)) + b"".join(facets))


def volume(triangles: Sequence[Sequence[float]]) -> float:
    """Enclosed volume, in the cube of the mesh's unit; negative where it is inside out."""
    return sum(dot(t[0:3], cross(t[3:6], t[6:9])) for t in triangles) / 6.0


def weigh(triangles: Sequence[Sequence[float]], scale: float, mass: float) -> MassProperties:
    """Mass properties of what a closed mesh encloses, filled evenly with `mass` [kg].

    scale: centimetres per unit of the mesh. Sums of tetrahedra from the origin (Mirtich 1996). BadMesh where it
    encloses nothing.
    """
    total = 0.0
    first = [0.0, 0.0, 0.0]
    squares = [0.0] * 6  # xx, yy, zz, xy, yz, xz
    for t in triangles:
        ax, ay, az, bx, by, bz, cx, cy, cz = t
        v = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
        sx, sy, sz = ax + bx + cx, ay + by + cy, az + bz + cz
        total += v
        first[0] += v * sx
        first[1] += v * sy
        first[2] += v * sz
        squares[0] += v * (ax * ax + bx * bx + cx * cx + sx * sx)
        squares[1] += v * (ay * ay + by * by + cy * cy + sy * sy)
        squares[2] += v * (az * az + bz * bz + cz * cz + sz * sz)
        squares[3] += v * (ax * ay + bx * by + cx * cy + sx * sy)
        squares[4] += v * (ay * az + by * bz + cy * cz + sy * sz)
        squares[5] += v * (ax * az + bx * bz + cx * cz + sx * sz)
    if not abs(total) > 0.0:
        raise BadMesh(f"{len(triangles)} triangles enclose no volume")
    center = [scale * entry / (4.0 * total) for entry in first]
    xx, yy, zz, xy, yz, xz = (mass * scale * scale * entry / (20.0 * total) for entry in squares)
    return from_fusion(mass, center, (yy + zz, xx + zz, xx + yy, xy, yz, xz), integrals=True)
