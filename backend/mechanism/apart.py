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
    effects: list[Effect] = []
    for effect in mechanism.effects:
        kind = kind_named(effect.kind)
        places = _places(mechanism, effect, kind)
        if effect.id in but or not places:
            effects.append(effect)
            continue
        for place in places:
            given = {name: value for name, value in effect.parameters.items() if _suits(mechanism, kind, name, place)}
            id = effect.id if len(places) == 1 else f"{effect.id}@{place}"
            effects.append(effect.model_copy(update={"id": id, "on": (place,), "parameters": given}))
    return mechanism.model_copy(update={"effects": tuple(effects)})


def _places(mechanism: Mechanism, effect: Effect, kind: EffectKind) -> tuple[str, ...]:
    if kind.acts_on not in ("joint", "body", "marker"):
        return ()
    if effect.on != "all":
        return effect.on
    if kind.acts_on == "joint":
        return tuple(joint.id for joint in mechanism.joints if kind.suits(joint.type))
    if kind.acts_on == "body":
        return tuple(body.id for body in mechanism.moving_bodies())
    return tuple(marker.id for marker in mechanism.markers)


def _suits(mechanism: Mechanism, kind: EffectKind, name: str, place: str) -> bool:
    """Whether a parameter means something there: torques belong to joints that turn, forces to those that slide."""
    if kind.acts_on != "joint" or name not in kind.parameters:
        return True
    return kind.parameters[name].suits(mechanism.joint(place).type)
