"""A joint's axis as it is drawn on one part: a point and a direction, or a face or edge that has them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import cadquery as cq
import numpy as np
from jaxtyping import Float
from OCP.BRepAdaptor import BRepAdaptor_Curve, BRepAdaptor_Surface  # pyright: ignore[reportAttributeAccessIssue]
from OCP.BRepTools import BRepTools  # pyright: ignore[reportAttributeAccessIssue]

from backend.mechanism.drawing_error import DrawingError
from cad_export.assembly import CadPart
from cad_export.placement import Placement

FULL_SWEEP_RAD = np.radians(300.0)  # a hole with a keyway or a flat is still a hole
SAME_MM = 1e-6  # distances and radii that a modeller means to be equal


@dataclass(frozen=True)
class Cylinder:
    """The cylindrical face that an axis was taken from."""

    sense: Literal["pin", "hole"]
    diameter_mm: float


@dataclass(frozen=True)
class Axis:
    """A line on a part, in the part's own coordinates.

    point_mm: a point on it [mm].  direction: along it, of any length; the joint position grows about or along it.
    span_mm: how far the feature reaches before and behind the point [mm]; None when only the point is drawn.
    cylinder: the pin or hole it is the middle of, if it came from one.
    """

    point_mm: Sequence[float] | Float[np.ndarray, "3"]
    direction: Sequence[float] | Float[np.ndarray, "3"]
    span_mm: tuple[float, float] | None = None
    cylinder: Cylinder | None = None

    def __post_init__(self) -> None:
        point, direction = (np.array(v, float).reshape(-1) for v in (self.point_mm, self.direction))
        length = float(np.linalg.norm(direction))
        if point.shape != (3,) or direction.shape != (3,) or not np.all(np.isfinite([*point, *direction])):
            raise DrawingError(
                f"axis through {self.point_mm} along {self.direction}: give three finite numbers for each"
            )
        if not length > 0.0:
            raise DrawingError("axis direction has length 0; give a vector along the axis, such as (0, 0, 1)")
        object.__setattr__(self, "point_mm", point)
        object.__setattr__(self, "direction", direction / length)

    def in_frame(self, X_AB: Placement) -> Axis:
        """The same line, given in B, seen from A."""
        return Axis(
            X_AB.point(np.asarray(self.point_mm)),
            X_AB.direction(np.asarray(self.direction)),
            self.span_mm,
            self.cylinder,
        )


AxisLike = Axis | cq.Face | cq.Edge | cq.Workplane | tuple[Sequence[float], Sequence[float]]


def axis_on(part: CadPart, drawn: AxisLike) -> Axis:
    """The axis that a face, an edge, or a (point_mm, direction) pair draws on a part, in the part's coordinates.

    Cylindrical and conical faces and circles give their own axis, a plane its normal through its centre, a
    straight edge itself. But for planes, whose normal points out of the solid, a face or an edge has no
    direction of its own: the axis points where its largest coordinate is positive.
    Raises DrawingError on anything else, and on faces and edges of another shape than the part's.
    """
    if isinstance(drawn, Axis):
        return drawn
    if isinstance(drawn, tuple):
        if len(drawn) != 2:
            raise DrawingError(f'axis on "{part.path}" has {len(drawn)} entries; write (point_mm, direction)')
        return Axis(*drawn)
    if isinstance(drawn, cq.Workplane):
        if drawn.size() != 1:
            raise DrawingError(
                f'axis on "{part.path}" selects {drawn.size()} objects; narrow the selection to one face or edge'
            )
        drawn = drawn.val()  # type: ignore[assignment]  # checked below
    if isinstance(drawn, cq.Face):
        _check_belongs(part, drawn, part.shape.Faces())
        return _of_face(part, drawn)
    if isinstance(drawn, cq.Edge):
        _check_belongs(part, drawn, part.shape.Edges())
        return _of_edge(part, drawn)
    raise DrawingError(
        f'axis on "{part.path}" is a {type(drawn).__name__}; give a face, an edge, or (point_mm, direction)'
    )


def cylinder(shape: cq.Workplane | cq.Shape, through_mm: Sequence[float], diameter_mm: float | None = None) -> cq.Face:
    """The one pin or hole of a shape whose axis passes through a point, as a face to give as a joint's axis.

    through_mm: in the shape's coordinates.  diameter_mm: which one, where several are coaxial.
    Raises DrawingError listing the cylinders found when it is none, or not one.
    """
    solid = shape if isinstance(shape, cq.Shape) else cq.Compound.makeCompound(shape.vals())  # type: ignore[arg-type]
    point = np.array(through_mm, float)
    found: list[tuple[str, cq.Face]] = []
    others: list[str] = []
    for axis, drawn, face in full_cylinders(solid):
        offset_mm = float(np.linalg.norm(np.cross(axis.direction, point - axis.point_mm)))
        words = f"{drawn.sense} {drawn.diameter_mm:g} mm"
        if offset_mm < SAME_MM and (diameter_mm is None or abs(drawn.diameter_mm - diameter_mm) < SAME_MM):
            found.append((f"{words} along {np.round(axis.direction, 3) + 0.0}", face))
        else:
            others.append(f"{words}, {offset_mm:g} mm off")
    size = "" if diameter_mm is None else f" of diameter {diameter_mm:g} mm"
    if not found:
        near = "; ".join(sorted(others)[:6]) or "none"
        raise DrawingError(f"no cylinder{size} has its axis through {tuple(through_mm)} mm; there are: {near}")
    if len(found) > 1:
        raise DrawingError(
            f"{len(found)} cylinders have their axis through {tuple(through_mm)} mm "
            f"({', '.join(words for words, _ in found)}); say which with diameter_mm, or select the face itself"
        )
    return found[0][1]


def full_cylinders(solid: cq.Shape) -> Iterator[tuple[Axis, Cylinder, cq.Face]]:
    """Pins and holes, one face of each; fillets, slots and rounded ends go only part of the way round."""
    sweeps: dict[tuple[float | str, ...], float] = {}
    first: dict[tuple[float | str, ...], tuple[Axis, Cylinder, cq.Face]] = {}
    for face in solid.Faces():
        if face.geomType() != "CYLINDER" or (axis := _of_cylinder(face)).cylinder is None:
            continue
        # One cylinder may come as several faces, alike in all but their share of the turn.
        numbers = np.round([*axis.point_mm, *axis.direction, *(axis.span_mm or ()), axis.cylinder.diameter_mm], 5)
        key = (axis.cylinder.sense, *(numbers + 0.0))
        u0, u1, _, _ = BRepTools.UVBounds_s(face.wrapped)
        sweeps[key] = sweeps.get(key, 0.0) + u1 - u0
        first.setdefault(key, (axis, axis.cylinder, face))
    return (first[key] for key, sweep in sweeps.items() if sweep >= FULL_SWEEP_RAD)


def _check_belongs(part: CadPart, drawn: cq.Shape, own: Sequence[cq.Shape]) -> None:
    if not any(drawn.isSame(candidate) for candidate in own):
        raise DrawingError(
            f'the {type(drawn).__name__.lower()} given as axis on "{part.path}" is none of its {len(own)}; '
            "select it on the very shape that was added to the assembly, before it is placed"
        )


def _of_face(part: CadPart, face: cq.Face) -> Axis:
    kind = face.geomType()
    if kind == "CYLINDER":
        return _of_cylinder(face)
    if kind == "PLANE":
        center, normal = face.Center(), face.normalAt()
        return Axis(center.toTuple(), normal.toTuple())
    if kind == "CONE":
        return _along(BRepAdaptor_Surface(face.wrapped).Cone().Axis())
    raise DrawingError(
        f'axis on "{part.path}": a face of type {kind} has no axis; take a cylinder, cone or plane, '
        "or write (point_mm, direction)"
    )


def _of_edge(part: CadPart, edge: cq.Edge) -> Axis:
    kind = edge.geomType()
    if kind == "CIRCLE":
        return _along(BRepAdaptor_Curve(edge.wrapped).Circle().Axis())
    if kind == "LINE":
        start, end = (np.array(vertex.Center().toTuple()) for vertex in edge.Vertices())
        reach = 0.5 * float(np.linalg.norm(end - start))
        return Axis(0.5 * (start + end), _forward(end - start), span_mm=(-reach, reach))
    raise DrawingError(
        f'axis on "{part.path}": an edge of type {kind} has no axis; take a circle or a straight edge, '
        "or write (point_mm, direction)"
    )


def _of_cylinder(face: cq.Face) -> Axis:
    surface = BRepAdaptor_Surface(face.wrapped)
    drawn = surface.Cylinder()
    axis = drawn.Axis()
    point, along = np.array(axis.Location().Coord()), np.array(axis.Direction().Coord())
    u0, u1, v0, v1 = BRepTools.UVBounds_s(face.wrapped)
    on_face = surface.Value(0.5 * (u0 + u1), 0.5 * (v0 + v1))
    out_of_axis = np.array(on_face.Coord()) - point
    out_of_axis -= (out_of_axis @ along) * along
    normal = np.array(face.normalAt(cq.Vector(on_face.X(), on_face.Y(), on_face.Z())).toTuple())
    reach = 0.5 * (v1 - v0)
    return Axis(
        point + 0.5 * (v0 + v1) * along,
        _forward(along),
        span_mm=(-reach, reach),
        cylinder=Cylinder("hole" if normal @ out_of_axis < 0.0 else "pin", 2.0 * drawn.Radius()),
    )


def _along(line: Any) -> Axis:
    return Axis(line.Location().Coord(), _forward(np.array(line.Direction().Coord())))


def _forward(direction: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    # Boolean operations flip the axes of faces at will; a rule of our own keeps the sign of q.
    largest = int(np.argmax(np.round(np.abs(direction) / np.max(np.abs(direction)), 9)))
    return direction if direction[largest] > 0.0 else -direction
