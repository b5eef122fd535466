"""The rigid bodies of mechanism.json: frame, mass and meshes of each group of occurrences that is one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from .fits import Cylinder, cylinders
from .islands import ROOT
from .linkage import Linkage
from .mass import combined
from .names import body_ids, file_names
from .placement import Placement, Vector, length
from .witness import Piece


@dataclass
class Solids:
    """What the occurrences of a design carry: pieces and cylinders by component, and which component each is of."""

    component: Mapping[str, str]
    pieces: Mapping[str, Sequence[Piece]]
    cylinders: Mapping[str, Sequence[Cylinder]]

    def of(self, path: str) -> Sequence[Piece]:
        """The pieces of an occurrence's own bodies, in its own frame."""
        return self.pieces.get(self.component.get(path, ""), ())


@dataclass
class Body:
    """A rigid body: its id, the occurrence whose frame it takes (ROOT: the world), its members and its pose X_WB."""

    id: str
    frame: str
    members: Sequence[str]
    X_WB: Placement
    fixed: bool


@dataclass
class MeshFiles:
    """The files to be written: uri -> groups for stl.write. Occurrences of one shape share one."""

    groups: dict = field(default_factory=dict)
    _known: dict = field(default_factory=dict)

    def entry(self, name: str, key: tuple, group: list) -> dict:
        """The `meshes` entry of a shape, written under a name of its own."""
        if key not in self._known:
            names = [uri[len("meshes/") : -len(".stl")] for uri in self.groups]
            uri = "meshes/" + file_names([*names, name], ".stl")[-1]
            self._known[key] = uri
            self.groups[uri] = group
        return {"uri": self._known[key], "scale_to_m": 1e-3}


def solids(snapshot: Mapping, pieces: Mapping[str, Sequence[Piece]]) -> Solids:
    """The solids of a snapshot, by occurrence path; ROOT for those of the root component."""
    component = {ROOT: snapshot["root"]["component"]}
    component.update({occurrence["path"]: occurrence["component"] for occurrence in snapshot["occurrences"]})
    found = {id: cylinders(entry.get("cylinders", ())) for id, entry in snapshot["components"].items()}
    return Solids(component, pieces, found)


def bodies(structure: Linkage, carried: Solids) -> list[Body]:
    """The rigid bodies, in browser order: what stands still first, without empty groups that no joint needs."""
    jointed = {structure.islands.leader[joint[side]] for joint in structure.joints for side in ("one", "two")}
    kept = [
        (leader, members)
        for leader, members in structure.islands.members.items()
        if leader in jointed or any(carried.of(path) for path in members)
    ]
    frames = [_frame(leader, members, carried) for leader, members in kept]
    ids = body_ids(frames)
    return [
        Body(ids[frame], frame, members, structure.places[frame], leader == ROOT)
        for frame, (leader, members) in zip(frames, kept)
    ]


def _frame(leader: str, members: Sequence[str], carried: Solids) -> str:
    """The occurrence whose frame a body takes; what stands still takes its one component's, or else the world's."""
    if leader != ROOT or carried.of(ROOT):
        return leader
    holding = [path for path in members if carried.of(path)]
    tops = {
        path for path in members if path != ROOT and not any(path.startswith(f"{other}+") for other in members if other)
    }
    inside = [top for top in tops if all(path == top or path.startswith(f"{top}+") for path in holding)]
    return inside[0] if len(tops) == 1 and inside else ROOT


def body_entry(body: Body, carried: Solids, structure: Linkage, files: MeshFiles) -> dict:
    """A body as mechanism.json writes it; without `inertial` where nothing of it weighs."""
    there = body.X_WB.inverse()
    entry: dict = {"id": body.id, "name": body.frame or "root", "fixed": body.fixed, "pose": body.X_WB.json()}
    weighed, meshes = [], []
    for path in body.members:
        X_BP = Placement() if path == body.frame else there @ structure.places[path]
        pieces = carried.of(path)
        weighed += [piece.properties.in_frame(X_BP) for piece in pieces]
        shown = [(piece.triangles, piece.scale, X_BP @ piece.X_CM) for piece in pieces if piece.triangles]
        if shown:
            component = carried.component[path]
            place = tuple(round(number, 9) for row in (*X_BP.rotation, X_BP.position) for number in row)
            meshes.append(files.entry(body_ids([path])[path].replace("/", "_"), (component, place), shown))
    if weighed:
        entry["inertial"] = combined(weighed).json()
    entry["meshes"] = meshes
    return entry


def cylinders_in_world(body: Body, carried: Solids, structure: Linkage) -> list[Cylinder]:
    """The pins and holes of a body as they stand."""
    return [
        cylinder.seen_from(structure.places[path])
        for path in body.members
        for cylinder in carried.cylinders.get(carried.component.get(path, ""), ())
    ]


def off_part(path: str, point_W: Vector, carried: Solids, structure: Linkage) -> float:
    """How far a point lies outside the boxes of an occurrence's bodies, and of those below it [cm]; 0 without any."""
    off = []
    for other, X_WP in structure.places.items():
        if other == path or (path != ROOT and other.startswith(f"{path}+")):
            p = X_WP.inverse().point(point_W)
            for piece in carried.of(other):
                if piece.box:
                    low, high = piece.box
                    off.append(length([max(a - x, 0.0, x - b) for a, b, x in zip(low, high, p)]))
    return min(off, default=0.0)
