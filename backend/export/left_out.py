"""What of a drawing's effects other simulators cannot hold, in sentences."""

from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np

from backend.effects.effect import AbstractEffect
from backend.effects.shapes import (
    AbstractBaseMotion,
    AbstractBedFriction,
    AbstractBodyForce,
    AbstractClock,
    AbstractDrag,
    AbstractDrawnError,
    AbstractDryFriction,
    AbstractHold,
    AbstractJointClearance,
    AbstractJointDamping,
    AbstractJointEffort,
    AbstractJointInertia,
    AbstractJointMotion,
    AbstractJointStop,
    AbstractLinkContact,
    AbstractMarkerError,
    AbstractPush,
    AbstractRateFriction,
    AbstractRub,
    AbstractSection,
    AbstractShutter,
    AbstractSpringError,
    AbstractStrut,
    AbstractView,
)
from backend.mechanism.joint import WITHOUT_COORDINATE
from backend.mechanism.mechanism import Mechanism
from backend.model.model import Model
from backend.model.placed import Placed

NO_STOP = 999.0  # rad or m: a stop declared on one side has its other end out here
HARD = 1e-9  # rad/(N m) or m/N: an end of travel that gives no more is rigid
MANY = 6  # places that a sentence names
WHOLE = (
    AbstractJointDamping, AbstractJointInertia, AbstractJointEffort, AbstractJointMotion, AbstractBodyForce,
    AbstractStrut, AbstractSection, AbstractDrawnError, AbstractMarkerError, AbstractSpringError,
)  # fmt: skip


def left_out(model: Model) -> Iterator[str]:
    """A sentence per effect that is handed on in part or not at all."""
    for placed in model.effects:
        for row, id_ in enumerate(placed.ids):
            if _absent(placed, row):
                continue
            effect = jax.tree.map(lambda leaf, r=row: leaf[r], placed.effect)
            if sentence := _sentence(effect):
                yield f"effect '{id_}' ({effect.kind}{_where(model, placed, row)}): {sentence}"


def _where(model: Model, placed: Placed, row: int) -> str:
    """The joints or bodies at which a row acts, in words."""
    if placed.effect.acts_on not in ("joint", "body", "bodies"):
        return ""
    topology = model.topology
    bodies = topology.body_ids + topology.fixed_ids
    names = topology.joint_ids if placed.effect.acts_on == "joint" else [str(id_) for id_ in bodies]
    on = [names[i] for r, place in zip(placed.rows, placed.places, strict=True) if r == row for i in place]
    shown = on if len(on) < MANY else [*on[: MANY - 2], f"{len(on) - MANY + 2} more"]
    return f" at {', '.join(shown)}"


def _held_stiffly(effect: AbstractRub) -> str:
    return "that it gives before it slides is left out" if float(effect.presliding() + effect.onset()) > 0.0 else ""


def _sentence(effect: AbstractEffect) -> str:
    """What of an effect stays behind; empty where nothing does."""
    if isinstance(effect, AbstractJointClearance):
        return "the pin sits tight in its hole"
    if isinstance(effect, AbstractDryFriction):
        unloaded, loaded = (float(effect.limit(jnp.asarray(load), jnp.ones(()))) for load in (0.0, 1.0))
        return "friction that grows with the load is left out" if loaded != unloaded else _held_stiffly(effect)
    if isinstance(effect, AbstractRateFriction):
        return "friction keeps its sliding level at every speed, without the rise at rest"
    if isinstance(effect, AbstractJointStop):
        wall = effect.wall()
        soft = float(wall.give) > HARD
        return "how its ends give and throw a body back is left out" if soft or float(wall.restitution) > 0.0 else ""
    if isinstance(effect, AbstractDrag):
        return "drag of the air is left out"
    if isinstance(effect, AbstractBedFriction):
        return "friction on the bed is left out"
    if isinstance(effect, AbstractLinkContact):
        return "links pass through each other"
    if isinstance(effect, AbstractPush):
        return "it starts from rest"
    if isinstance(effect, AbstractBaseMotion):
        return "its base stands still"
    if isinstance(effect, AbstractView | AbstractShutter | AbstractClock | AbstractHold):
        return "it belongs to the measurement, not to the mechanism"
    return "" if isinstance(effect, WHOLE) else "it has no counterpart"


def unsimulated_limits(mechanism: Mechanism) -> Iterator[str]:
    """Limits of the drawing bound nothing in the twin, so they bound nothing in its copies."""
    for joint in mechanism.joints:
        if joint.limits is not None and joint.type not in WITHOUT_COORDINATE:
            yield f"joint '{joint.id}': its drawn limits stop nothing, as in the twin; a joint_stop effect does"


def _absent(placed: Placed, row: int) -> bool:
    """Whether an effect does nothing: every size it has is zero, no end of travel is within reach."""
    if isinstance(placed.effect, AbstractJointStop):
        stop = jax.tree.map(lambda leaf: leaf[row], placed.effect)
        return all(abs(float(end)) > NO_STOP for end in stop.ends())
    declared = placed.effect.declarations().items()
    sizes = [n for n, d in declared if d.default == 0.0 or (d.size == 1 and d.lower == 0.0)]
    return all(not np.any(getattr(placed.effect, n)[row]) for n in sizes)
