"""Declare joints, springs, markers and materials on a CadQuery assembly, and write it as a mechanism."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cadquery as cq
import numpy as np

from backend.mechanism.drawing_error import DrawingError, known
from backend.mechanism.kinds import effect_kinds
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.read import parse_mechanism, write_mechanism
from cad_export.assembly import GENERATED_NAME, CadPart, find_part, parts_of
from cad_export.axis import AxisLike, axis_on
from cad_export.joints import DrawnJoint, joint_between, weld
from cad_export.mass import MassProperties, check_density, combined, mass_properties, overlap_fault
from cad_export.meshes import Meshes
from cad_export.placement import Placement, metres
from cad_export.proposal import Proposal, proposals
from cad_export.provenance import provenance
from cad_export.step import ALWAYS_LOST, read_step

STEEL_KG_PER_M3 = 7850.0  # what cq.Material assumes when it is given a name alone
STANDARD_GRAVITY = (0.0, 0.0, -9.80665)


class Drawing:
    """A mechanism being declared on a finished `cq.Assembly`: every part of it becomes a body.

    Lengths are the model's millimetres (`*_mm`), all else is SI. Points, faces and edges are in the coordinates
    of the part they are given for, before it was placed; the part's frame becomes the body's. Parts are named by
    their path ("sub/coupler"), or by its end where that is unique. Every method raises DrawingError naming the
    part, the number and the remedy.

    >>> drawing = Drawing(assembly, name="pendulum")
    >>> drawing.ground("frame")
    >>> drawing.material(density_kg_per_m3=2700)
    >>> drawing.revolute("pivot", "frame", "bar", axis=frame_pin, axis_b=bar_hole)
    >>> drawing.write("out")
    """

    def __init__(
        self,
        assembly: cq.Assembly,
        name: str | None = None,
        gravity_m_per_s2: Sequence[float] = STANDARD_GRAVITY,
    ):
        """name: of the mechanism, by default the assembly's.  gravity_m_per_s2: in the world's axes."""
        if not isinstance(assembly, cq.Assembly):
            raise DrawingError(f"a Drawing is made on a cq.Assembly, not on a {type(assembly).__name__}; add it to one")
        given = "mechanism" if GENERATED_NAME.fullmatch(assembly.name) else assembly.name
        self.name = name or given
        self.parts = parts_of(assembly)
        self.lost: tuple[str, ...] = ()  # what a STEP file did not bring along
        self._gravity = _three("gravity_m_per_s2", gravity_m_per_s2).tolist()
        self._grounded: set[str] = set()
        self._leader = {path: path for path in self.parts}  # of the rigid body that a part belongs to
        self._densities: dict[str, float] = {}
        self._other_density: float | None = None
        self._joints: list[dict[str, Any]] = []
        self._warnings: list[str] = []
        self._effects: list[dict[str, Any]] = []
        self._markers: list[tuple[str, CadPart, np.ndarray]] = []
        self._masses: dict[Any, MassProperties] = {}

    @classmethod
    def from_step(
        cls, path: str | Path, name: str | None = None, gravity_m_per_s2: Sequence[float] = STANDARD_GRAVITY
    ) -> Drawing:
        """A drawing on the parts of a STEP file; what the file lost stands among the mechanism's warnings."""
        read = read_step(path)
        drawing = cls(read.assembly, name, gravity_m_per_s2)
        drawing.lost = read.lost
        return drawing

    def ground(self, *parts: str) -> None:
        """These parts stand still in the world."""
        self._grounded |= {self._part(name).path for name in parts}

    def rigid(self, *parts: str) -> None:
        """These parts are one body, in the frame of the first; they must not share volume."""
        if self._joints or self._markers or self._effects:
            raise DrawingError(f"rigid({', '.join(parts)}) comes after a joint, marker or effect; call it before them")
        if len(parts) < 2:
            raise DrawingError(f"rigid({', '.join(parts)}) names {len(parts)} parts; name two or more")
        members = [self._part(name).path for name in parts]
        leader = self._leader[members[0]]
        joined = {self._leader[member] for member in members}
        self._leader = {path: leader if its in joined else its for path, its in self._leader.items()}

    def material(self, *parts: str, density_kg_per_m3: float) -> None:
        """Density of these parts, or of all that have no other; it wins over the assembly's own material."""
        for name in parts:
            check_density(density_kg_per_m3, name)
            self._densities[self._part(name).path] = float(density_kg_per_m3)
        if not parts:
            check_density(density_kg_per_m3, "every other")
            self._other_density = float(density_kg_per_m3)

    def revolute(
        self,
        id: str,
        part_a: str,
        part_b: str,
        axis: AxisLike,
        axis_b: AxisLike | None = None,
        *,
        drawn_at_deg: float = 0.0,
        limits_deg: tuple[float | None, float | None] | None = None,
    ) -> None:
        """part_b turns on part_a about an axis.

        axis: on part_a, a face, an edge, an Axis or (point_mm, direction).  axis_b: the same line as drawn on
        part_b; the two are then checked to meet, and a pin and hole face give the joint its fit.
        drawn_at_deg: q in the drawn pose; q grows right-handed about the axis of part_a.
        """
        if not np.isfinite(drawn_at_deg):
            raise DrawingError(f'joint "{id}": drawn_at_deg is {drawn_at_deg}; give a finite number')
        joint = self._between(id, False, part_a, part_b, axis, axis_b, float(np.radians(drawn_at_deg)))
        self._add_joint(id, "revolute", part_a, part_b, joint, limits_deg, np.pi / 180.0)

    def prismatic(
        self,
        id: str,
        part_a: str,
        part_b: str,
        axis: AxisLike,
        axis_b: AxisLike | None = None,
        *,
        limits_mm: tuple[float | None, float | None] | None = None,
    ) -> None:
        """part_b slides on part_a along an axis; q is the way from the point of axis to that of axis_b."""
        joint = self._between(id, True, part_a, part_b, axis, axis_b)
        self._add_joint(id, "prismatic", part_a, part_b, joint, limits_mm, 1e-3)

    def fixed(self, id: str, part_a: str, part_b: str) -> None:
        """part_b is welded to part_a as it stands: a joint with reactions, where `rigid` makes one body."""
        a, b = self._part(part_a), self._part(part_b)
        self._add_joint(id, "fixed", part_a, part_b, weld(a.X_WP, b.X_WP), None, 1.0)

    def propose(self) -> list[Proposal]:
        """Joints that pins in holes suggest, with their play; what is declared already is marked, and wins."""
        declared = {
            frozenset((joint["body_a"], joint["body_b"])): (joint["id"], joint["type"]) for joint in self._joints
        }
        return proposals(self.parts, self._leader, declared)

    def confirm(self, proposed: str, id: str | None = None, *, drawn_at_deg: float = 0.0) -> None:
        """Declare a proposed joint, under a name of its own if one is given.

        drawn_at_deg: q of a revolute joint in the drawn pose. To override a proposal, declare the joint instead.
        """
        found = {one.id: one for one in self.propose()}
        if proposed not in found:
            raise DrawingError(f'joint "{proposed}" is not among the {len(found)} proposed. {known(found)}')
        one = found[proposed]
        if one.declared:
            raise DrawingError(
                f'joint "{proposed}" is drawn already, as {one.declared[1]} "{one.declared[0]}"; leave out one of both'
            )
        match one.type:
            case "revolute":
                self.revolute(id or proposed, one.part_a, one.part_b, one.axis_a, one.axis_b, drawn_at_deg=drawn_at_deg)
            case "prismatic":
                self.prismatic(id or proposed, one.part_a, one.part_b, one.axis_a)  # q is 0 as drawn
            case "fixed":
                self.fixed(id or proposed, one.part_a, one.part_b)

    def confirm_all(self) -> None:
        """Declare every proposed joint that nothing declared stands in the place of."""
        for one in self.propose():
            if not one.declared:
                self.confirm(one.id)

    def marker(self, id: str, part: str, point_mm: Sequence[float]) -> None:
        """A point of a part that a camera can follow."""
        self._markers.append((id, self._part(part), _point(id, point_mm)))

    def extension_spring(
        self,
        id: str,
        part_a: str,
        part_b: str,
        *,
        anchor_a_mm: Sequence[float],
        anchor_b_mm: Sequence[float],
        stiffness_n_per_m: float,
        free_length_mm: float | None = None,
        damping_n_s_per_m: float = 0.0,
    ) -> None:
        """A straight spring between a point of each part; by default it is free of force as drawn."""
        a, b = self._part(part_a), self._part(part_b)
        start, end = _point(id, anchor_a_mm), _point(id, anchor_b_mm)
        if free_length_mm is None:
            free_length_mm = float(np.linalg.norm(b.X_WP.point(end) - a.X_WP.point(start)))
        self._add_effect(
            id,
            "extension_spring",
            [self._leader[a.path], self._leader[b.path]],
            {
                "anchor_a_m": metres(self._in_body(a).point(start)),
                "anchor_b_m": metres(self._in_body(b).point(end)),
                "stiffness_n_per_m": float(stiffness_n_per_m),
                "free_length_m": float(free_length_mm) * 1e-3,
                "damping_n_s_per_m": float(damping_n_s_per_m),
            },
        )

    def torsion_spring(self, id: str, joint: str, *, stiffness_n_m_per_rad: float, rest_deg: float = 0.0) -> None:
        """A spring about a revolute joint, at rest where q is rest_deg."""
        self._add_effect(
            id,
            "torsion_spring",
            [joint],
            {"stiffness_n_m_per_rad": float(stiffness_n_m_per_rad), "rest_rad": float(np.radians(rest_deg))},
        )

    def effect(
        self, kind: str, on: str | Sequence[str], *, id: str | None = None, **parameters: float | Sequence[float]
    ) -> None:
        """Any other effect of the drawing, with parameters in SI as mechanism.json names them.

        on: names of parts or joints, "world", "camera", or "all" that the kind acts on.
        """
        if kind not in effect_kinds():
            raise DrawingError(f'effect kind "{kind}" is unknown. {known(effect_kinds())}')
        places: Any = on if on == "all" else [on] if isinstance(on, str) else list(on)
        if effect_kinds()[kind].acts_on in ("body", "bodies") and places != "all":
            places = [self._leader[self._part(name).path] for name in places]
        values = {
            name: value if isinstance(value, str) else np.asarray(value, float).tolist()
            for name, value in parameters.items()
        }
        taken = {effect["id"] for effect in self._effects}
        free = (name for n in range(1, len(taken) + 2) if (name := f"{kind}_{n}") not in taken)
        self._add_effect(id or next(free), kind, places, values)

    def mechanism(self) -> Mechanism:
        """The mechanism as declared so far, checked against the file format; meshes are named, not written."""
        return self._mechanism(Meshes())

    def write(self, out_dir: str | Path) -> Path:
        """Write OUT_DIR/mechanism.json and OUT_DIR/meshes/*.stl; the path of the former."""
        meshes = Meshes()
        mechanism = self._mechanism(meshes)
        folder = Path(out_dir)
        folder.mkdir(parents=True, exist_ok=True)
        meshes.write(folder)
        path = folder / "mechanism.json"
        write_mechanism(mechanism, path)
        return path

    def _part(self, name: str) -> CadPart:
        return find_part(self.parts, name)

    def _in_body(self, part: CadPart) -> Placement:
        """X_BP: the part's frame in its body's, exactly the identity for a body of one part."""
        leader = self.parts[self._leader[part.path]]
        return Placement() if leader is part else leader.X_WP.inverse() @ part.X_WP

    def _between(
        self,
        id: str,
        slides: bool,
        part_a: str,
        part_b: str,
        axis: AxisLike,
        axis_b: AxisLike | None,
        drawn_at: float = 0.0,
    ) -> DrawnJoint:
        a, b = self._part(part_a), self._part(part_b)
        on_b = None if axis_b is None else axis_on(b, axis_b)
        return joint_between(id, slides, a.X_WP, axis_on(a, axis), b.X_WP, on_b, drawn_at)

    def _add_joint(
        self,
        id: str,
        type: str,
        part_a: str,
        part_b: str,
        joint: DrawnJoint,
        limits: tuple[float | None, float | None] | None,
        unit: float,
    ) -> None:
        a, b = self._part(part_a), self._part(part_b)
        if self._leader[a.path] == self._leader[b.path]:
            raise DrawingError(
                f'joint "{id}": "{a.path}" and "{b.path}" are 1 body; a joint needs 2: leave one out of rigid(...)'
            )
        self._warnings += [joint.warning] if joint.warning else []
        entry: dict[str, Any] = {
            "id": id,
            "type": type,
            "body_a": self._leader[a.path],
            "body_b": self._leader[b.path],
            "frame_a": (self._in_body(a) @ joint.X_AF).json(),
            "frame_b": (self._in_body(b) @ joint.X_BG).json(),
        }
        if limits is not None:
            if (count := np.array(limits, dtype=object).size) != 2:
                raise DrawingError(f'joint "{id}": {count} limits; write (lower, upper), None for an open side')
            sides = zip(("lower", "upper"), limits, strict=True)
            entry["limits"] = {side: float(value) * unit for side, value in sides if value is not None}
        if joint.fit:
            entry["fit"] = joint.fit.json()
        self._joints.append(entry)

    def _add_effect(self, id: str, kind: str, on: Any, parameters: dict[str, Any]) -> None:
        self._effects.append({"id": id, "kind": kind, "on": on, "parameters": parameters})

    def _mechanism(self, meshes: Meshes) -> Mechanism:
        if not self._grounded:
            raise DrawingError(f"0 parts are grounded; call ground(...) with what stands still. {known(self.parts)}")
        document = {
            "schema_version": "1.0",
            "name": self.name,
            "gravity_m_per_s2": self._gravity,
            "provenance": provenance([*self._losses(), *self._warnings, *self._material_warnings()]),
            "bodies": [self._body(path, meshes) for path in self.parts if self._leader[path] == path],
            "joints": self._joints,
            "effects": self._effects,
            "markers": [
                {"id": id, "body": self._leader[part.path], "position_m": metres(self._in_body(part).point(point))}
                for id, part, point in self._markers
            ],
        }
        return parse_mechanism(document, source=self.name)

    def _body(self, path: str, meshes: Meshes) -> dict[str, Any]:
        members = [part for part in self.parts.values() if self._leader[part.path] == path]
        fixed = any(part.path in self._grounded for part in members)
        entry: dict[str, Any] = {"id": path, "fixed": fixed, "pose": self.parts[path].X_WP.json()}
        densities = [self._density(part) for part in members]
        if not fixed or None not in densities:
            entry["inertial"] = self._inertial(members, densities).json()
        entry["meshes"] = [meshes.of(part, self._in_body(part)) for part in members]
        return entry

    def _losses(self) -> list[str]:
        own = [what for what in self.lost if what not in ALWAYS_LOST]
        told = (
            ["read from STEP, which holds no joints, densities or settings: they are the script's"] if self.lost else []
        )
        return told + [f"lost in STEP: {what}" for what in own]

    def _material_warnings(self) -> list[str]:
        return [
            f'part "{part.path}": material "{part.material[0]}" has CadQuery\'s default density, 7850 kg/m³ (steel); '
            "state its own"
            for part in self.parts.values()
            if part.material
            and part.path not in self._densities
            and part.material[1] == STEEL_KG_PER_M3
            and "steel" not in part.material[0].lower()
        ]

    def _density(self, part: CadPart) -> float | None:
        own = self._densities.get(part.path)
        drawn = part.material[1] if part.material else self._other_density
        return drawn if own is None else own

    def _inertial(self, members: list[CadPart], densities: list[float | None]) -> MassProperties:
        pieces = []
        for part, density in zip(members, densities, strict=True):
            if density is None:
                raise DrawingError(
                    f'part "{part.path}" moves but has no density (mass 0 kg); call '
                    f'material("{part.path}", density_kg_per_m3=...), or give it a cq.Material'
                )
            key = (part.solid_key, density)
            if key not in self._masses:
                self._masses[key] = mass_properties(part.shape, density, part.path)
            pieces.append(self._masses[key].in_frame(self._in_body(part)))
        if len(members) > 1:
            placed = [(f'part "{part.path}"', part.shape.moved(self._in_body(part).location())) for part in members]
            if fault := overlap_fault(placed):
                raise DrawingError(f'body "{members[0].path}": {fault}')
        return combined(pieces)


def _point(id: str, point_mm: Sequence[float]) -> np.ndarray:
    """A place [mm]; DrawingError naming the marker or spring where it is none."""
    return _three(f'"{id}": point', point_mm, " mm")


def _three(what: str, given: Any, unit: str = "") -> np.ndarray:
    """Three finite numbers; DrawingError saying what they should have been otherwise."""
    try:
        numbers = np.array(given, float)
    except (TypeError, ValueError):
        numbers = np.full(1, np.nan)
    if numbers.shape != (3,) or not np.all(np.isfinite(numbers)):
        raise DrawingError(f"{what} {given}{unit}; give three finite numbers (x, y, z)")
    return numbers
