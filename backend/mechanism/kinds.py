"""The vocabulary of effects: which kinds there are, where they act, and what their parameters may be.

`effect_kinds.json` is generated from the effects' own declarations: it is data, so that reading a drawing loads no
solver.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any, get_args

from backend.mechanism.joint import WITHOUT_COORDINATE, JointType


@dataclass(frozen=True)
class ParameterSpec:
    """One declared parameter: unit, default, bounds (None is open), number of entries, meaning.

    joint_types: the joint types where the name is the right one; None when every type with a coordinate will do.
    drawn: method of a joint's Fit that gives the value where none is written.  by_name: a fit frees it only by name.
    at_least: another parameter that must not be larger.  expected: sd before any data, in natural sizes.
    """

    name: str
    unit: str
    default: float | tuple[float, ...] | None
    lower: float | None
    upper: float | None
    size: int
    doc: str
    joint_types: tuple[str, ...] | None
    drawn: str | None = None
    by_name: bool = False
    at_least: str | None = None
    expected: float | None = None

    @property
    def is_direction(self) -> bool:
        """Whether it is a vector of which only the direction counts, and which must be given."""
        return (self.unit, self.size, self.default) == ("1", 3, None)

    def suits(self, joint_type: str) -> bool:
        """Whether this parameter means something at a joint of that type."""
        if self.joint_types is None:
            return joint_type not in WITHOUT_COORDINATE
        return joint_type in self.joint_types


@dataclass(frozen=True)
class EffectKind:
    """A kind of effect. acts_on: joint, body, bodies, effect, marker, world or camera."""

    name: str
    acts_on: str
    doc: str
    parameters: dict[str, ParameterSpec]
    choices: dict[str, tuple[str, ...]]
    """Words that decide its structure, by name: the options, the default first."""
    amends: tuple[str, ...] = ()
    """Kinds of the effects that it can stand on."""

    @property
    def names_joints(self) -> bool:
        """Whether it may stand on joints: always, or where it acts on the world and the joints are named."""
        joints = any(spec.joint_types for spec in self.parameters.values())
        return self.acts_on == "joint" or (self.acts_on == "world" and joints)

    def suits(self, joint_type: str) -> bool:
        """Whether any of its parameters means something at a joint of that type."""
        return any(spec.suits(joint_type) for spec in self.parameters.values())

    def joint_types(self) -> str:
        """The joint types it acts at, as words."""
        types = {name for name in get_args(JointType) if any(spec.suits(name) for spec in self.parameters.values())}
        return ", ".join(sorted(types)) + " joints"


def _parameter(name: str, spec: dict[str, Any]) -> ParameterSpec:
    default, joint_types = spec.get("default"), spec.get("joint_types")
    return ParameterSpec(
        name=name,
        unit=spec.get("unit") or "1",
        default=tuple(default) if isinstance(default, list) else default,
        lower=spec.get("lower"),
        upper=spec.get("upper"),
        size=spec.get("size") or 1,
        doc=spec.get("doc", ""),
        joint_types=tuple(joint_types) if joint_types else None,
        drawn=spec.get("drawn"),
        by_name=spec.get("by_name", False),
        at_least=spec.get("at_least"),
        expected=spec.get("expected"),
    )


@cache
def effect_kinds() -> dict[str, EffectKind]:
    """All kinds by name."""
    text = (resources.files("backend.mechanism") / "effect_kinds.json").read_text("utf-8")
    return {name: _kind(name, entry) for name, entry in sorted(json.loads(text).items())}


def _kind(name: str, entry: dict[str, Any]) -> EffectKind:
    parameters = {key: _parameter(key, spec) for key, spec in entry["parameters"].items()}
    choices = {key: tuple(spec["options"]) for key, spec in entry["choices"].items()}
    return EffectKind(name, entry["acts_on"], entry["doc"], parameters, choices, tuple(entry["amends"] or ()))
