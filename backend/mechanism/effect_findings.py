"""What stands out in where effects are drawn: on what stands still, on a bed that no joint names, and under the name of
another part."""

from __future__ import annotations

from collections.abc import Iterator

from backend.mechanism.effect import Effect, kind_named
from backend.mechanism.kinds import EffectKind
from backend.mechanism.mechanism import Mechanism

ON_WHAT_STANDS = ("length_error", "link_flexibility")  # moves the pins of a base; is refused where a model is built
IN_SPACE = ("spherical", "universal")
TURNS_ABOUT_Z = ("revolute", "cylindrical", "planar")


def effect_findings(mechanism: Mechanism) -> Iterator[str]:
    """Warnings that each name an effect, the part, and the remedy."""
    for effect in mechanism.effects:
        kind = kind_named(effect.kind)
        for sentence in (
            *_idle(mechanism, effect, kind),
            *_bed_in_space(mechanism, effect),
            *_shared_name(mechanism, effect, kind),
        ):
            yield f'effect "{effect.id}": {sentence}'


def _idle(mechanism: Mechanism, effect: Effect, kind: EffectKind) -> Iterator[str]:
    """Of an effect on bodies that no effect moves."""
    if kind.acts_on not in ("body", "bodies") or effect.on == "all" or kind.name in ON_WHAT_STANDS:
        return
    fixed = [f'"{id}"' for id in effect.on if mechanism.body(id).fixed]
    if (kind.acts_on == "body" and fixed) or len(fixed) == len(effect.on):
        bodies, stand = ("body", "is") if len(fixed) == 1 else ("bodies", "are")
        yield f"{kind.name} on {bodies} {', '.join(fixed)}, which {stand} fixed, does nothing; name a body that moves"


def _bed_in_space(mechanism: Mechanism, effect: Effect) -> Iterator[str]:
    """Of friction on a bed whose plane a body's own joints do not tell."""
    if effect.kind != "surface_friction":
        return
    joints = mechanism.joints
    turning = [joint.id for joint in joints if joint.type in TURNS_ABOUT_Z]
    plane = f'the axis of joint "{turning[0]}"' if turning else "gravity"
    for body in mechanism.moving_bodies():
        own = [joint for joint in joints if body.id in (joint.body_a, joint.body_b)]
        if (effect.on == "all" or body.id in effect.on) and own and all(joint.type in IN_SPACE for joint in own):
            types = " and ".join(dict.fromkeys(joint.type for joint in own))
            yield (
                f'body "{body.id}" hangs on {types} joints, which tell no plane: the bed is taken to lie across '
                f"{plane}, and its friction to act wherever the body is; leave it out where nothing slides on a bed"
            )


def _shared_name(mechanism: Mechanism, effect: Effect, kind: EffectKind) -> Iterator[str]:
    """Of an effect that is called like a part of the kind that it acts on, and stands elsewhere."""
    if kind.acts_on not in ("joint", "body") or effect.on == (effect.id,):
        return
    parts = mechanism.joints if kind.acts_on == "joint" else mechanism.bodies
    if any(part.id == effect.id for part in parts):
        where = "all" if effect.on == "all" else ", ".join(effect.on)
        yield (
            f"is called like a {kind.acts_on} and stands on {where}: --free {kind.name}:{effect.id} frees this effect, "
            f"not one at that {kind.acts_on}; give it another id"
        )
