"""The report of an ensemble: how likely it jams, what decides that, and where in the tolerances it happens."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy import stats

from backend.mechanism.ensemble_report import EnsembleReport, VariedParameter
from backend.report.chart import Band, Chart, Series
from backend.report.page import write_page
from backend.report.quantity import at_the_bench, shown
from backend.report.share_bars import share_bars

MOST_CURVES = 4
FEWEST_IN_BIN = 12
LETTERS = 32  # that an upright axis has room for


def write_ensemble_page(report: EnsembleReport, path: str | Path) -> Path:
    """Write the report as one HTML file; returns its path."""
    order = ranked(report)
    return write_page(
        "ensemble.html",
        path,
        title=report.mechanism,
        sentence=report.sentence,
        cautions=report.warnings,
        key_figures=key_figures(report),
        bars=share_bars([report.parameters[k] for k in order]),
        tolerances=[
            *([scatter(report, order[0], order[1])] if len(order) > 1 else []),
            *(share_jammed(report, k) for k in order[:MOST_CURVES]),
        ],
        report=report,
        order=order,
    )


def ranked(report: EnsembleReport) -> list[int]:
    """Parameters by their total share, the strongest first; as given where there are no shares."""
    return sorted(range(len(report.parameters)), key=lambda k: -_strength(report.parameters[k]))


def _strength(parameter: VariedParameter) -> float:
    return parameter.total.value if parameter.total else 0.0


def key_figures(report: EnsembleReport) -> list[tuple[str, str]]:
    """The figures a reader looks for first."""
    low, high = report.probability_ci95
    figures = [
        (f"{shown(100 * report.probability)}%", "probability of a jam"),
        (f"{shown(100 * low)} to {shown(100 * high)}%", "95% interval (Wilson)"),
        (f"{report.jammed} of {report.independent}", "independent samples jammed"),
    ]
    if report.lost:
        figures.append((str(report.lost), f"of {report.samples} samples lost"))
    if report.onset_s:
        figures.append((f"{shown(report.onset_s[1])} s", "at rest since, in the middle of those that jam"))
    if report.throughput.samples_per_s:
        figures.append((f"{shown(report.throughput.samples_per_s)} /s", "samples, compile apart"))
    return figures


def scatter(report: EnsembleReport, across: int, up: int) -> Chart:
    """Samples in the plane of two parameters, jammed and free apart."""
    x, y = _values(report, across), _values(report, up)
    jammed, lost = np.array(report.shown.jammed, bool), np.array(report.shown.lost, bool)
    groups = [("free", ~jammed & ~lost, "c0"), ("jammed", jammed & ~lost, "before"), ("lost", lost, "c7")]
    series = [Series(name, x[of], y[of], tone, "cloud") for name, of, tone in groups if of.any()]
    note = f"{len(x)} of the independent samples, along the two parameters with the greatest shares."
    return Chart("Where it jams", _label(report, across), _label(report, up), series, note=note)


def share_jammed(report: EnsembleReport, of: int) -> Chart:
    """Share that jams among samples of similar value, with its 95% interval."""
    good = ~np.array(report.shown.lost, bool)
    x, jammed = _values(report, of)[good], np.array(report.shown.jammed, bool)[good]
    order = np.argsort(x)
    bins = np.array_split(order, max(1, min(20, len(order) // FEWEST_IN_BIN)))
    at = np.array([x[some].mean() for some in bins])
    counts = [(int(jammed[some].sum()), len(some)) for some in bins]
    limits = np.array([stats.binomtest(k, n).proportion_ci(method="wilson") for k, n in counts])
    part = np.array([k / n for k, n in counts])
    return Chart(
        f"Share that jams along {report.parameters[of].name}",
        _label(report, of),
        "jams [%]",
        [Series("", at, 100 * part, "before")],
        [Band("95%", at, 100 * limits[:, 0], 100 * limits[:, 1])],
        note="All else scatters as asked for.",
    )


def _values(report: EnsembleReport, of: int) -> np.ndarray:
    _, factor = at_the_bench(report.parameters[of].unit)
    return factor * np.array(report.shown.values[of])


def _label(report: EnsembleReport, of: int) -> str:
    """Place and parameter, short enough for the upright axis; the table has the whole name."""
    unit, _ = at_the_bench(report.parameters[of].unit)
    ending = "" if unit == "1" else f" [{unit}]"
    name, room = report.parameters[of].name.partition(":")[2], LETTERS - len(ending)
    return (name if len(name) <= room else name[: room - 1] + "…") + ending
