"""Meshes for a sample without CadQuery: a box for each body, in the units its drawing says."""

import struct
from itertools import product
from pathlib import Path

import numpy as np

from backend.mechanism.read import read_mechanism

QUADS = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
HALF_MM = (8.0, 8.0, 3.0)


def draw_meshes(sample: Path, folder: Path) -> None:
    """Write folder/meshes/*.stl: each body's joints and markers, boxed."""
    mechanism = read_mechanism(sample / "mechanism.json")
    for body in mechanism.bodies:
        points = [j.frame_a.position_m for j in mechanism.joints if j.body_a == body.id]
        points += [j.frame_b.position_m for j in mechanism.joints if j.body_b == body.id]
        points += [m.position_m for m in mechanism.markers if m.body == body.id]
        for mesh in body.meshes:
            placed = np.array(points) / mesh.scale_to_m
            path = folder / mesh.uri
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(box(placed.min(0) - HALF_MM, placed.max(0) + HALF_MM))


def box(low: np.ndarray, high: np.ndarray) -> bytes:
    """A box as binary STL."""
    corners = np.array([[(low, high)[i][k] for k, i in enumerate(ends)] for ends in product((0, 1), repeat=3)])
    facets = [corners[list(t)] for a, b, c, d in QUADS for t in ((a, b, c), (a, c, d))]
    body = b"".join(struct.pack("<12fH", 0, 0, 0, *facet.ravel(), 0) for facet in facets)
    return b"\0" * 80 + struct.pack("<I", len(facets)) + body
