"""The parts of a CadQuery assembly: their names, solids, absolute places and densities."""

from __future__ import annotations

import re
from collections.abc import Hashable, Iterator
from dataclasses import dataclass

import cadquery as cq

from backend.mechanism.drawing_error import DrawingError, known
from cad_export.placement import Placement, placement_of

GENERATED_NAME = re.compile(r"[0-9a-f]{8}-([0-9a-f]{4}-){3}[0-9a-f]{12}")  # what CadQuery calls the unnamed
KG_PER_M3 = {"g/cm^3": 1e3, "g/cm3": 1e3, "kg/m^3": 1.0, "kg/m3": 1.0, "g/mm^3": 1e6, "kg/mm^3": 1e9}


@dataclass(frozen=True)
class CadPart:
    """One occurrence of a shape in an assembly.

    path: names from the root down, without the root's own: "sub/coupler".
    shape: in the part's own coordinates, which are the frame P of the part [mm].
    solid_key: equal for occurrences of one and the same shape.
    X_WP: absolute pose of the part's frame.
    material: name of the nearest material up the tree, and its density [kg/m³]; None where there is none.
    """

    path: str
    shape: cq.Shape
    solid_key: Hashable
    X_WP: Placement
    material: tuple[str, float] | None


def parts_of(assembly: cq.Assembly) -> dict[str, CadPart]:
    """All parts by path; DrawingError on unnamed parts, repeated paths and rigid locations that are none."""
    found: dict[str, CadPart] = {}
    for path, node, location, material in _walk(assembly, (), cq.Location(), None):
        if node.obj is None:
            continue
        if path in found:
            raise DrawingError(f'part "{path}" stands twice in the assembly; give each occurrence its own name')
        shape, key = _shape(node, path)
        found[path] = CadPart(path, shape, key, placement_of(location, path), _density(material, path))
    if not found:
        raise DrawingError(f'assembly "{assembly.name}" holds 0 parts; add solids to it before drawing its joints')
    return found


def find_part(parts: dict[str, CadPart], name: str) -> CadPart:
    """The part of that path, or the only one whose last name it is; DrawingError listing the known ones."""
    if name in parts:
        return parts[name]
    ends = [path for path in parts if path.rsplit("/", 1)[-1] == name]
    if len(ends) == 1:
        return parts[ends[0]]
    if ends:
        raise DrawingError(f'"{name}" names {len(ends)} parts; write the whole path. {known(ends)}')
    raise DrawingError(f'there is no part "{name}" in the assembly. {known(parts)}')


def _walk(
    node: cq.Assembly, names: tuple[str, ...], location: cq.Location, material: cq.Material | None
) -> Iterator[tuple[str, cq.Assembly, cq.Location, cq.Material | None]]:
    # Not `for ... in assembly`: that hands out a new compound each time, and drops materials.
    path = "/".join(names) or node.name
    location = location * node.loc
    material = node.material or material
    yield path, node, location, material
    for child in node.children:
        if GENERATED_NAME.fullmatch(child.name):
            raise DrawingError(
                f'a part of "{path}" has no name (CadQuery made up {child.name}, another in each run); '
                'name it: assembly.add(solid, name="crank")'
            )
        yield from _walk(child, (*names, child.name), location, material)


def _shape(node: cq.Assembly, path: str) -> tuple[cq.Shape, Hashable]:
    if isinstance(node.obj, cq.Shape):
        return node.obj, node.obj
    shapes = [value for value in getattr(node.obj, "vals", list)() if isinstance(value, cq.Shape)]
    if not shapes:
        raise DrawingError(f'part "{path}" holds no shape (0 solids on its workplane); add a solid')
    return (shapes[0] if len(shapes) == 1 else cq.Compound.makeCompound(shapes)), tuple(shapes)


def _density(material: cq.Material | None, path: str) -> tuple[str, float] | None:
    if material is None:
        return None
    unit = material.densityUnit
    if unit not in KG_PER_M3:
        raise DrawingError(
            f'part "{path}": material "{material.name}" has density {material.density:g} in the unknown unit '
            f'"{unit}". {known(KG_PER_M3)}'
        )
    return material.name, material.density * KG_PER_M3[unit]
