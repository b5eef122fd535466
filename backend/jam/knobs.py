"""The knobs of a counterfactual: the same drawing with its drives, its friction or its play scaled.

What a knob turns is read off each effect's shape and the units it declared, never off its name.  Only values change,
so that every counterfactual runs in the program that was compiled for the drawing itself.
"""

from collections.abc import Iterator, Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from backend.effects.effect import AbstractEffect, Declaration
from backend.effects.gravity import Gravity
from backend.effects.shapes import (
    AbstractBedFriction,
    AbstractBodyForce,
    AbstractDryFriction,
    AbstractJointClearance,
    AbstractJointEffort,
    AbstractLinkContact,
    AbstractRateFriction,
    AbstractStrut,
)
from backend.model.model import Address, Model

FORCE_UNITS = ("N", "N m", "N/m", "N m/rad")
"""What a drive's force is in proportion to."""
FRICTION_UNITS = ("1", "N", "N m")
"""What a dry friction's limit is in proportion to; a rate over which it falls is none of them."""
RUB, PLAY = "friction_coefficient", "radial_m"

DRIVES = (AbstractBodyForce, AbstractStrut, AbstractJointEffort)
FRICTIONS = (AbstractDryFriction, AbstractRateFriction, AbstractBedFriction)
CONTACTS = (AbstractJointClearance, AbstractLinkContact)


def is_drive(effect: AbstractEffect, declared: Declaration) -> bool:
    """Springs, applied forces and torques, efforts at joints; not weight, not damping, not prescribed motion."""
    return isinstance(effect, DRIVES) and not isinstance(effect, Gravity) and declared.unit in FORCE_UNITS


def is_friction(effect: AbstractEffect, name: str, declared: Declaration) -> bool:
    """Every coefficient or limit of dry friction, at joints, on the bed and where parts touch."""
    return (isinstance(effect, FRICTIONS) and declared.unit in FRICTION_UNITS) or (
        isinstance(effect, CONTACTS) and name == RUB
    )


def is_play(effect: AbstractEffect, name: str) -> bool:
    """How far a pin can move in its hole."""
    return isinstance(effect, AbstractJointClearance) and name == PLAY


def scaled(
    model: Model,
    drive: float = 1.0,
    friction: float = 1.0,
    play: float = 1.0,
    only: Sequence[Address] | None = None,
    gravity: bool = False,
) -> Model:
    """The model with its drives, friction and play times these factors.

    only: plays that change; all by default.  gravity: whether weight is the drive, where nothing else drives.
    """
    values = {}
    for effect, address, name, declared, value in _parameters(model):
        if is_drive(effect, declared) and drive != 1.0:
            values[address] = jnp.asarray(drive * value)
        elif is_friction(effect, name, declared) and friction != 1.0:
            values[address] = jnp.asarray(friction * value)
        elif is_play(effect, name) and play != 1.0 and (only is None or address in only):
            values[address] = jnp.asarray(play * value)
    changed = model.with_parameters(values)
    if gravity and drive != 1.0:
        changed = eqx.tree_at(lambda m: m.drawing, changed, model.drawing.with_gravity(drive * model.drawing.gravity))
    return changed


def driven(model: Model) -> bool:
    """Whether anything but weight drives."""
    return any(is_drive(effect, declared) and np.any(value) for effect, _, _, declared, value in _parameters(model))


def has_friction(model: Model) -> bool:
    """Whether any dry friction is not zero."""
    return any(is_friction(effect, name, d) and np.any(value) for effect, _, name, d, value in _parameters(model))


def frictions(model: Model) -> tuple[Address, ...]:
    """Every coefficient or limit of dry friction."""
    return tuple(a for effect, a, name, declared, _ in _parameters(model) if is_friction(effect, name, declared))


def plays(model: Model) -> tuple[Address, ...]:
    """Every play that is not zero."""
    return tuple(a for effect, a, name, _, value in _parameters(model) if is_play(effect, name) and np.any(value))


def _parameters(model: Model) -> Iterator[tuple[AbstractEffect, Address, str, Declaration, np.ndarray]]:
    for placed in model.effects:
        for name, declared in placed.effect.declarations().items():
            leaf = np.asarray(getattr(placed.effect, name))
            for row, id_ in enumerate(placed.ids):
                yield placed.effect, (id_, name), name, declared, leaf[row]
