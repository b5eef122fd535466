"""gap.json from what was found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from backend.diagnose.adequacy import scaled
from backend.diagnose.belief import Belief
from backend.diagnose.candidate import Candidate
from backend.diagnose.cause import Cause
from backend.diagnose.fitted import Fitted
from backend.diagnose.inseparable import inseparable
from backend.diagnose.screen import Screen
from backend.diagnose.shrink import Shrinkage, gap_unit
from backend.diagnose.subject import Subject
from backend.diagnose.where import Trace, joint_gaps, locations, marker_gaps
from backend.diagnose.wrong_form import deviations, deviations_of_noise
from backend.fit.guess import guesses
from backend.mechanism.gap_names import acting, place_name
from backend.mechanism.gap_report import (
    Amount,
    CauseEffect,
    CauseSet,
    Detectable,
    EffectNumber,
    GapReport,
    HeldOut,
    Location,
    NextExperiment,
    Remainder,
    Shrink,
    Verdict,
    Where,
)

WORTH_A_WORD = 0.05  # probability of what the sentence mentions besides the verdict
MOST_CAUSES = 12  # those that the data leave standing are listed however many they are


def make_report(
    verdict: Verdict,
    subject: Subject,
    baseline: Cause,
    best: Cause,
    enough: bool,
    belief: Belief,
    about: Screen,
    aliases: Mapping[tuple[str, ...], list[list[str]]],
    model_free: Mapping[str, float],
    missing: Trace | None,
    shrunk: Shrinkage | None,
    scale: float,
    softness: float,
    p: float,
    following: NextExperiment | None,
    warnings: Sequence[str],
    tolerance_m: float | None,
    wall_s: float,
    tried: Mapping[tuple[str, ...], Cause],
) -> GapReport:
    """Everything that was found, in the words of the file format. enough: whether the best cause leaves noise alone.
    tried: all sets that were fitted, by their names.
    """
    none, unknown = _chances(verdict, enough, belief, shrunk)
    reported = set(belief.reported)
    listed = belief.causes[: max([MOST_CAUSES, *(i + 1 for i in reported)])]
    shown = _shares(belief, len(listed), 1.0 - none - unknown)
    standing = {i for i in reported if i < MOST_CAUSES} if verdict != "none" else set()
    sds = [_deviations(c, i in standing, scale, softness) for i, c in enumerate(listed)]
    causes = [
        CauseSet(
            effects=_effects(c, sds[i]), probability=float(q), log_evidence=float(c.log_z),
            indistinguishable_from=list(aliases.get(c.names, [])),
            adequate=verdict in ("identified", "ambiguous") and i in reported,
        )
        for i, (c, q) in enumerate(zip(listed, shown, strict=True))
    ]  # fmt: skip
    if not causes and verdict != "none":
        none, unknown = 0.0, 1.0
    weighed = Belief(tuple(listed), shown, belief.log_z[: len(listed)], none, unknown)
    places = locations(weighed, model_free)
    unit = gap_unit(subject.fit if shrunk is None else subject.held_out)
    fitted_gap = _fit_remainder(subject, baseline, best, scale, unit)
    named = listed and verdict not in ("none", "unknown")
    ladder = _ladder(subject, baseline, listed[0], tried, scale) if named else ""
    return GapReport(
        verdict=verdict,
        sentence=_sentence(verdict, enough, causes, places, shrunk, len(reported), none, unknown) + ladder,
        where=Where(
            locations=places,
            phases=missing.phases() if missing and verdict != "none" else [],
            markers=marker_gaps(subject, baseline.fitted, scale),
            joints=joint_gaps(subject, baseline.fitted, scale),
            model_free=[Location(at=k, probability=v) for k, v in sorted(model_free.items(), key=lambda x: -x[1])],
        ),
        causes=causes,
        probability_none=none,
        probability_unknown=unknown,
        p_value=p,
        shrink=Shrink(held_out=_held_out(shrunk), fit=fitted_gap, unit=unit),
        detectable=_detectable(subject, about, scale),
        inseparable=[
            [EffectNumber(kind=c.kind, on=tuple(c.on), parameter=p.parameter) for c, p in group]
            for group in inseparable(about, scale)
        ],
        next_experiment=following,
        warnings=list(warnings),
        tolerance_m=tolerance_m,
        wall_s=wall_s,
    )


MOST = 0.5  # of a gap: a member of a set that alone explains so much is said to
ALMOST_ALL = 0.999  # of a gap: what comes after is not told
APPROXIMATE_UNKNOWN = (0.3, 0.5)
"""What is missing besides a form that removes most of the gap: the less of one that removes almost all. Of fifteen sets
that sealed studies of a clear gap were answered so with, three were what was amiss, and in nine it was nothing that the
library had.
"""
AT_LEAST_UNKNOWN = 0.9


def _chances(verdict: Verdict, enough: bool, belief: Belief, shrunk: Shrinkage | None) -> tuple[float, float]:
    """Probability of none and of unknown."""
    if verdict == "none":
        none = max(belief.none, 0.5)
        return none, belief.unknown * (1.0 - none) / max(1.0 - belief.none, 1e-12)
    if verdict == "unknown":
        return 0.0, belief.unknown if enough else max(belief.unknown, AT_LEAST_UNKNOWN)
    if verdict == "approximate":
        least, most = APPROXIMATE_UNKNOWN
        nearly_all = shrunk is not None and shrunk.explained is not None and shrunk.explained > ALMOST_ALL
        return 0.0, float(np.clip(belief.unknown, least, least if nearly_all else most))
    return min(belief.none, 0.5), max(belief.unknown, 0.005)


def _shares(belief: Belief, count: int, left: float) -> Float[np.ndarray, " count"]:
    """Probabilities of the first causes, which share what is left."""
    shares = belief.probability[:count]
    if not np.any(shares):  # what is unknown is the likelier by more than a float holds
        shares = np.exp(belief.log_z[:count] - belief.log_z[:1])
    return shares * (left / shares.sum()) if count else shares


def _deviations(cause: Cause, standing: bool, scale: float, softness: float) -> np.ndarray:
    """standing: a cause that the data leave standing beside the first; of the others nobody needs more than noise."""
    fitted = cause.fitted
    own = scaled(fitted, scale / np.sqrt(softness))
    sd = deviations(fitted, scale, softness) if standing else deviations_of_noise(own)
    if cause.otherwise is not None:  # a softer wall does what a larger play does
        there = dict(zip((p.name for p in cause.otherwise.choice.parameters), cause.otherwise.values, strict=True))
        names = [p.name for p in fitted.choice.parameters]
        sd = np.hypot(sd, [abs(v - there.get(n, v)) for n, v in zip(names, fitted.values, strict=True)])
    return np.hypot(sd, guesses(fitted.subject.mechanism, fitted.choice.parameters, fitted.values))


def _effects(cause: Cause, sd: np.ndarray) -> list[CauseEffect]:
    found, at = [], 0
    for c in cause.candidates:
        numbers = {}
        for p in c.parameters:
            value, wide = float(cause.fitted.values[at]), float(sd[at])
            numbers[p.parameter] = Amount(
                value=value, sd=wide, unit=p.unit,
                ci95=(float(max(value - 1.96 * wide, p.lower)), float(min(value + 1.96 * wide, p.upper))),
            )  # fmt: skip
            at += 1
        found.append(CauseEffect(kind=c.kind, on=tuple(c.on), parameters=numbers))
    return found


def _fit_remainder(subject: Subject, baseline: Cause, best: Cause, scale: float, unit: str) -> Remainder | None:
    """None where it cannot be told in this unit: markers may tell the held-out gap, and encoders the fitted one."""
    if baseline.fitted.fraction != best.fitted.fraction or unit != gap_unit(subject.fit):
        return None
    before, noise = _rms(subject, baseline.fitted, scale)
    after, _ = _rms(subject, best.fitted, scale)
    return Remainder(before_rms_m=before, after_rms_m=after, noise_rms_m=noise)


def _rms(subject: Subject, fitted: Fitted, scale: float) -> tuple[float, float]:
    """What is missed in the fitted experiments and what noise is there, in the unit of their own gap."""
    miss, noise, count = 0.0, 0.0, 0
    unit = gap_unit(subject.fit)
    for i, probe in enumerate(fitted.whole):
        seen, _ = probe.predict(fitted.values, fitted.own(i))
        units = np.array([c.unit for c in probe.data.channels])[probe.data.channel]
        rows = subject.noise.keep[i] & ~probe.data.still & (units == unit) & np.isfinite(seen)
        miss += float(np.sum((probe.data.value - seen)[rows] ** 2))
        noise += float(np.sum((scale * subject.noise.sigma[i][rows]) ** 2))
        count += int(rows.sum())
    return float(np.sqrt(miss / max(count, 1))), float(np.sqrt(noise / max(count, 1)))


def fitted_share(subject: Subject, drawn: Fitted, made: Fitted, scale: float) -> float:
    """Share of the fitted gap, in squares, that a fit takes away."""
    before, noise = _rms(subject, drawn, scale)
    return (before**2 - _rms(subject, made, scale)[0] ** 2) / max(before**2 - noise**2, 1e-300)


def _ladder(
    subject: Subject, baseline: Cause, best: Cause, tried: Mapping[tuple[str, ...], Cause], scale: float
) -> str:
    """Which member of a set does most of what the set does, which comes next, and how much of the fitted gap each sum
    of them explains, as far as their sets were tried.
    """
    if len(best.candidates) < 2 or best.fitted.fraction < 1.0:
        return ""
    named: list[Candidate] = []
    steps: list[str] = []
    while len(named) < len(best.candidates) - 1:
        larger = [[*named, c] for c in best.candidates if all(c is not other for other in named)]
        sets = [(s, made) for s in larger if (made := tried.get(tuple(sorted(c.name for c in s)))) is not None]
        whole = [(s, made.fitted) for s, made in sets if made.fitted.fraction == 1.0]
        if not whole:
            break
        named, made = min(whole, key=lambda one: one[1].chi2)
        share = fitted_share(subject, baseline.fitted, made, scale)
        if not steps and share < MOST:
            break
        much = "more than 99.9%" if share > ALMOST_ALL else f"{100 * share:.1f}%"
        name = _named(named[-1])
        steps.append(f"with {name} {much}" if steps else f" {name[0].upper()}{name[1:]} alone explains {much}")
        if share > ALMOST_ALL:
            break
    return f"{steps[0]} of the fitted gap{''.join(f', {step}' for step in steps[1:])}." if steps else ""


def _held_out(shrunk: Shrinkage | None) -> HeldOut | None:
    if shrunk is None:
        return None
    return HeldOut(
        before_rms_m=shrunk.before, after_rms_m=shrunk.after, noise_rms_m=shrunk.noise,
        explained_fraction=shrunk.explained, explained_fraction_ci95=shrunk.ci95,
    )  # fmt: skip


def _detectable(subject: Subject, about: Screen, scale: float) -> list[Detectable]:
    found = []
    for c in subject.library.candidates:
        if len(c.on) == 1:
            numbers = zip(c.parameters, c.sizes, c.prior_sd, scale * about.detectable(c), strict=True)
            for p, is_size, sd, least in numbers:
                if is_size and least < 1e3 * sd:
                    found.append(
                        Detectable(
                            kind=c.kind, on=tuple(c.on), parameter=p.parameter, minimum=float(least), unit=p.unit
                        )
                    )
    return found


def _sentence(
    verdict: Verdict, enough: bool, causes: Sequence[CauseSet], places: Sequence[Location], shrunk, reported: int,
    none: float, unknown: float,
) -> str:  # fmt: skip
    named = " and ".join(_named(e) for e in causes[0].effects) if causes else ""
    if verdict == "none":
        perhaps = causes and causes[0].probability >= WORTH_A_WORD
        doubt = f" If anything is amiss it may be {named} ({100 * causes[0].probability:.0f}%)." if perhaps else ""
        return f"The drawing explains the measurements to within their noise: these data show no gap.{doubt}"
    share = ""
    if shrunk is not None and shrunk.explained is not None:
        share = f" It explains {100 * shrunk.explained:.1f}% of the gap on experiments it was not fitted to."
    if none >= WORTH_A_WORD:
        share += f" That nothing is amiss and noise looks so: {100 * none:.0f}%."
    if verdict == "identified":
        several = len(causes[0].effects) > 1
        doubt = f" (or, {100 * unknown:.0f}%, one thing outside the library that does what they do)" if several else ""
        return f"The gap is {named}{doubt}.{share}"
    if verdict == "ambiguous":
        others = f"one of {reported - 1} other explanation(s)" if reported > 1 else "something that the library lacks"
        return f"The gap is {named}, or {others}; these data cannot tell which.{share}"
    if verdict == "approximate":
        return f"The gap is nearly {named}, but something else is missing too.{share}"
    where = f", most probably at {place_name(places[0].at)}" if places else ""
    if enough and causes and causes[0].probability >= WORTH_A_WORD:
        return (
            f"Something real is missing from the drawing{where}: rather something outside the library "
            f"({100 * unknown:.0f}%) than {named}, which would fit too ({100 * causes[0].probability:.0f}%)."
        )
    return f"Something real is missing from the drawing{where}, and no effect of the library explains it."


def _named(effect: CauseEffect | Candidate) -> str:
    on = list(effect.on) if not isinstance(effect.on, str) else [effect.on]
    place = on[0] if len(on) == 1 else f"all of {', '.join(on[:4])}{'...' if len(on) > 4 else ''}"
    return acting(effect.kind, place)
