"""Places, causes and amounts of a gap in the words of an engineer."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from backend.mechanism.gap_names import acting
from backend.mechanism.gap_report import Amount, CauseEffect, CauseSet, Detectable, EffectNumber, NextExperiment
from backend.report.evidence import Channel
from backend.report.quantity import measured, prefixed, shown

MEANING = {
    "none": ("no gap", "What was measured differs from the drawing by no more than its noise."),
    "identified": ("cause identified", "One explanation fits, here and where it was not fitted; the others do not."),
    "ambiguous": ("ambiguous", "Several explanations fit equally well. The next experiment would tell them apart."),
    "approximate": ("approximate", "The best explanation takes away most of the gap, but its form is not quite right."),
    "unknown": ("unknown cause", "There is a gap, and nothing in the library of effects explains it."),
}
"""Verdict -> (badge, what it means)."""

MOST_NAMED = 4
TOLD_APART = 9.0  # squared sd between two predictions
UNITS = ("n", "m", "m2", "kg", "s", "s2", "rad", "hz", "relative")


def effect_name(effect: CauseEffect | Detectable) -> str:
    """What acts, and where."""
    return acting(effect.kind, _first([effect.on] if isinstance(effect.on, str) else list(effect.on)))


def _first(on: Sequence[str]) -> str:
    return ", ".join(on[:MOST_NAMED]) + (f" and {len(on) - MOST_NAMED} more" if len(on) > MOST_NAMED else "")


def cause_name(cause: CauseSet) -> str:
    """All effects of one explanation."""
    return " and ".join(effect_name(e) for e in cause.effects)


def alike(cause: CauseSet) -> list[str]:
    """What the data cannot tell it from, kind by kind."""
    places: dict[str, list[str]] = {}
    for kind, at in cause.indistinguishable_from:
        together = f"all but {at[4:]}" if at.startswith("all-") else at
        places.setdefault(kind.replace("_", " "), []).append("all at once" if at == "all" else together)
    return [acting(kind, _either(ats)) for kind, ats in places.items()]


def inseparable_name(group: Sequence[EffectNumber]) -> str:
    """What a group of inseparable effects is, kind by kind with its places."""
    places: dict[str, list[str]] = {}
    for e in group:
        what = parameter_name(e.parameter)
        name = f"{e.kind.replace('_', ' ')}{f' ({what})' if what else ''}"
        places.setdefault(name, []).append(e.on if isinstance(e.on, str) else e.on[0])
    return "; ".join(acting(name, _first(on)) for name, on in places.items())


def _either(names: Sequence[str]) -> str:
    return f"{', '.join(names[:-1])} or {names[-1]}" if len(names) > 1 else names[0]


def percent(p: float) -> str:
    """A probability as a percentage that never claims certainty.

    >>> percent(0.9996), percent(0.123), percent(0.0001)
    ('> 99%', '12%', '< 1%')
    """
    if p > 0.99:
        return "> 99%"
    return f"{100 * p:.0f}%" if p >= 0.01 else "< 1%"


def amount(a: Amount) -> str:
    """A value with the half-width of its 95% interval, in a unit of its size."""
    unit, factor = prefixed(max(abs(a.value), a.sd or 0.0), a.unit)
    if a.sd is None or not np.isfinite(a.sd):
        return f"{shown(factor * a.value)} {unit}"
    half = shown(1.96 * factor * a.sd, 2)
    return f"{measured(factor * a.value, 1.96 * factor * a.sd)} ± {half} {unit}"


def least(d: Detectable) -> str:
    """The smallest amount that could have been seen, in a unit of its size."""
    unit, factor = prefixed(d.minimum, d.unit)
    return f"{shown(factor * d.minimum, 2)} {unit}"


def parameter_name(name: str) -> str:
    """The name without the unit that files put at its end; empty where it says no more than the unit does.

    >>> parameter_name("friction_torque_n_m"), parameter_name("offset_m[0]"), parameter_name("damping_n_m_s_per_rad")
    ('friction torque', 'offset x', 'damping')
    >>> parameter_name("kg_m2"), parameter_name("x_m_per_s"), parameter_name("relative")
    ('', 'x', '')
    """
    stem, bracket, index = name.partition("[")
    words = stem.split("_per_")[0].split("_")
    while words and words[-1] in UNITS:
        words.pop()
    axis = "xyz"[int(index[:-1])] if index[:-1] in ("0", "1", "2") else bracket + index
    return " ".join([*words, *([axis] if axis else [])])


def amounts(effect: CauseEffect) -> str:
    """All numbers of one effect."""
    return ", ".join(f"{parameter_name(name)} {amount(a)}".strip() for name, a in effect.parameters.items())


def next_sentence(following: NextExperiment | None) -> str:
    """What to do next and what it would decide."""
    if following is None:
        return ""
    said = following.do[:1].upper() + following.do[1:].rstrip(".") + "."
    pairs = [" from ".join(part.replace("_", " ") for part in pair) for pair in following.separates if len(pair) == 2]
    if not pairs:
        return said
    told = "; ".join(pairs)
    if following.expected_d2 is None:
        return f"{said} This is to tell {told}."
    apart = shown(float(np.sqrt(following.expected_d2)), 2)
    if following.expected_d2 < TOLD_APART:
        return f"{said} Another release alone would not tell {told}: at best {apart} sd apart."
    return f"{said} This is to tell {told}: their predictions would then lie {apart} sd apart."


def worst_first(every: Sequence[Sequence[Channel]]) -> tuple[Channel, ...]:
    """Channels of the experiment that is explained worst, in sigmas; first those that the drawing misses most."""
    if not any(every):
        return ()
    worst = max((channels for channels in every if channels), key=lambda cs: np.mean([_miss(c, c.after) for c in cs]))
    return tuple(sorted(worst, key=lambda c: -_miss(c, c.after if c.before is None else c.before)))


def _miss(channel: Channel, of: np.ndarray) -> float:
    """Rms in sigmas over what the motion was not lost for; a motion that was lost altogether misses most."""
    seen = np.isfinite(channel.measured - of)
    if not seen.any():
        return np.inf
    return float(np.sqrt(np.mean((channel.measured - of)[seen] ** 2))) / (channel.sigma or 1.0)
