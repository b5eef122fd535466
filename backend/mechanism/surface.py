"""A body's surface as plain facets, in whichever kind of file it came."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import numpy as np

from backend.mechanism.body import SURFACES

MOST_FACETS = 1_000_000  # of one file; a browser takes seconds to find the edges of so many
STL = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("spare", "<u2")])


def facets(path: Path) -> np.ndarray:
    """Corners (facets, 3, 3) of an STL, OBJ, PLY or GLB, counterclockwise as seen from outside.

    The file's numbers stand as they are (`Mesh`); a GLB's nodes are placed. No other file is opened, whatever it names.
    Raises ValueError with a sentence that begins with the path.
    """
    kind = path.suffix.lower()
    if kind not in SURFACES:
        raise ValueError(f"{path} is none of {', '.join(SURFACES)}; export it as one of them")
    placed = _read(path, kind[1:])
    if (count := sum(len(corners) for _, corners in placed)) > MOST_FACETS:
        raise ValueError(f"{path} has {count} facets, above the limit of {MOST_FACETS}; export it coarser")
    if not count:
        raise ValueError(f"{path} holds no facets; export the surface, not its points or edges alone")
    found = np.concatenate([_moved(X, corners) for X, corners in placed])
    if not np.isfinite(found).all():
        raise ValueError(f"{path} has corners that are nowhere (NaN or infinite); export it again")
    if np.ptp(found, axis=(0, 1)).max() == 0.0:  # what a reader makes of a compression that it does not know
        raise ValueError(f"{path} has all its corners in one place; export it without compression (Draco, meshopt)")
    return found


def _read(path: Path, kind: str) -> list[tuple[np.ndarray, np.ndarray]]:
    """Each solid of a file: where it is (4, 4), and its corners before it is placed."""
    import trimesh

    content = BytesIO(path.read_bytes())  # without a name: nothing beside it is looked for
    try:
        scene = trimesh.load_scene(content, file_type=kind, process=False, skip_materials=True)
        solids = {id: np.asarray(it.triangles) for id, it in scene.geometry.items() if isinstance(it, trimesh.Trimesh)}
        places = [scene.graph[node] for node in scene.graph.nodes_geometry]
    except Exception as error:  # whatever a reader stumbles over in a damaged file
        remedy = "export it again, in one file and without compression (Draco, meshopt)"
        raise ValueError(f"{path} cannot be read as {kind.upper()}: damaged, or packed; {remedy}") from error
    return [(X, solids[id]) for X, id in places if id in solids]


def _moved(X: np.ndarray, corners: np.ndarray) -> np.ndarray:
    moved = corners @ X[:3, :3].T + X[:3, 3]
    return moved if np.linalg.det(X[:3, :3]) > 0 else moved[:, ::-1]  # mirrored: what was outside stays so


def write_stl(path: Path, corners: np.ndarray) -> None:
    """Facets (facets, 3, 3) as binary STL; their normals are left to whoever draws them."""
    table = np.zeros(len(corners), STL)
    table["corners"] = corners
    path.write_bytes(bytes(80) + len(corners).to_bytes(4, "little") + table.tobytes())
