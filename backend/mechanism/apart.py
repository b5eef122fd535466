"""Effects that stand at several places, spelt out place by place."""

from __future__ import annotations

from collections.abc import Set
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
    effects = [
        one
        for effect in mechanism.effects
        for one in ([effect] if effect.id in but else at_each_place(mechanism, effect))
    ]
    return mechanism.model_copy(update={"effects": tuple(effects)})


def at_each_place(mechanism: Mechanism, effect: Effect) -> list[Effect]:
    """An effect as one at each joint, body or marker that it stands on, with those of its parameters that fit there."""
    kind = kind_named(effect.kind)
    places = _places(mechanism, effect, kind)
    made = []
    for place in places:
        given = {name: value for name, value in effect.parameters.items() if _suits(mechanism, kind, name, place)}
        id = effect.id if len(places) == 1 else f"{effect.id}@{place}"
        made.append(effect.model_copy(update={"id": id, "on": (place,), "parameters": given}))
    return made or [effect]


def is_mixed(mechanism: Mechanism, effect: Effect) -> bool:
    """Whether an effect stands on joints at which different ones of its parameters mean something."""
    kind = kind_named(effect.kind)
    if kind.acts_on != "joint":
        return False
    given = [frozenset(one.parameters) for one in at_each_place(mechanism, effect)]
    return any(names != given[0] for names in given)


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


def _suits(mechanism: Mechanism, kind: EffectKind, name: str, place: str) -> bool:
    """Whether a parameter means something there: torques belong to joints that turn, forces to those that slide."""
    if kind.acts_on != "joint" or name not in kind.parameters:
        return True
    return kind.parameters[name].suits(mechanism.joint(place).type)
