"""Which occurrences are one rigid body: rigid joints, rigid groups, grounding and nesting, by union-find."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

ROOT = ""  # the path of the design's root component; it stands still
RIGID, INFERRED = 0, 7  # adsk.fusion.JointTypes


@dataclass(frozen=True)
class Islands:
    """leader: of the rigid body of each occurrence path; ROOT leads what stands still.  members: of each leader.

    The highest in the tree leads, and of those the first in browser order.
    """

    leader: Mapping[str, str]
    members: Mapping[str, Sequence[str]]


class _Unions:
    def __init__(self, names: Iterable[str]):
        self.parent = {name: name for name in names}

    def find(self, name: str) -> str:
        while self.parent[name] != name:
            self.parent[name] = self.parent[self.parent[name]]
            name = self.parent[name]
        return name

    def join(self, a: str, b: str) -> None:
        self.parent[self.find(b)] = self.find(a)


def islands(occurrences: Sequence[Mapping], joints: Sequence[Mapping], groups: Sequence[Mapping]) -> Islands:
    """The rigid bodies of a design.

    occurrences: of a snapshot, in browser order.  joints: those in force, `one` and `two` being paths (ROOT for the
    root component) and `type` a JointType; a locked joint holds like a rigid one.  groups: lists of paths under
    `members`.

    An occurrence moves within its parent only where a joint in force says so: a moving joint between something in
    it and something else of the same parent. All other nested components are one with their parent.
    """
    unions = _Unions([ROOT, *(occurrence["path"] for occurrence in occurrences)])
    for occurrence in occurrences:
        if occurrence.get("pinned"):
            unions.join(ROOT, occurrence["path"])
        if occurrence.get("ground_to_parent"):
            unions.join(occurrence["parent"], occurrence["path"])
    moving = []
    for joint in joints:
        if holds(joint):
            unions.join(joint["one"], joint["two"])
        else:
            moving.append((joint["one"], joint["two"]))
    for group in groups:
        for member in group["members"][1:]:
            unions.join(group["members"][0], member)
    parents = {occurrence["path"]: occurrence["parent"] for occurrence in occurrences}
    loose = {name for one, two in moving for name in _moving_within(one, two, parents)}
    for occurrence in occurrences:
        if occurrence["parent"] != ROOT and occurrence["path"] not in loose:
            unions.join(occurrence["parent"], occurrence["path"])
    return _named(unions, sorted(parents, key=lambda path: len(lineage(path, parents))))


def holds(joint: Mapping) -> bool:
    """Whether a joint lets nothing move."""
    return joint["type"] == RIGID or bool(joint.get("locked"))


def lineage(path: str, parents: Mapping[str, str]) -> list[str]:
    """The path itself and those of its parents, from the top down, without the root."""
    found = []
    while path != ROOT:
        found.append(path)
        path = parents[path]
    return found[::-1]


def _moving_within(one: str, two: str, parents: Mapping[str, str]) -> Iterable[str]:
    """The occurrences just below the deepest common parent of a moving joint's two ends, if that is not the root."""
    a, b = lineage(one, parents), lineage(two, parents)
    shared = sum(1 for x, y in zip(a, b) if x == y)
    if shared:
        yield from a[shared : shared + 1]
        yield from b[shared : shared + 1]


def _named(unions: _Unions, paths: Sequence[str]) -> Islands:
    members: dict[str, list[str]] = {}
    for path in [ROOT, *paths]:
        members.setdefault(unions.find(path), []).append(path)
    led = {group[0]: group for group in members.values()}
    return Islands({path: leader for leader, group in led.items() for path in group}, led)
