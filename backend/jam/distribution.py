"""How the values of a drawing scatter: `KIND:ON.PARAMETER=normal(MEAN,SD)`, cut off where the parameter ends.

Where comes from the grammar of `backend.fit.free`: `*` draws every place on its own, `all` and `a+b` draw one value
that the places share.  Values are SI, as in the drawing.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy import stats

from backend.fit.free import FreeParameter, free_parameters
from backend.mechanism.effect import Effect, kind_named
from backend.mechanism.mechanism import Mechanism

GRAMMAR = (
    "Write KIND:ON.PARAMETER=normal(MEAN,SD), uniform(LOW,HIGH) or lognormal(MEDIAN,FACTOR), "
    "such as pin_friction:crank.friction_coefficient=normal(0.1,0.02)"
)
LEAST_WITHIN = 0.01  # weight within the bounds: with less, the words and the sampled values have little in common


@dataclass(frozen=True)
class Truncated:
    """A distribution of scipy.stats, given that the value lies within bounds."""

    whole: Any
    lower: float
    upper: float

    @property
    def within(self) -> float:
        """Share of the whole distribution between the bounds."""
        return float(self.whole.cdf(self.upper) - self.whole.cdf(self.lower))

    def ppf(self, share: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        """The value below which a share of the samples lies."""
        value = self.whole.ppf(self.whole.cdf(self.lower) + np.asarray(share) * self.within)
        return np.clip(value, self.lower, self.upper)  # rounding in the tails


@dataclass(frozen=True)
class Varied:
    """One number that scatters, and how: `written` as it was asked for, such as `normal(0.1,0.02)`."""

    parameter: FreeParameter
    distribution: Truncated
    written: str


def varied(mechanism: Mechanism, specs: Sequence[str]) -> tuple[tuple[Varied, ...], tuple[Effect, ...]]:
    """What the specs vary, and the effects that the model needs beside those drawn.

    Raises ValueError with the part, the number and the remedy.
    """
    found: dict[str, Varied] = {}
    for spec in specs:
        place, equals, written = (part.strip() for part in spec.partition("="))
        if not equals:
            raise ValueError(f"--vary {spec}: no distribution is given. {GRAMMAR}.")
        whole = _distribution(spec, written)
        for parameter in _parameters(mechanism, place, spec):
            if parameter.name in found:
                raise ValueError(f"--vary {spec}: {parameter.name} is varied twice. Leave one of them out.")
            found[parameter.name] = Varied(parameter, _cut(spec, parameter, whole), written)
    if not found:
        raise ValueError(f"nothing is varied: name what scatters with --vary. {GRAMMAR}.")
    # All at once: the same number under two names is refused, and an effect that several need is added once.
    freedom = free_parameters(mechanism, list(found), option="--vary")
    return tuple(found.values()), freedom.added


def _parameters(mechanism: Mechanism, place: str, spec: str) -> tuple[FreeParameter, ...]:
    if "," in place:
        raise ValueError(f"--vary {spec}: one place at a time. Repeat --vary for {place.partition(',')[2].strip()}.")
    parameters = free_parameters(mechanism, [place], option="--vary").parameters
    if len(names := sorted({p.parameter for p in parameters})) > 1:
        raise ValueError(f"--vary {spec}: it has {', '.join(names)}. Name one of them, such as {place}.{names[0]}=...")
    for parameter in parameters:
        if (seen_by := kind_named(parameter.kind).acts_on) in ("camera", "marker"):
            raise ValueError(f"--vary {spec}: the {seen_by} moves no part of a mechanism. Leave it out.")
    return parameters


def _distribution(spec: str, written: str) -> Any:
    shape = re.fullmatch(r"(\w+)\s*\(([^(),]*),([^(),]*)\)", written)
    if not shape or shape[1] not in SHAPES:
        raise ValueError(f"--vary {spec}: {written!r} is no distribution that is known. {GRAMMAR}.")
    try:
        first, second = float(shape[2]), float(shape[3])
    except ValueError:
        raise ValueError(f"--vary {spec}: {written!r} does not hold two numbers. {GRAMMAR}.") from None
    if not (math.isfinite(first) and math.isfinite(second)):
        raise ValueError(f"--vary {spec}: {written!r} is not finite. {GRAMMAR}.")
    try:
        return SHAPES[shape[1]](first, second)
    except ValueError as error:
        raise ValueError(f"--vary {spec}: {error}.") from None


def _normal(mean: float, sd: float) -> Any:
    if sd <= 0.0:
        raise ValueError(f"a standard deviation of {sd:g} does not scatter; give one above 0")
    return stats.norm(mean, sd)


def _uniform(low: float, high: float) -> Any:
    if not low < high:
        raise ValueError(f"nothing lies between {low:g} and {high:g}; give the lower end first")
    return stats.uniform(low, high - low)


def _lognormal(median: float, factor: float) -> Any:
    if median <= 0.0 or factor <= 1.0:
        raise ValueError(
            f"a median of {median:g} with a factor of {factor:g} does not scatter; give a median above 0 and a factor "
            "above 1: 68% of the samples lie between MEDIAN / FACTOR and MEDIAN x FACTOR"
        )
    return stats.lognorm(math.log(factor), scale=median)


SHAPES: dict[str, Callable[[float, float], Any]] = {"normal": _normal, "uniform": _uniform, "lognormal": _lognormal}


def _cut(spec: str, parameter: FreeParameter, whole: Any) -> Truncated:
    cut = Truncated(whole, parameter.lower, parameter.upper)
    if cut.within < LEAST_WITHIN:
        raise ValueError(
            f"--vary {spec}: {parameter.name} is from {parameter.lower:g} to {parameter.upper:g} {parameter.unit}, "
            f"where {100 * cut.within:.2g}% of that distribution is. Give it in SI units, within these bounds."
        )
    return cut
