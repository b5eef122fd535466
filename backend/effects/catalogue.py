"""The effects that can be simulated, found by looking in this folder."""

import importlib
import inspect
import pkgutil
from functools import cache
from typing import Any

import backend.effects
from backend.effects.effect import AbstractEffect
from backend.effects.shapes import AbstractSpringError

NOT_EFFECTS = {"effect", "shapes", "catalogue", "__main__"}


@cache
def catalogue() -> dict[str, type[AbstractEffect]]:
    """Kind -> its class, for every effect file of this room, in alphabetical order."""
    names = sorted(m.name for m in pkgutil.iter_modules(backend.effects.__path__) if m.name not in NOT_EFFECTS)
    return {name: _effect_in(name) for name in names}


def effect_of_kind(kind: str) -> type[AbstractEffect]:
    """The class of an effect.  Raises ValueError naming the kinds that can be simulated."""
    known = catalogue()
    if kind not in known:
        raise ValueError(f"effect '{kind}' cannot be simulated yet; simulated kinds: {', '.join(known)}")
    return known[kind]


def vocabulary() -> dict[str, Any]:
    """What the effect files declare, as plain data for those who read drawings without JAX."""
    return {
        kind: {
            "acts_on": effect.acts_on,
            "doc": inspect.cleandoc(effect.__doc__ or "").splitlines()[0],
            "parameters": {
                name: {
                    "unit": declared.unit,
                    "default": declared.default,
                    "lower": declared.lower,
                    "upper": declared.upper,
                    "size": declared.size,
                    "doc": declared.doc,
                    "joint_types": list(declared.joint_types) if declared.joint_types else None,
                    "drawn": declared.drawn,
                    "by_name": declared.by_name,
                    "at_least": declared.at_least,
                    "expected": declared.expected,
                }
                for name, declared in effect.declarations().items()
            },
            "amends": list(effect.amends) if issubclass(effect, AbstractSpringError) else None,
            "choices": {name: {"options": list(c.options), "doc": c.doc} for name, c in effect.choices().items()},
        }
        for kind, effect in catalogue().items()
        if kind != "gravity"  # a drawing gives it as gravity_m_per_s2
    }


def _effect_in(name: str) -> type[AbstractEffect]:
    module = importlib.import_module(f"backend.effects.{name}")
    (effect,) = [
        member
        for _, member in inspect.getmembers(module, inspect.isclass)
        if issubclass(member, AbstractEffect) and member.__module__ == module.__name__
    ]
    if effect.kind != name:
        raise TypeError(f"backend/effects/{name}.py holds an effect of kind '{effect.kind}': name the file after it")
    return effect
