"""Effects that stand at several places, spelt out place by place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from typing import TYPE_CHECKING

from backend.mechanism.effect import Effect, kind_named
from backend.mechanism.kinds import EffectKind

if TYPE_CHECKING:
    from backend.mechanism.mechanism import Mechanism


def set_apart(mechanism: Mechanism, but: Set[str] = frozenset()) -> Mechanism:
    """The same mechanism with each effect on several joints, bodies or markers as one at each: `id@place`, so that the
    place may differ from the others.

    but: ids of effects that stay as they are.
    """
    parts = {e.id: [e] if e.id in but else at_each_place(mechanism, e) for e in mechanism.effects}
    effects = [one for of_one in parts.values() for each in of_one for one in _amending(each, parts)]
    return mechanism.model_copy(update={"effects": tuple(effects)})


def _amending(effect: Effect, parts: Mapping[str, Sequence[Effect]]) -> list[Effect]:
    """An error of other effects as one of each that those became; any other effect as it is."""
    kind = kind_named(effect.kind)
    if kind.acts_on != "effect":
        return [effect]
    amended = (
        [id for id, (first, *_) in parts.items() if first.kind in kind.amends] if effect.on == "all" else effect.on
    )
    return _one_at_each(effect, [one.id for id in amended for one in parts[id]])


def at_each_place(mechanism: Mechanism, effect: Effect) -> list[Effect]:
    """An effect as one at each joint, body or marker that it stands on, with those of its parameters that fit there."""
    kind = kind_named(effect.kind)
    apart = _one_at_each(effect, _places(mechanism, effect, kind))
    if kind.acts_on != "joint" or apart == [effect]:
        return apart
    types = {joint.id: joint.type for joint in mechanism.joints}

    def suits(name: str, joint: str) -> bool:
        """Torques belong to joints that turn, forces to those that slide."""
        return name not in kind.parameters or kind.parameters[name].suits(types[joint])

    return [
        one.model_copy(update={"parameters": {n: value for n, value in one.parameters.items() if suits(n, one.on[0])}})
        for one in apart
    ]


def _one_at_each(effect: Effect, places: Sequence[str]) -> list[Effect]:
    ids = [effect.id] if len(places) == 1 else [f"{effect.id}@{place}" for place in places]
    made = [effect.model_copy(update={"id": id, "on": (place,)}) for id, place in zip(ids, places, strict=True)]
    return made or [effect]


def is_mixed(mechanism: Mechanism, effect: Effect) -> bool:
    """Whether an effect stands on joints at which different ones of its kind's parameters mean something, given or
    not: an experiment may override one, or have it on record.
    """
    kind = kind_named(effect.kind)
    if kind.acts_on != "joint":
        return False
    types = set(joints_of(effect, {joint.id: joint.type for joint in mechanism.joints}).values())
    able = {frozenset(name for name, spec in kind.parameters.items() if spec.suits(type)) for type in types}
    return len(able) > 1


def joints_of(effect: Effect, types: Mapping[str, str]) -> dict[str, str]:
    """Those of these joints (id -> type) on which an effect stands; none of a kind that acts elsewhere."""
    kind = kind_named(effect.kind)
    if effect.on == "all":
        return {id: type for id, type in types.items() if suits_joint(kind, effect, type)} if kind.names_joints else {}
    # A body or a marker may have a joint's name, and a joint that of the world.
    named = () if not kind.names_joints or effect.on == (kind.acts_on,) == ("world",) else effect.on
    return {id: types[id] for id in named if id in types}


def _places(mechanism: Mechanism, effect: Effect, kind: EffectKind) -> tuple[str, ...]:
    if kind.acts_on not in ("joint", "body", "marker"):
        return ()
    if effect.on != "all":
        return effect.on
    if kind.acts_on == "joint":
        return tuple(joint.id for joint in mechanism.joints if suits_joint(kind, effect, joint.type))
    if kind.acts_on == "body":
        return tuple(body.id for body in mechanism.moving_bodies())
    return tuple(marker.id for marker in mechanism.markers)


def suits_joint(kind: EffectKind, effect: Effect, joint_type: str) -> bool:
    """Whether an effect on "all" acts at joints of a type: one of the parameters that it gives fits there."""
    specs = [kind.parameters[name] for name in effect.parameters if name in kind.parameters]
    return kind.suits(joint_type) and (not specs or any(spec.suits(joint_type) for spec in specs))
