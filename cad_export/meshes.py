"""Surface meshes of bodies: one STL file for each distinct shape, in millimetres, in body axes."""

from __future__ import annotations

import re
from collections.abc import Hashable
from pathlib import Path
from typing import Any

from backend.mechanism.drawing_error import DrawingError
from cad_export.assembly import CadPart
from cad_export.placement import Placement

TOLERANCE_MM, TOLERANCE_RAD = 0.1, 0.1  # the mesh's inertia is then within 1e-3 of the exact boundary's
SCALE_TO_M = 1e-3


class Meshes:
    """The meshes that a mechanism refers to; written only when asked."""

    def __init__(self) -> None:
        self._files: dict[Hashable, tuple[str, CadPart, Placement]] = {}

    def of(self, part: CadPart, X_BP: Placement) -> dict[str, Any]:
        """The `meshes` entry of a part in its body; occurrences of one shape share a file."""
        key = (part.solid_key, X_BP.rotation.tobytes(), X_BP.position_mm.tobytes())
        if key not in self._files:
            self._files[key] = (self._free_name(part.path), part, X_BP)
        return {"uri": f"meshes/{self._files[key][0]}", "scale_to_m": SCALE_TO_M}

    def write(self, folder: Path) -> None:
        """Write the STL files under folder/meshes."""
        (folder / "meshes").mkdir(exist_ok=True)
        for name, part, X_BP in self._files.values():
            shape = part.shape.moved(X_BP.location())
            path = folder / "meshes" / name
            if not shape.exportStl(str(path), TOLERANCE_MM, TOLERANCE_RAD, relative=False, parallel=False):
                raise DrawingError(f'part "{part.path}": mesh {path} could not be written; check folder and disk')

    def _free_name(self, path: str) -> str:
        """A file name that every system takes; other letters become _, and repeats are numbered."""
        stem = re.sub(r"[^A-Za-z0-9._-]+", "_", path).strip("._") or "part"
        taken = {name.lower() for name, _, _ in self._files.values()}
        names = [f"{stem}.stl", *(f"{stem}-{n}.stl" for n in range(2, len(taken) + 3))]
        return next(name for name in names if name.lower() not in taken)
