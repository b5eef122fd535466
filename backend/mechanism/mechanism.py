"""What was drawn: bodies, the joints between them, the effects already known, and the points to be filmed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal, TypeVar

from pydantic import Field, model_validator

from backend.mechanism.body import Body
from backend.mechanism.drawing_error import MOST_LISTED, DrawingError, first, known
from backend.mechanism.effect import Effect, kind_named, missing_parameters, order_faults, parameter_faults, shortened
from backend.mechanism.joint import Joint
from backend.mechanism.kinds import EffectKind
from backend.mechanism.marker import Marker
from backend.mechanism.part import Part, Vector3

FOUND = "link_contact"  # the one kind between two bodies whose pairs can be found in the drawing
BY_LINK = ("start_a_m", "end_a_m", "start_b_m", "end_b_m")

Named = TypeVar("Named", Body, Joint, Effect, Marker)


class Provenance(Part):
    """Where a drawing comes from, and what its exporter had to say about it."""

    tool: str = ""
    tool_version: str = ""
    exporter: str = ""
    exporter_version: str = ""
    created: str = ""
    warnings: Annotated[tuple[str, ...], Field(strict=False)] = ()


class Mechanism(Part):
    """A drawing; see docs/mechanism.md for its frames and units.

    Joints form a flat list, so closed loops need no parent and no child. Construction checks the whole and
    raises ValueError (DrawingError when read from a file) with every dangling id, duplicate and unsuitable
    parameter.
    """

    schema_version: Literal["1.0"] = "1.0"
    name: str = "mechanism"
    gravity_m_per_s2: Vector3 = (0.0, 0.0, -9.80665)
    provenance: Provenance | None = None
    bodies: Annotated[tuple[Body, ...], Field(strict=False)]
    joints: Annotated[tuple[Joint, ...], Field(strict=False)] = ()
    effects: Annotated[tuple[Effect, ...], Field(strict=False)] = ()
    markers: Annotated[tuple[Marker, ...], Field(strict=False)] = ()

    def body(self, id: str) -> Body:
        """The body of that id; DrawingError listing the known ids otherwise."""
        return _find(self.bodies, id, "body")

    def joint(self, id: str) -> Joint:
        """The joint of that id; DrawingError listing the known ids otherwise."""
        return _find(self.joints, id, "joint")

    def effect(self, id: str) -> Effect:
        """The effect of that id; DrawingError listing the known ids otherwise."""
        return _find(self.effects, id, "effect")

    def marker(self, id: str) -> Marker:
        """The marker of that id; DrawingError listing the known ids otherwise."""
        return _find(self.markers, id, "marker")

    def moving_bodies(self) -> tuple[Body, ...]:
        """The bodies that can move, in drawn order."""
        return tuple(body for body in self.bodies if not body.fixed)

    @model_validator(mode="after")
    def _hangs_together(self) -> Mechanism:
        if problems := first(_problems(self)):
            raise DrawingError(problems)
        return self


def _find(parts: Sequence[Named], id: str, what: str) -> Named:
    for part in parts:
        if part.id == id:
            return part
    raise DrawingError(f'there is no {what} "{id}". {known(part.id for part in parts)}')


def _problems(mechanism: Mechanism) -> Iterator[str]:
    parts = {
        "body": mechanism.bodies,
        "joint": mechanism.joints,
        "effect": mechanism.effects,
        "marker": mechanism.markers,
    }
    for what, group in parts.items():
        for id, count in Counter(part.id for part in group).items():
            if count > 1:
                yield f'{what} "{id}" stands {count} times in the file; ids are unique: rename all but one'
    if not any(body.fixed for body in mechanism.bodies):
        yield (
            f"no fixed body among the {len(mechanism.bodies)} bodies; "
            "declare the part that stands still as fixed, or add a ground"
        )
    bodies = {body.id for body in mechanism.bodies}
    for joint in mechanism.joints:
        for side, body in (("body_a", joint.body_a), ("body_b", joint.body_b)):
            if body not in bodies:
                yield f'joint "{joint.id}": {side} "{body}" is not a body. {known(bodies)}'
        if joint.body_a == joint.body_b:
            yield f'joint "{joint.id}": connects body "{joint.body_a}" to itself; a joint needs two bodies'
    for marker in mechanism.markers:
        if marker.body not in bodies:
            yield f'marker "{marker.id}": body "{marker.body}" is not a body. {known(bodies)}'
    drawn = Drawn.of(mechanism)
    for effect in mechanism.effects:
        for fault in effect_faults(drawn, effect):
            yield f'effect "{effect.id}": {fault}'
    yield from _twice_told(mechanism)


def _twice_told(mechanism: Mechanism) -> Iterator[str]:
    """Joints whose motion several effects prescribe."""
    told: dict[str, list[str]] = {}
    for effect in mechanism.effects:
        if effect.kind == "prescribed_motion":
            for id in [joint.id for joint in mechanism.joints] if effect.on == "all" else effect.on:
                told.setdefault(id, []).append(f'"{effect.id}"')
    for id, effects in told.items():
        if len(effects) > 1:
            yield f'joint "{id}": {len(effects)} effects prescribe its motion ({", ".join(effects)}); keep one of them'


@dataclass(frozen=True)
class Drawn:
    """The parts of a drawing by id, looked through once for all of its effects.

    some: of joints alike in type, and in whether their fit tells their play, the first.
    """

    bodies: frozenset[str]
    ground: tuple[str, ...]
    markers: frozenset[str]
    effects: Mapping[str, str]
    joints: Mapping[str, Joint]
    some: Mapping[str, Joint]
    held: Mapping[str, int]
    """Body -> how many joints hold it."""

    @classmethod
    def of(cls, mechanism: Mechanism) -> Drawn:
        """Of a drawing, which need not be right."""
        alike: dict[tuple[str, bool], Joint] = {}
        for joint in mechanism.joints:
            alike.setdefault((joint.type, _tells_its_play(joint)), joint)
        return cls(
            bodies=frozenset(body.id for body in mechanism.bodies),
            ground=tuple(body.id for body in mechanism.bodies if body.fixed),
            markers=frozenset(marker.id for marker in mechanism.markers),
            effects={effect.id: effect.kind for effect in mechanism.effects},
            joints={joint.id: joint for joint in mechanism.joints},
            some={joint.id: joint for joint in alike.values()},
            held=Counter(body for joint in mechanism.joints for body in {joint.body_a, joint.body_b}),
        )

    def joints_of(self, on: Sequence[str]) -> dict[str, Joint]:
        """Joints on which an effect stands, as drawn; of "all" those that differ."""
        if on == "all":
            return dict(self.some)
        return {id: self.joints[id] for id in on if id in self.joints}


def _tells_its_play(joint: Joint) -> bool:
    return joint.fit is not None and joint.fit.clearance_m() is not None


def effect_faults(drawn: Drawn, effect: Effect) -> list[str]:
    """What is wrong with an effect among these parts: its kind, where it stands, its parameters."""
    try:
        kind = kind_named(effect.kind)
    except ValueError as error:
        return [str(error)]
    faults = place_faults(drawn, kind, effect.on)
    joints = None
    if kind.acts_on == "joint" or (kind.names_joints and effect.on != ("world",)):
        joints = drawn.joints_of(effect.on)
    types = None if joints is None else {id: joint.type for id, joint in joints.items()}
    wrong = parameter_faults(kind, effect.parameters, types, effect.on == "all")
    faults += wrong or order_faults(kind, effect.parameters)
    able = [joint for joint in (joints or {}).values() if kind.suits(joint.type)]
    unfitted = [joint.id for joint in able if not _tells_its_play(joint)]
    if kind.name == FOUND and effect.on == "all":
        return faults + _found_faults(effect)
    if kind.acts_on == "bodies":
        faults += _unheld_faults(drawn, kind, effect)
    return faults + missing_parameters(kind, effect.parameters, unfitted[0] if unfitted else None)


def _found_faults(effect: Effect) -> list[str]:
    """What belongs to one pair of links, said of all of them."""
    faults = [
        f'{name} is given, but on is "all" and every capsule ends at joints; remove it, or name two links'
        for name in BY_LINK
        if name in effect.parameters
    ]
    first, second = (effect.parameters.get(f"radius_{side}_m") for side in "ab")
    if first is not None and second is not None and first != second:
        faults += [f'radius_a_m is {first} m and radius_b_m {second} m, but on is "all"; give one radius for all links']
    return faults


def _unheld_faults(drawn: Drawn, kind: EffectKind, effect: Effect) -> Iterator[str]:
    """Ends that joints should give, on bodies that too few joints hold."""
    for side, body in zip("ab", [*effect.on[:2], *drawn.ground[:2]][:2], strict=False):
        lacking = [n for n, s in kind.parameters.items() if s.drawn and f"_{side}_" in n and n not in effect.parameters]
        held = drawn.held.get(body, 0)
        if lacking and held < 2:
            count = f"{held} joint" if held == 1 else "no joint"
            yield (
                f"{' and '.join(lacking)} {'is' if len(lacking) == 1 else 'are'} missing, and {count} of body "
                f'"{body}" cannot tell; give it in m, or hold the body by two joints'
            )


def place_faults(drawn: Drawn, kind: EffectKind, on: Sequence[str]) -> list[str]:
    """Why a kind cannot stand at `on` (ids, or the word "all")."""
    acts_on = kind.acts_on
    if acts_on in ("world", "camera"):
        if on == (acts_on,) or (acts_on == "camera" and on != "all" and drawn.markers.issuperset(on)):
            return []
        if kind.names_joints and on != "all" and drawn.joints.keys() >= set(on):
            return []
        others = f", or name joints. {known(drawn.joints)}" if kind.names_joints else ""
        return [f'on is {shortened(on)}, but {kind.name} acts on the {acts_on}; write "on": ["{acts_on}"]{others}']
    part = {"bodies": "body"}.get(acts_on, acts_on)
    ids: Collection[str] = {
        "body": drawn.bodies,
        "joint": drawn.joints,
        "marker": drawn.markers,
        "effect": drawn.effects,
    }[part]
    if on == "all" and not ids:
        return [f'stands on "all", but no {part} is drawn; draw one, or remove the effect']
    if on == "all" and (acts_on != "bodies" or kind.name == FOUND):
        return []
    if on == "all":  # its points and axes are those of one body: they would mean nothing on every other
        return [f'on is "all", but {kind.name} acts on one body, or between two; name them. {known(ids)}']
    faults = []
    if strangers := [id for id in on if id not in ids]:
        there = known(ids)
        faults = [f'on names "{id}", but no {part} has that id. {there}' for id in strangers]
    if acts_on == "effect" and (unfit := [id for id in on if id in ids and drawn.effects[id] not in kind.amends]):
        words = " or ".join(kind.amends)
        there = known(id for id, other in drawn.effects.items() if other in kind.amends)
        faults += [f'on names "{id}", but {kind.name} acts on {words}. {there}' for id in unfit]
    if (rest := len(faults) - MOST_LISTED) > 0:
        faults = [*faults[:MOST_LISTED], f"on has {rest} more names like the last"]
    if acts_on == "bodies" and len(on) > 2:
        faults.append(f"on names {len(on)} bodies; name one, or two of which the second takes the reaction")
    return faults
