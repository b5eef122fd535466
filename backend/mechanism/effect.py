"""A physical effect that stands in the drawing, and the check against the vocabulary of kinds."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from backend.mechanism.drawing_error import known
from backend.mechanism.kinds import EffectKind, ParameterSpec, effect_kinds
from backend.mechanism.part import Id, Part

MOST_PLACES = 20_000
TURN_AND_SLIDE = ("cylindrical", "planar")
SHORTEST = 1e-100  # of a direction: the squares of shorter ones underflow


def shortened(value: Any) -> str:
    """A value in a sentence, which would else be as long as what was sent."""
    said = repr(value)
    return said if len(said) <= 300 else f"{said[:300]} ..."


def _places(on: Any) -> Any:
    if on == "all":
        return on
    if not isinstance(on, list | tuple) or not on or not all(isinstance(place, str) and place for place in on):
        raise ValueError(f'on is {shortened(on)}; write "all", or a list of ids such as ["j1"]')
    if len(on) > MOST_PLACES:
        raise ValueError(f'on has {len(on)} names, above the limit of {MOST_PLACES}; write "all"')
    if len(set(on)) < len(on):
        raise ValueError(f"on names a part twice ({', '.join(on)[:300]}); name each once")
    return tuple(on)


def _value(value: Any) -> Any:
    if isinstance(value, str):
        return value
    numbers = value if isinstance(value, list | tuple) else [value]
    if not all(isinstance(number, int | float) and not isinstance(number, bool) for number in numbers):
        raise ValueError(f"is {value!r}; write a number or a list of numbers")
    try:
        numbers = tuple(map(float, numbers))
    except OverflowError:
        raise ValueError(f"has {len(str(value))} digits; write a number below 1e308") from None
    if not all(map(math.isfinite, numbers)):
        raise ValueError(f"is {value!r}; every number must be finite")
    return numbers if isinstance(value, list | tuple) else numbers[0]


Places = Annotated[tuple[str, ...] | Literal["all"], BeforeValidator(_places)]
ParameterValue = Annotated[float | tuple[float, ...] | str, BeforeValidator(_value)]


class Effect(Part):
    """An effect that the baseline model already includes.

    on: ids of joints, bodies, markers or effects, ["world"], ["camera"], or "all" that the kind applies to.
    parameters: by name, in the unit spelled in the name; what is left out keeps the kind's default.
    """

    id: Id
    kind: Id
    on: Places
    parameters: dict[str, ParameterValue] = Field(default_factory=dict)


def kind_named(kind: str) -> EffectKind:
    """The declared kind; ValueError with a remedy when there is none of that name."""
    if kind == "gravity":
        raise ValueError('kind "gravity" is not an effect in the file; set the field gravity_m_per_s2 of the mechanism')
    kinds = effect_kinds()
    if kind not in kinds:
        raise ValueError(f'kind "{kind}" is unknown. {known(kinds, kind)}')
    return kinds[kind]


def value_fault(spec: ParameterSpec, value: float | tuple[float, ...] | str) -> str | None:
    """Why `value` cannot be this parameter: wrong size or outside its bounds; None when it can."""
    if isinstance(value, str):
        return f'{spec.name} is "{value}"; write a number in {spec.unit}'
    numbers = value if isinstance(value, tuple) else (value,)
    if isinstance(value, tuple) != (spec.size > 1) or len(numbers) != spec.size:
        found = f"a list of {len(numbers)}" if isinstance(value, tuple) else "one number"
        wanted = f"a list of {spec.size} numbers" if spec.size > 1 else "one number"
        return f"{spec.name} is {found}; write {wanted} in {spec.unit}"
    for number in numbers:
        if spec.lower is not None and number < spec.lower:
            return f"{spec.name} is {number:g} {spec.unit}, below its lower bound {spec.lower:g}; raise it"
        if spec.upper is not None and number > spec.upper:
            return f"{spec.name} is {number:g} {spec.unit}, above its upper bound {spec.upper:g}; lower it"
    if spec.is_direction and not SHORTEST <= (length := math.hypot(*numbers)) <= 1.0 / SHORTEST:
        return f"{spec.name} has length {length:g} and points nowhere; give a vector such as [0, 0, 1]"
    return None


def parameter_faults(
    kind: EffectKind, parameters: Mapping[str, Any], joints: Mapping[str, str] | None, every: bool = False
) -> list[str]:
    """What is wrong with the parameters of an effect.

    joints: id -> type of the joints it stands at, None when the kind does not act at joints.
    every: "on" was "all", so that a joint to which no parameter applies is passed over.
    """
    faults = []
    specs: list[ParameterSpec] = []
    for name, value in parameters.items():
        if name in kind.choices:
            if value not in kind.choices[name]:
                faults.append(f"{name} is {value!r}; write {' or '.join(map(repr, kind.choices[name]))}")
            continue
        spec = kind.parameters.get(name)
        if spec is None:
            there = known([*kind.parameters, *kind.choices], name)
            faults.append(f'parameter "{name}" is unknown to {kind.name}. {there}')
            continue
        specs.append(spec)
        if fault := value_fault(spec, value):
            faults.append(fault)
    lower, upper = parameters.get("lower"), parameters.get("upper")
    if not faults and lower is not None and upper is not None and lower > upper:
        faults.append(f"lower {lower:g} is above upper {upper:g}; swap them")
    if joints:
        faults += joint_type_faults(kind, specs, joints, every)
    return faults


def order_faults(kind: EffectKind, parameters: Mapping[str, Any]) -> list[str]:
    """Sentences about parameters that stand below another one that they must reach."""
    faults = []
    for spec in kind.parameters.values():
        other = kind.parameters[spec.at_least] if spec.at_least else None
        if other is None:
            continue
        value, least = (parameters.get(s.name, s.default) for s in (spec, other))
        if value < least:
            faults.append(
                f"{spec.name} is {value:g} {spec.unit}, below {other.name}, which is {least:g}; "
                f"swap them, or raise {spec.name}"
            )
    return faults


def joint_type_faults(
    kind: EffectKind, given: list[ParameterSpec], joints: Mapping[str, str], every: bool
) -> list[str]:
    """What of some parameters means nothing at these joints (id -> type)."""
    faults = []
    for spec in given:
        if not any(spec.suits(joint_type) for joint_type in joints.values()):
            joint_id, joint_type = next(iter(joints.items()))
            others = [other.name for other in kind.parameters.values() if other.suits(joint_type)]
            remedy = f"use {' or '.join(others)}" if others else f"{kind.name} does not act there: remove it"
            faults.append(_unsuited(spec, joint_id, joint_type, remedy))
    if faults or every:
        return faults
    bound = [spec for spec in given if spec.joint_types is not None]
    for joint_id, joint_type in joints.items():
        if not any(spec.suits(joint_type) for spec in kind.parameters.values()):
            where = kind.joint_types()
            faults.append(f'{kind.name} does not act at joint "{joint_id}", which is {joint_type}; it acts at {where}')
        elif bound and not any(spec.suits(joint_type) for spec in given):
            others = [spec.name for spec in kind.parameters.values() if spec.suits(joint_type)]
            remedy = f"give it its own effect with {' or '.join(others)}"
            faults.append(_unsuited(bound[0], joint_id, joint_type, remedy))
    return faults


def _unsuited(spec: ParameterSpec, joint_id: str, joint_type: str, remedy: str) -> str:
    """A parameter that means nothing at a joint; a joint that slides as well as it turns takes effects on its turn."""
    slides = joint_type in TURN_AND_SLIDE and spec.suits("prismatic")
    why = f" and whose slides nothing can act along, only its turn: {remedy}" if slides else f"; {remedy}"
    return f'{spec.name} does not suit joint "{joint_id}", which is {joint_type}{why}'


def missing_parameters(kind: EffectKind, parameters: Mapping[str, Any], unfitted: str | None = None) -> list[str]:
    """Sentences about parameters without a default that were not given.

    unfitted: a joint of the effect whose fit does not tell its play, None where all of them do.
    """
    faults = []
    for spec in kind.parameters.values():
        if spec.default is not None or spec.name in parameters:
            continue
        remedy = f"give it in {spec.unit}"
        if spec.drawn:
            if unfitted is None:
                continue
            remedy += f', or draw joint "{unfitted}" with fit.radial_clearance_m'
        faults.append(f"{spec.name} is missing ({spec.doc}); {remedy}")
    return faults
