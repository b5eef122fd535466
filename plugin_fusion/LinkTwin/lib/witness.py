"""What Fusion's documentation leaves open, settled by evidence: each solid's mesh is weighed against its numbers.

The mesh tells the unit it was written in (by its volume), whether mesh and mass properties stand in the component's
frame or in the world's (by the centre of mass), and whether products of inertia come as +∫ x y dm or as entries of
the tensor (by the inertia, over all solids together: it is one convention).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from .mass import MassProperties, from_fusion, is_possible
from .placement import Placement, length, minus
from .stl import BadMesh, volume, weigh

CM_PER_UNIT = {"millimetre": 0.1, "centimetre": 1.0, "metre": 100.0, "inch": 2.54, "foot": 30.48}
SAME_SCALE = 0.05  # a coarse mesh of a round part loses up to a tenth of its volume, a thirtieth of its size
SAME_PLACE = 0.02  # of the size: the centre of a coarse mesh is off by less
EVEN = 1e-3  # of the size: differences below it decide nothing
ALIKE = 0.1  # of the trace: what a coarse mesh may be off in inertia


@dataclass(frozen=True)
class Piece:
    """A solid of a component: mass properties in the component's frame C, and its mesh where there is a usable one.

    scale: centimetres per unit of the mesh.  X_CM: of the mesh's frame in C.
    """

    label: str
    properties: MassProperties
    box: tuple
    triangles: Sequence = ()
    scale: float = 1.0
    X_CM: Placement = field(default_factory=Placement)


@dataclass(frozen=True)
class Settled:
    """The solids by component, how they were read, and what there is to say about it."""

    pieces: Mapping[str, Sequence[Piece]]
    readings: Mapping[str, str]
    warnings: Sequence[str]


@dataclass
class _Solid:
    component: str
    body: Mapping
    label: str
    triangles: Sequence = ()
    scale: float = 1.0
    X_CM: Placement = field(default_factory=Placement)
    X_CP: Placement = field(default_factory=Placement)  # of the frame that Fusion's mass properties are in
    seen: MassProperties | None = None  # the mesh's, in C


def settle(
    components: Mapping[str, Mapping], first_place: Mapping[str, Placement], mesh_of: Callable[[str], Sequence]
) -> Settled:
    """Read the solids of all components.

    components: of a snapshot; only visible solids with mass count.  first_place: X_WC of one occurrence of each.
    mesh_of: triangles of a mesh by its name in the snapshot; BadMesh or OSError where it cannot be had.
    """
    warnings: list[str] = []
    solids = [
        _solid(id, component, body, first_place.get(id, Placement()), mesh_of, warnings)
        for id, component in components.items()
        for body in component["bodies"]
        if counts(body)
    ]
    integrals = _products_are_integrals(solids)
    pieces: dict[str, list[Piece]] = {id: [] for id in components}
    for solid in solids:
        properties = _properties(solid, integrals)
        if solid.seen and (off := _distance(properties, solid.seen)) > ALIKE:
            warnings.append(
                f"{solid.label}: Fusion's inertia and that of its mesh differ by {100 * off:.0f}% of the trace; "
                "the former is used: check the part's material and that its mesh is closed"
            )
        box = tuple(tuple(corner) for corner in solid.body.get("box_cm") or ())
        pieces[solid.component].append(Piece(solid.label, properties, box, solid.triangles, solid.scale, solid.X_CM))
    witnessed = sum(solid.seen is not None for solid in solids)
    readings = {
        "products_of_inertia": "integrals" if integrals else "tensor entries",
        "products_settled_by": f"{witnessed} of {len(solids)} meshes" if witnessed else "default: no mesh to compare",
    }
    return Settled(pieces, readings, warnings)


def counts(body: Mapping) -> bool:
    """Whether a body of a snapshot has mass in the export: a solid, shown, weighing something."""
    return bool(body.get("solid") and body.get("visible") and (body.get("mass_kg") or 0.0) > 0.0)


def _solid(
    id: str,
    component: Mapping,
    body: Mapping,
    X_WC: Placement,
    mesh_of: Callable[[str], Sequence],
    warnings: list[str],
) -> _Solid:
    solid = _Solid(id, body, f'component "{component["name"]}", body "{body["name"]}"')
    try:
        if not body.get("mesh"):
            raise BadMesh(body.get("mesh_error") or "Fusion wrote none")
        triangles = mesh_of(body["mesh"])
        scale = _scale(triangles, float(body["volume_cm3"]))
        seen = weigh(triangles, scale, float(body["mass_kg"]))
    except (BadMesh, OSError) as error:
        warnings.append(f"{solid.label}: has no mesh to show or to check by ({error}); export it again")
        return solid
    solid.triangles, solid.scale = triangles, scale
    there = X_WC.inverse()
    center, size = body["center_cm"], _size(body)
    apart = {
        "component": length(minus(center, seen.center)),
        "mesh in world": length(minus(X_WC.point(center), seen.center)),
        "properties in world": length(minus(center, X_WC.point(seen.center))),
    }
    best = min(apart, key=lambda reading: apart[reading])
    if apart["component"] <= apart[best] + EVEN * size:
        best = "component"
    if apart[best] > SAME_PLACE * size:
        warnings.append(
            f"{solid.label}: Fusion's centre of mass and that of its mesh are {10 * apart['component']:.3g} mm apart; "
            "both are taken to be in the component's frame: check the mesh in the page, and the part's material"
        )
        return solid
    solid.X_CM = there if best == "mesh in world" else Placement()
    solid.X_CP = there if best == "properties in world" else Placement()
    solid.seen = seen.in_frame(solid.X_CM)
    return solid


def _scale(triangles: Sequence, volume_cm3: float) -> float:
    """Centimetres per unit of the mesh, from the volume that Fusion states for the solid."""
    enclosed = abs(volume(triangles))
    if not (enclosed > 0.0 and volume_cm3 > 0.0):
        raise BadMesh(f"it encloses {enclosed:g} cubic units, the solid {volume_cm3:g} cm³")
    measured = (volume_cm3 / enclosed) ** (1.0 / 3.0)
    scale = min(CM_PER_UNIT.values(), key=lambda known: abs(known / measured - 1.0))
    if abs(scale / measured - 1.0) > SAME_SCALE:
        raise BadMesh(
            f"it encloses {enclosed:.4g} cubic units and the solid {volume_cm3:.4g} cm³, "
            f"which is no scale in {', '.join(CM_PER_UNIT)}"
        )
    return scale


def _size(body: Mapping) -> float:
    box = body.get("box_cm")
    return length(minus(box[1], box[0])) if box else 3.0 * float(body["volume_cm3"]) ** (1.0 / 3.0)


def _products_are_integrals(solids: Sequence[_Solid]) -> bool:
    """Whether reading products as +∫ x y dm agrees better with the meshes; without them, with what matter allows."""
    witnesses = [solid for solid in solids if solid.seen]
    misfit = {
        integrals: sum(_distance(_properties(solid, integrals), solid.seen) ** 2 for solid in witnesses if solid.seen)
        for integrals in (False, True)
    }
    impossible = {
        integrals: sum(
            not is_possible(_properties(solid, integrals).inertia, solid.body["mass_kg"], _size(solid.body))
            for solid in solids
        )
        for integrals in (False, True)
    }
    if abs(misfit[True] - misfit[False]) > 1e-9:  # symmetric parts have no products, and tell nothing
        return misfit[True] < misfit[False]
    return impossible[True] < impossible[False]


def _properties(solid: _Solid, integrals: bool) -> MassProperties:
    body = solid.body
    return from_fusion(body["mass_kg"], body["center_cm"], body["moments_kg_cm2"], integrals).in_frame(solid.X_CP)


def _distance(a: MassProperties, b: MassProperties) -> float:
    """Largest difference of inertia, in parts of the trace."""
    trace = max(abs(b.inertia[0][0] + b.inertia[1][1] + b.inertia[2][2]), 1e-300)
    return max(abs(a.inertia[i][j] - b.inertia[i][j]) for i in range(3) for j in range(3)) / trace
