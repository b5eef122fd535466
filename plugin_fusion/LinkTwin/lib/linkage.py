"""The moving structure of a design: which joints are in force, and which occurrences each body is made of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from .anchors import unreadable
from .islands import INFERRED, ROOT, Islands, holds, islands
from .joints import HELD, type_name
from .names import readable, unique
from .placement import NotRigid, Placement


@dataclass(frozen=True)
class Linkage:
    """occurrences: those that exist, with `places` X_WP of each and of the root; joints: the moving ones, with ids.

    The joints' `one`, `two` and `context` are resolved to paths. problems: why there can be no mechanism.
    """

    occurrences: Sequence[Mapping]
    places: Mapping[str, Placement]
    joints: Sequence[Mapping]
    islands: Islands
    warnings: Sequence[str]
    problems: Sequence[str]


def linkage(snapshot: Mapping) -> Linkage:
    """The structure of a snapshot; every joint that is left out is named in the warnings."""
    warnings: list[str] = list(snapshot.get("unread", ()))
    problems: list[str] = []
    occurrences = _existing(snapshot["occurrences"], warnings)
    places = {ROOT: Placement()}
    for occurrence in occurrences:
        try:
            places[occurrence["path"]] = Placement.from_rows(occurrence["transform"])
        except NotRigid as error:
            places[occurrence["path"]] = Placement()
            problems.append(
                f'component "{occurrence["path"]}": its placement {error}; scale or mirror the bodies instead, '
                "and place the component without"
            )
    joints = [_resolved(joint, places, warnings) for joint in _named(snapshot["joints"])]
    in_force = [joint for joint in joints if joint is not None]
    groups = [_group(group, places, warnings) for group in snapshot.get("rigid_groups", ()) if not group["suppressed"]]
    found = islands(occurrences, in_force, groups)
    moving = [joint for joint in in_force if not holds(joint) and _can_move(joint, found, warnings)]
    return Linkage(occurrences, places, moving, found, warnings, problems)


def _existing(occurrences: Sequence[Mapping], warnings: list[str]) -> list[Mapping]:
    """Without what is suppressed or could not be read, and what lies in it."""
    gone: set[str] = set()
    listed = {ROOT, *(occurrence["path"] for occurrence in occurrences)}
    for occurrence in occurrences:
        if occurrence.get("suppressed") or occurrence["parent"] in gone:
            gone.add(occurrence["path"])
        elif occurrence["parent"] not in listed:
            gone.add(occurrence["path"])
            warnings.append(f'component "{occurrence["path"]}" is left out: what it lies in could not be read')
    return [occurrence for occurrence in occurrences if occurrence["path"] not in gone]


def _named(joints: Sequence[Mapping]) -> list[dict]:
    """The joints with ids; those of one name in several components are told apart by the component's."""
    plain = [readable(joint["name"], "joint") for joint in joints]
    told = [
        f"{joint['context'].replace('+', '/')}/{name}" if joint.get("context") and plain.count(name) > 1 else name
        for joint, name in zip(joints, plain)
    ]
    return [{**joint, "id": id} for joint, id in zip(joints, unique(told))]


def _resolved(joint: dict, places: Mapping[str, Placement], warnings: list[str]) -> dict | None:
    """The joint with paths of occurrences that exist; None where it is not in force, with a warning why."""
    what = f'joint "{joint["id"]}"'
    if joint.get("suppressed"):
        warnings.append(f"{what} is suppressed and left out; unsuppress it if it should hold")
        return None
    if joint.get("context", ROOT) not in places:
        warnings.append(f'{what} belongs to "{joint["context"]}", which is not in the design, and is left out')
        return None
    ends = {}
    for side in ("one", "two"):
        path = _path(joint.get(side), joint.get("context", ROOT), places)
        if path is None:
            named = joint.get(side)
            told = "a component that Fusion does not name" if named is None else f'"{named}", which is missing'
            warnings.append(f"{what} joins {told} or suppressed, and is left out; repair the joint in the timeline")
            return None
        ends[side] = path
    if ends["one"] == ends["two"]:
        where = ends["one"] or "the root component"
        warnings.append(f'{what} joins "{where}" to itself and is left out; make its parts components of their own')
        return None
    if joint["type"] == INFERRED:
        warnings.append(
            f"{what} is inferred from other geometry and says nothing of how its parts move; it is left out: "
            "replace it by a joint with a stated motion"
        )
        return None
    if not holds(joint) and joint["type"] not in HELD:
        warnings.append(f"{what} is of the unknown {type_name(joint['type'])} and is left out; use another joint")
        return None
    if not holds(joint) and (fault := unreadable(joint)):
        warnings.append(f"{what} {fault}, and is left out; edit the joint and pick its origin again")
        return None
    if joint.get("message"):
        warnings.append(f"{what}: Fusion says {joint['message']!r}; repair it in the timeline and export again")
    for link in joint.get("motion_links") or ():
        warnings.append(
            f'{what} is tied by motion link "{link}" to another motion, which the format does not hold: it moves by '
            "itself; leave out the parts that it drives, or expect a freedom more"
        )
    if joint.get("locked") and joint["type"] != 0:
        warnings.append(f"{what} is locked and therefore rigid; unlock it if its parts should move")
    return {**joint, **ends, "context": joint.get("context", ROOT)}


def _path(named: str | None, context: str, places: Mapping[str, Placement]) -> str | None:
    """The occurrence that a joint means: by its whole path, within its component, or by an end that is unique."""
    if named is None:
        return None
    if named == ROOT:
        return context
    if named in places:
        return named
    if f"{context}+{named}" in places:
        return f"{context}+{named}"
    ends = [path for path in places if path.endswith(f"+{named}")]
    return ends[0] if len(ends) == 1 else None


def _group(group: Mapping, places: Mapping[str, Placement], warnings: list[str]) -> Mapping:
    found = [_path(member, group.get("context", ROOT), places) for member in group["members"]]
    kept = [path for path in found if path is not None]
    if len(kept) < len(found):
        warnings.append(
            f'rigid group "{group["name"]}" names {len(found) - len(kept)} of {len(found)} components that are missing '
            "or suppressed; the others are one body: edit the group if that is not meant"
        )
    return {"members": kept}


def _can_move(joint: Mapping, found: Islands, warnings: list[str]) -> bool:
    if found.leader[joint["one"]] != found.leader[joint["two"]]:
        return True
    one, two = (f'"{joint[side] or "the root component"}"' for side in ("one", "two"))
    warnings.append(
        f'joint "{joint["id"]}" ({type_name(joint["type"])}) cannot move: {one} and {two} are one rigid body by rigid '
        "joints, rigid groups or grounding; it is left out: release one of them"
    )
    return False
