"""The report of a diagnosis: is there a gap, where, what is it, how far does it shrink, and what to do next."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from backend.mechanism.gap_names import place_name
from backend.mechanism.gap_report import CauseSet, Detectable, GapReport
from backend.report.chart import Band, Chart, Series, Stretch
from backend.report.evidence import Channel, GapEvidence
from backend.report.fit_page import named, overlaid, release_mark
from backend.report.gap_bars import shrink_bars
from backend.report.gap_figure import gap_figure
from backend.report.gap_words import (
    MEANING,
    alike,
    amounts,
    cause_name,
    effect_name,
    inseparable_name,
    least,
    next_sentence,
    parameter_name,
    percent,
)
from backend.report.page import write_page
from backend.report.quantity import at_the_bench, prefixed, shown

MOST_CAUSES, MOST_PLACES, MOST_FORCES, MOST_CHANNELS = 8, 8, 6, 3
LEAST = 0.005  # a probability below it is no more than a name in gap.json
DOUBTFUL = 0.2  # a joint less probable than that is not where the gap is
KEPT = "\u00a0"  # a space at which no line ends
DRAWN, CORRECTED = "drawing as it is", "with the best cause"


def write_gap_page(evidence: GapEvidence, path: str | Path) -> Path:
    """Write the report as one HTML file; returns its path."""
    report = evidence.report
    places = [p for p in report.suspected if p.probability >= LEAST][:MOST_PLACES]
    badge, meaning = MEANING[report.verdict]
    channels = evidence.channels[:MOST_CHANNELS]
    return write_page(
        "gap.html",
        path,
        title=evidence.mechanism.name,
        verdict=report.verdict,
        badge=badge,
        sentence=report.sentence,
        meaning=meaning,
        key_figures=key_figures(report),
        picture=gap_figure(evidence.mechanism, evidence.pose, {p.at: p.probability for p in report.suspected}),
        places=[Bar(place_name(p.at), p.probability) for p in places],
        forces=missing_forces(evidence),
        force_kind=force_kind(evidence),
        force_at=place_name(evidence.missing_at),
        force_trust=_model_free(evidence),
        causes=list(causes(report)),
        others=sum(c.probability < LEAST for c in report.causes),
        experiment=channels[0].experiment if channels else "",
        set_aside=evidence.set_aside,
        held_out=bool(channels) and channels[0].use == "held_out",
        motion=[chart for channel in channels for chart in (compared(channel, report), what_is_left(channel, report))],
        shrink=shrink_figures(report),
        detectable=list(_detectable(report.detectable)),
        inseparable=[inseparable_name(group) for group in report.inseparable],
        following=next_sentence(report.next_experiment),
        warnings_=report.warnings,
        wall_s=report.wall_s,
    )


@dataclass(frozen=True)
class Bar:
    """A name and how probable it is."""

    name: str
    probability: float

    @property
    def percent(self) -> str:
        """In words."""
        return percent(self.probability).replace(" ", KEPT)

    @property
    def width(self) -> str:
        """Of the bar, in percent of its place."""
        return f"{100 * self.probability:.1f}"


@dataclass(frozen=True)
class Explanation(Bar):
    """A cause with its amounts and its aliases. amounts: (effect, unless it is the only one; how much)."""

    amounts: Sequence[tuple[str, str]] = ()
    alike: Sequence[str] = ()
    note: str = ""


def causes(report: GapReport) -> Iterator[Explanation]:
    """Explanations worth naming, nothing and something unknown among them, the most probable first."""
    rows = [_explained(c) for c in report.causes[:MOST_CAUSES] if c.probability >= LEAST]
    if report.probability_none >= LEAST:
        rows.append(Explanation("nothing: the drawing is right", report.probability_none))
    if report.probability_unknown >= LEAST:
        note = "An effect that the library does not have."
        rows.append(Explanation("something unknown", report.probability_unknown, note=note))
    yield from sorted(rows, key=lambda row: -row.probability)


def _explained(cause: CauseSet) -> Explanation:
    several = len(cause.effects) > 1
    told = [
        (effect_name(e) if several else "", amounts(e).replace(" ", KEPT).replace(f",{KEPT}", ", "))
        for e in cause.effects
        if e.parameters
    ]
    return Explanation(cause_name(cause), cause.probability, told, alike(cause))


def key_figures(report: GapReport) -> list[tuple[str, str]]:
    """The numbers at the top of the page, each with what it means."""
    figures = [("< 0.1%" if report.p_value < 1e-3 else percent(report.p_value), "chance that noise alone looks so")]
    rest, where = report.shrink.held_out, "unseen experiments"
    if rest is None:
        rest, where = report.shrink.fit, "fitted experiments"
    if rest is not None:
        unit, factor = _bench(report.shrink.unit)
        figures.append((f"{shown(factor * rest.before_rms_m)} {unit}", f"error of the drawing, {where}"))
        if report.verdict != "none":
            figures.append((f"{shown(factor * rest.after_rms_m)} {unit}", f"error with the best cause, {where}"))
        figures.append((f"{shown(factor * rest.noise_rms_m)} {unit}", "what a right model would leave"))
    return figures


def _bench(si: str) -> tuple[str, float]:
    return ("mrad", 1e3) if si == "rad" else at_the_bench(si)


def missing_forces(evidence: GapEvidence) -> list[Chart]:
    """Missing force against time, one panel an experiment, all on one scale."""
    shown_ = evidence.missing[:MOST_FORCES]
    if not shown_:
        return []
    low = min(float(np.min(m.mean - 2 * m.sd)) for m in shown_)
    high = max(float(np.max(m.mean + 2 * m.sd)) for m in shown_)
    unit, factor = prefixed(max(abs(low), abs(high)), evidence.missing_unit)
    kind = force_kind(evidence)
    place = evidence.missing_at
    return [
        Chart(
            f"{m.experiment}: {kind} missing at {place_name(place)}",
            "time after release [s]",
            f"missing {kind} [{unit}]",
            [Series("most probable", m.time_s, factor * m.mean, "after")],
            [Band("±2 sd", m.time_s, factor * (m.mean - 2 * m.sd), factor * (m.mean + 2 * m.sd))],
            stretches=[
                Stretch("not noise", p.start_s, p.end_s)
                for p in evidence.report.where.phases
                if p.experiment == m.experiment and p.at == place
            ],
            y_range=(min(0.0, factor * low), max(0.0, factor * high)),
        )
        for m in shown_
    ]


def _model_free(evidence: GapEvidence) -> str:
    """How probably the gap lies at that joint, whatever the library says."""
    shares = {p.at: p.probability for p in evidence.report.where.model_free}
    if not shares:
        return ""
    share = shares.get(evidence.missing_at, 0.0)
    sure = percent(share).replace(" ", KEPT)
    said = f"Judged without the library, by unknown forces and shifts alone, the gap lies here with {sure}"
    named = evidence.report.suspected[0].at if evidence.report.suspected else ""
    if share < DOUBTFUL and named == evidence.missing_at:
        likeliest = max(shares, key=lambda at: shares[at])
        return (
            f"The library's explanation acts here. Unknown forces and shifts alone would rather lie at "
            f"{place_name(likeliest)} ({percent(shares[likeliest]).replace(' ', KEPT)}): in a linkage a force at one "
            f"place does nearly what one at another does."
        )
    if share < DOUBTFUL:
        return f"{said}: the curves say how large a {force_kind(evidence)} would have to be, not that there is one."
    return f"{said}."


def force_kind(evidence: GapEvidence) -> str:
    """What can be missing along a joint's own axis or about it; of one that is told how to move, or of the base, a
    motion.
    """
    what = {"N": "force", "N m": "torque"}.get(evidence.missing_unit, "motion")
    return f"{what} along {evidence.missing_along}" if evidence.missing_along else what


def compared(channel: Channel, report: GapReport) -> Chart:
    """One coordinate as measured, as drawn and with the best cause."""
    if report.verdict == "none":
        channel = _as_drawn(channel)
        return overlaid(channel, after=DRAWN)
    return overlaid(channel, DRAWN, CORRECTED)


def what_is_left(channel: Channel, report: GapReport) -> Chart:
    """Measured minus predicted, by both, with what noise alone would leave."""
    unit, factor = _bench(channel.unit)
    t = channel.time_s
    bands = []
    if channel.sigma is not None:
        edge = np.full(2, 2.0 * factor * channel.sigma)
        bands = [Band("±2 sd of the noise", t[[0, -1]], -edge, edge)]
    after = Series(CORRECTED, t, factor * (channel.measured - channel.after), "after", "points")
    series = [after]
    if report.verdict == "none":
        series = [Series(DRAWN, t, after.y, "before", "points")]
    elif channel.before is not None:
        series = [Series(DRAWN, t, factor * (channel.measured - channel.before), "before", "points"), after]
    title = f"{named(channel)}: measured minus predicted"
    return Chart(title, "time [s]", f"what is left [{unit}]", series, bands, release_mark(channel))


def _as_drawn(channel: Channel) -> Channel:
    return Channel(
        channel.experiment, channel.use, channel.at, channel.component, channel.unit, channel.time_s,
        channel.measured, None, channel.after, channel.sigma, channel.release_s,
    )  # fmt: skip


def shrink_figures(report: GapReport) -> list:
    """The error before and after, of held-out and of fitted experiments, as figures."""
    bars, held = [], report.shrink.held_out
    corrected = report.verdict != "none"
    if held is not None:
        note = "No gap to explain on these experiments beyond their noise."
        if held.explained_fraction is not None:
            low, high = held.explained_fraction_ci95 or (None, None)
            span = (
                "" if low is None or high is None else f" (95%: {shown(100 * min(low, high))} to {shown(100 * high)}%)"
            )
            note = f"The best cause explains {shown(100 * held.explained_fraction)}% of the gap's power{span}."
        bars.append(
            shrink_bars(held, report.shrink.unit, corrected, "Held-out experiments: never fitted, rms error", note)
        )
    if report.shrink.fit is not None:
        bars.append(shrink_bars(report.shrink.fit, report.shrink.unit, corrected, "Fitted experiments, rms error"))
    return bars


@dataclass(frozen=True)
class Reach:
    """The smallest amounts of one number that could have been seen: where it shows most, and where least."""

    name: str
    best: str
    worst: str


def _detectable(found: Sequence[Detectable]) -> Iterator[Reach]:
    groups: dict[tuple[str, str, str], list[Detectable]] = {}
    for d in found:
        groups.setdefault((d.kind, d.parameter, d.unit), []).append(d)
    for (kind, parameter, _), each in groups.items():
        ranked = sorted(each, key=lambda d: d.minimum)
        told = [f"{least(d)} at {d.on if isinstance(d.on, str) else d.on[0]}" for d in (ranked[0], ranked[-1])]
        worst = told[1] if len(ranked) > 1 else ""
        named_ = f"{kind.replace('_', ' ')}, {parameter_name(parameter)}".removesuffix(", ")
        yield Reach(named_, told[0], worst)
