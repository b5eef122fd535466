"""From a snapshot of a Fusion design to a mechanism.json: pure logic, the same off Fusion as in it."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone

from .anchors import Anchor, anchors
from .bodies import Body, MeshFiles, bodies, body_entry, cylinders_in_world, off_part, solids
from .findings import drawing_warnings, mass_problems, structure_problems, structure_warnings
from .fits import fit
from .joints import joint_entry
from .linkage import Linkage, linkage
from .names import readable, unique
from .placement import Placement, metres
from .witness import settle

SCHEMA_VERSION = "1.0"
EXPORTER, EXPORTER_VERSION = "plugin_fusion", "0.1.0"
GRAVITY = 9.80665
UP = {"x": 0, "y": 1, "z": 2}


@dataclass(frozen=True)
class Export:
    """What became of a snapshot.

    document: of mechanism.json.  meshes: uri -> groups for `stl.write`.  readings: how what Autodesk leaves open was
    read.  problems: why no backend will take the document; empty when it is fit to be written.
    """

    document: dict
    meshes: Mapping[str, list]
    readings: Mapping
    warnings: Sequence[str]
    problems: Sequence[str]


def export(snapshot: Mapping, mesh_of: Callable[[str], Sequence]) -> Export:
    """The mechanism in a snapshot (see docs/fusion.md for its fields; Fusion's own units: cm, kg, rad).

    mesh_of: triangles of a mesh by its name in the snapshot; stl.BadMesh or OSError where it cannot be had.
    """
    structure = linkage(snapshot)
    first_place = {}
    for occurrence in structure.occurrences:
        first_place.setdefault(occurrence["component"], structure.places[occurrence["path"]])
    first_place[snapshot["root"]["component"]] = Placement()
    settled = settle(snapshot["components"], first_place, mesh_of)
    carried = solids(snapshot, settled.pieces)
    parts = bodies(structure, carried)
    files = MeshFiles()
    entries = [body_entry(body, carried, structure, files) for body in parts]
    placed = anchors(structure.joints, structure.places, lambda path, p: off_part(path, p, carried, structure))
    warnings = [*structure.warnings, *settled.warnings, *drawing_warnings(snapshot, structure)]
    joints = _joints(structure, placed, parts, carried, warnings)
    warnings += structure_warnings(parts, joints)
    document = {
        "schema_version": SCHEMA_VERSION,
        "name": readable(snapshot["document"]["name"], "mechanism"),
        "gravity_m_per_s2": _gravity(snapshot.get("up", "z")),
        "provenance": _provenance(snapshot, warnings),
        "bodies": entries,
        "joints": joints,
        "effects": [],
        "markers": _markers(snapshot, structure, parts),
    }
    problems = [*structure.problems, *structure_problems(parts, joints), *mass_problems(entries)]
    readings = {**settled.readings, "joints": [_told(j, a) for j, a in zip(structure.joints, placed)]}
    return Export(document, files.groups, readings, warnings, problems)


def _joints(
    structure: Linkage, placed: Sequence[Anchor], parts: Sequence[Body], carried, warnings: list[str]
) -> list[dict]:
    owner = {path: body for body in parts for path in body.members}
    standing = {body.id: cylinders_in_world(body, carried, structure) for body in parts}
    entries = []
    for joint, anchor in zip(structure.joints, placed):
        a, b = owner[joint["two"]], owner[joint["one"]]
        entry = joint_entry(joint["id"], joint, anchor, (a.id, b.id), (a.X_WB, b.X_WB), warnings)
        if entry["type"] in ("revolute", "cylindrical"):
            drawn = fit(standing[a.id], standing[b.id], anchor.two, anchor.axis)
            if drawn:
                entry["fit"] = drawn
        if not anchor.met:
            tried = ", ".join(f"{10 * apart:.4g} mm as {reading}" for reading, apart in anchor.tried.items())
            warnings.append(
                f'joint "{joint["id"]}": its two origins meet in no reading ({tried}); the first is written: '
                "recompute the design (Ctrl+B), and check the joint's origins"
            )
        entries.append(entry)
    return entries


def _markers(snapshot: Mapping, structure: Linkage, parts: Sequence[Body]) -> list[dict]:
    """Construction points whose name begins with `marker`, on the body that their component belongs to."""
    owner = {path: body for body in parts for path in body.members}
    component = {"": snapshot["root"]["component"]}
    component.update({occurrence["path"]: occurrence["component"] for occurrence in structure.occurrences})
    found = []
    for path in structure.places:
        for point in snapshot["components"][component[path]].get("markers", ()):
            if path in owner:
                body = owner[path]
                p_BM = body.X_WB.inverse().point(structure.places[path].point(point["position_cm"]))
                found.append((readable(point["name"], "marker"), body.id, metres(p_BM)))
    ids = unique(name for name, _, _ in found)
    return [{"id": id, "body": body, "position_m": p} for id, (_, body, p) in zip(ids, found)]


def _gravity(up: str) -> list:
    down = [0.0, 0.0, 0.0]
    down[UP[up]] = -GRAVITY
    return down


def _provenance(snapshot: Mapping, warnings: Sequence[str]) -> dict:
    epoch = os.environ.get("SOURCE_DATE_EPOCH")
    created = datetime.now(timezone.utc) if epoch is None else datetime.fromtimestamp(int(epoch), timezone.utc)
    return {
        "tool": "Autodesk Fusion",
        "tool_version": str(snapshot.get("fusion_version") or ""),
        "exporter": EXPORTER,
        "exporter_version": EXPORTER_VERSION,
        "created": created.strftime("%Y-%m-%dT%H:%M:%SZ"),
        "warnings": list(warnings),
    }


def _told(joint: Mapping, anchor: Anchor) -> dict:
    return {
        "joint": joint["id"],
        "reading": anchor.reading,
        "origins_apart_mm": {reading: 10.0 * apart for reading, apart in anchor.tried.items()},
    }
