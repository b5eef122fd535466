"""Where a joint is: Autodesk's help does not say in which frame a joint's origins are, so each reading is tried.

The two parts of a joint meet where it is. The reading in which both origins fall on one place, but for what the
joint leaves free, is taken; a joint with one origin follows the others, or else the nearness of its parts.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from .islands import ROOT
from .placement import Placement, Vector, cross, dot, length, minus, plus, unit

REVOLUTE, SLIDER, CYLINDRICAL, PIN_SLOT, PLANAR, BALL = 1, 2, 3, 4, 5, 6  # adsk.fusion.JointTypes
MET_CM = 1e-3  # 10 µm: Fusion solves its joints far closer, and readings differ by a part's distance from the origin
PARALLEL = 1e-6
UNSHIFTED = " without the joint origin's offset"
DIRECTION = {REVOLUTE: "rotation_axis", SLIDER: "slide_direction", CYLINDRICAL: "rotation_axis",
             PIN_SLOT: "rotation_axis", PLANAR: "normal"}  # fmt: skip


@dataclass(frozen=True)
class Anchor:
    """A joint's place in the world: origins on parts one and two [cm], and the unit axis.

    apart: of the two origins, without what the joint leaves free [cm]; None where only one is known.
    tried: the same by reading, for people to see.
    """

    reading: str
    one: Vector
    two: Vector
    axis: Vector
    slot: Vector | None
    apart: float | None
    tried: Mapping[str, float]

    @property
    def met(self) -> bool:
        """Whether the two origins fall on one place."""
        return self.apart is None or self.apart <= MET_CM


def anchors(
    joints: Sequence[Mapping], places: Mapping[str, Placement], off_part: Callable[[str, Vector], float]
) -> list[Anchor]:
    """The place of each joint of a snapshot; of each, `unreadable` must have said None.

    places: X_WP of every occurrence path, ROOT included.  off_part: how far a point of the world lies outside the
    bodies of a path [cm].
    """
    tried = [_readings(joint, places) for joint in joints]
    votes: Counter = Counter()
    for found in tried:
        met = _distinct([anchor for anchor in found if anchor.apart is not None and anchor.met])
        if len(met) == 1 and len(_distinct(found)) > 1:
            votes[met[0].reading.removesuffix(UNSHIFTED)] += 1
    favourite = votes.most_common(1)[0][0] if votes else None
    return [_choose(joint, found, favourite, off_part) for joint, found in zip(joints, tried)]


def unreadable(joint: Mapping) -> str | None:
    """Why a joint in force cannot be placed, as the end of a sentence; None when it can."""
    if not (joint.get("geometry_one") or joint.get("geometry_two")):
        return "has no origin that can be read"
    name = DIRECTION.get(joint["type"])
    if name and not any(joint.get(name) or ()):
        return f"has no {name.replace('_', ' ')} that can be read"
    return None


def _readings(joint: Mapping, places: Mapping[str, Placement]) -> list[Anchor]:
    """The joint in every reading, the likeliest first."""
    X_W1, X_W2 = places[joint["one"]], places[joint["two"]]
    frames = {"world": (Placement(), Placement()), "occurrence": (X_W1, X_W2)}
    if joint.get("context", ROOT) != ROOT:
        frames["context"] = (places[joint["context"]], places[joint["context"]])
    drawn_away = any((joint.get(side) or {}).get("shift_cm") for side in ("geometry_one", "geometry_two"))
    ways = [(name, X, share) for name, X in frames.items() for share in ((1.0, 0.0) if drawn_away else (0.0,))]
    found: list[Anchor] = []
    for name, (X_1, X_2), share in ways:
        reading = f"{name}{UNSHIFTED}" if drawn_away and not share else name
        sides = [(X, joint[side]) for X, side in ((X_1, "geometry_one"), (X_2, "geometry_two")) if joint.get(side)]
        origins = [X.point(plus(g["origin_cm"], g.get("shift_cm") or (0.0, 0.0, 0.0), share)) for X, g in sides]
        drawn = [[X.direction(v) for v in geometry.get("vectors") or ()] for X, geometry in sides]
        turns = (X_1, X_W1, X_W2) if name == "context" else (Placement(), X_W1, X_W2)
        axis = _direction(joint.get(DIRECTION.get(joint["type"], "")), turns, drawn) or (0.0, 0.0, 1.0)
        slot = _direction(joint.get("slide_direction"), turns, drawn) if joint["type"] == PIN_SLOT else None
        apart = _bound(joint, minus(origins[0], origins[-1]), axis, slot) if len(origins) == 2 else None
        found.append(Anchor(reading, origins[0], origins[-1], axis, slot, apart, {}))
    tried = {anchor.reading: anchor.apart for anchor in found if anchor.apart is not None}
    return [Anchor(a.reading, a.one, a.two, a.axis, a.slot, a.apart, tried) for a in found]


def _direction(raw: Sequence[float] | None, turns: Sequence[Placement], drawn: Sequence[Sequence]) -> Vector | None:
    """A direction in the world: as turned so that it lies along an axis of both geometries, else as it comes."""
    if not raw or not any(raw):
        return None
    candidates = [unit(X.direction(raw)) for X in turns]
    for axis in candidates:
        if drawn and all(any(length(cross(axis, v)) < PARALLEL for v in vectors) for vectors in drawn):
            return axis
    return candidates[0]


def _bound(joint: Mapping, gap: Vector, axis: Vector, slot: Vector | None) -> float:
    """The part of a gap that the joint does not leave free [cm]; its offset is meant, along its axis where it turns.

    A slide may run across the joint's own z axis, along which its offset is, and a ball has no axis.
    """
    offset = abs(joint.get("offset_cm") or 0.0)
    along = dot(gap, axis)
    across = plus(gap, axis, -along)
    if joint["type"] == BALL:
        return max(0.0, length(gap) - offset)
    if joint["type"] == SLIDER:
        return max(0.0, length(across) - offset)
    if joint["type"] == CYLINDRICAL:
        return length(across)
    along = max(0.0, abs(along) - offset)
    if joint["type"] == PLANAR:
        return along
    if slot is not None:
        across = plus(across, slot, -dot(across, slot))
    return length((along, length(across), 0.0))


def _distinct(found: Sequence[Anchor]) -> list[Anchor]:
    """Readings that put the joint in different places or along different axes."""
    kept: list[Anchor] = []
    for anchor in found:
        if not any(
            length(minus(anchor.one, other.one)) <= MET_CM and length(cross(anchor.axis, other.axis)) < PARALLEL
            for other in kept
        ):
            kept.append(anchor)
    return kept


def _choose(
    joint: Mapping, found: Sequence[Anchor], favourite: str | None, off_part: Callable[[str, Vector], float]
) -> Anchor:
    able = _distinct([anchor for anchor in found if anchor.met])
    if len(able) < 2:
        return (able or found)[0]
    for anchor in able:
        if anchor.reading.removesuffix(UNSHIFTED) == favourite:
            return anchor
    off = [off_part(joint["one"], a.one) + off_part(joint["two"], a.two) for a in able]
    nearest = min(range(len(able)), key=lambda at: off[at])
    return able[nearest] if off[nearest] < off[0] - MET_CM else able[0]
