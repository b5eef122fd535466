"""The report of a fit: what was fitted and how surely, what it explains, and what is left."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from backend.mechanism.fit_report import FitReport, Residual
from backend.report.chart import Band, Chart, Series
from backend.report.evidence import Channel, FitEvidence
from backend.report.page import write_page
from backend.report.quantity import at_the_bench, shown
from backend.report.strip import correlation_matrix

MOST_CHARTS = 6
"""Coordinates charted per experiment, the worst fitted first; the table of residuals has them all."""


def write_fit_page(evidence: FitEvidence, path: str | Path) -> Path:
    """Write the report as one HTML file; returns its path."""
    report = evidence.report
    names = [parameter.name for parameter in report.parameters]
    return write_page(
        "fit.html",
        path,
        title=evidence.title,
        headline=headline(report),
        key_figures=key_figures(report),
        cautions=cautions(report),
        report=report,
        truth=dict(evidence.truth),
        mechanism=evidence.mechanism,
        overlays=evidence.overlays,
        experiments=[_Experiment.of(name, channels) for name, channels in _by_experiment(evidence.channels)],
        matrix=correlation_matrix(names, report.correlation) if len(names) > 1 and report.correlation else None,
        convergence=convergence(report),
    )


def headline(report: FitReport) -> str:
    """The fit in a sentence."""
    count = len(report.parameters)
    said = f"{count} value{'s' if count != 1 else ''} fitted in {shown(report.wall_s, 2)} s"
    steps = max((entry.iteration for entry in report.history), default=0)
    return f"{said}, {steps} iterations: " + (
        "converged." if report.converged else "NOT converged; take no value on trust."
    )


def key_figures(report: FitReport) -> list[tuple[str, str]]:
    """The figures a reader looks for first: error before and after, on the fitted and on the held-out data."""
    figures = []
    for name, rows in (("fitted data", report.residuals), ("held-out data", report.held_out)):
        for si in sorted({row.unit for row in rows}):
            unit, factor = at_the_bench(si)
            chosen = [row for row in rows if row.unit == si]
            figures.append((f"{shown(factor * pooled(chosen))} {unit}", f"rms error on {name}, after"))
            if all(row.before is not None for row in chosen):
                figures.append((f"{shown(factor * pooled(chosen, 'before'))} {unit}", f"rms error on {name}, as drawn"))
    return figures


def pooled(rows: Sequence[Residual], of: str = "rms") -> float:
    """Root mean square over all samples of several rows of the same unit."""
    weight = np.array([row.count for row in rows], float)
    values = np.array([getattr(row, of) for row in rows], float)
    return float(np.sqrt(np.sum(weight * values**2) / np.sum(weight)))


def cautions(report: FitReport) -> list[str]:
    """Every warning of the report, each once, in order."""
    said = [*report.warnings, *(row.warning for row in report.identifiability if row.warning)]
    return list(dict.fromkeys(said))


def overlaid(channel: Channel, before: str = "before", after: str = "after") -> Chart:
    """One coordinate as measured, as drawn and as fitted."""
    unit, factor = at_the_bench(channel.unit)
    series = [Series("measured", channel.time_s, factor * channel.measured, "measured", "points")]
    if channel.before is not None:
        series.append(Series(before, channel.time_s, factor * channel.before, "before", "dashed", framed=False))
    series.append(Series(after, channel.time_s, factor * channel.after, "after"))
    return Chart(named(channel), "time [s]", f"{channel.component} [{unit}]", series, marks=release_mark(channel))


def residual(channel: Channel) -> Chart:
    """Measured minus fitted in time, with twice the noise as a band."""
    unit, factor = at_the_bench(channel.unit)
    left = factor * (channel.measured - channel.after)
    bands = []
    if channel.sigma is not None:
        edge = np.full(2, 2.0 * factor * channel.sigma)
        bands = [Band("±2 sd of the noise", channel.time_s[[0, -1]], -edge, edge)]
    series = [Series("", channel.time_s, left, "after", "points")]
    rms = f"rms {shown(factor * channel.rms(channel.after))} {unit}"
    return Chart(f"{named(channel)}: {rms}", "time [s]", f"residual [{unit}]", series, bands, release_mark(channel))


def convergence(report: FitReport) -> list[Chart]:
    """Objective and gradient by iteration, and the path of each value relative to where it ended."""
    if len(report.history) < 2:
        return []
    at = np.array([entry.iteration for entry in report.history], float)
    objective = np.array([entry.objective for entry in report.history])
    gradient = np.array([entry.gradient_norm for entry in report.history])
    paths = []
    for i, parameter in enumerate(report.parameters[:8]):
        values = np.array([entry.parameters.get(parameter.name, np.nan) for entry in report.history])
        paths.append(Series(parameter.name, at, values / (abs(parameter.value) or 1.0), f"c{i}"))
    return [
        Chart(
            "Objective", "iteration", "½ Σ ρ(r²)", [Series("", at, objective, "c0")], log_y=bool(np.all(objective > 0))
        ),
        Chart(
            "Gradient", "iteration", "scaled norm", [Series("", at, gradient, "c0")], log_y=bool(np.any(gradient > 0))
        ),
        Chart("Values on their way", "iteration", "value / |final value|", paths),
    ]


@dataclass(frozen=True)
class _Experiment:
    name: str
    role: str
    overlaid: list[Chart]
    residual: list[Chart]
    left_out: str

    @classmethod
    def of(cls, name: str, channels: Sequence[Channel]) -> _Experiment:
        moving = [channel for channel in channels if _moves(channel, channels)]
        worst = sorted(moving, key=lambda c: -np.nan_to_num(c.rms(c.after)))[:MOST_CHARTS]
        rest = len(channels) - len(worst)
        return cls(
            name,
            "held out" if channels[0].use == "held_out" else "fitted",
            [overlaid(channel) for channel in worst],
            [residual(channel) for channel in worst],
            f"{rest} coordinates that hardly move or fit better are not charted; the table of residuals has all places."
            if rest
            else "",
        )


def _by_experiment(channels: Iterable[Channel]) -> list[tuple[str, list[Channel]]]:
    grouped: dict[str, list[Channel]] = {}
    for channel in channels:
        grouped.setdefault(channel.experiment, []).append(channel)
    return list(grouped.items())


def _moves(channel: Channel, among: Sequence[Channel]) -> bool:
    """Whether its range is at least a hundredth of the widest of the same unit."""
    widest = max(np.ptp(other.measured) for other in among if other.unit == channel.unit)
    return bool(np.ptp(channel.measured) >= 0.01 * widest)


def named(channel: Channel) -> str:
    """Its place and coordinate in words."""
    return f"{channel.at.replace(':', ' ')} {channel.component}"


def release_mark(channel: Channel) -> list[tuple[float, str]]:
    """When it was let go, where there are frames before."""
    if channel.release_s is None or channel.release_s <= channel.time_s[0]:
        return []
    return [(channel.release_s, "release")]
