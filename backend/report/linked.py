"""What each result shows as linked pictures: its motions, its charts in time, its words and numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from backend.mechanism.gap_names import place_name
from backend.mechanism.jam_report import JamReport
from backend.report import fit_page, gap_page, jam_page, simulation_page
from backend.report.evidence import Channel, FitEvidence, GapEvidence, JamEvidence, Overlay, SimulationEvidence
from backend.report.gap_words import MEANING, inseparable_name, least, next_sentence, parameter_name
from backend.report.pictures import Linked, Pictures

MOST_CHARTS = 6  # of one experiment


def simulation_pictures(evidence: SimulationEvidence) -> Pictures:
    """The drawing let go."""
    name = evidence.mechanism.name
    charts = [Linked(c, "How the joints move", name) for c in simulation_page.joint_charts(evidence)]
    charts += [Linked(c, "Whether it can be trusted", name) for c in simulation_page.checks(evidence)]
    story = {"result": evidence.result, "step_s": evidence.step_s}
    return Pictures("simulate", (Overlay(name, evidence.motion),), charts, "simulated", story=story)


def fit_pictures(evidence: FitEvidence) -> Pictures:
    """Measured, drawn and fitted, run by run."""
    report = evidence.report
    charts: list[Linked] = []
    for run, channels in _by_run(evidence.channels):
        role = "held out" if channels[0].use == "held_out" else "fitted"
        worst = sorted(channels, key=lambda c: -np.nan_to_num(c.rms(c.after)))[:MOST_CHARTS]
        for channel in worst:
            charts.append(Linked(fit_page.overlaid(channel, "as drawn", "fitted"), f"{run} ({role})", run))
            charts.append(Linked(fit_page.residual(channel), f"{run} ({role})", run))
    charts += [Linked(chart, "How the search went") for chart in fit_page.convergence(report)]
    story = {
        "headline": fit_page.headline(report),
        "figures": fit_page.key_figures(report),
        "cautions": fit_page.cautions(report),
    }
    return Pictures("fit", evidence.overlays, charts, "fitted twin", story=story)


def jam_pictures(evidence: JamEvidence) -> Pictures:
    """Where it stands, and what its joints carry on the way there."""
    report, motion = evidence.report, evidence.motion
    run = report.experiment or evidence.mechanism.name
    charts = [Linked(c, "What the joints carry", run) for c in jam_page.reactions(report)]
    charts += [Linked(c, "What says so, over time", run) for c in jam_page.indicators(report)]
    story = {"figures": jam_page.key_figures(report), "cautions": jam_page.cautions(report)}
    forces = {run: _forces(report, np.asarray(motion.time_s))}
    return Pictures("jam", (Overlay(run, motion),), charts, "simulated", forces, story)


def _forces(report: JamReport, time_s: np.ndarray) -> dict[str, np.ndarray]:
    """Force on body B of every joint at the times of the motion [N]; between two entries, on a line."""
    known = np.array(report.time_s)
    return {
        joint: np.stack([np.interp(time_s, known, np.array(r.force_on_b_n)[:, k]) for k in range(3)], -1)
        for joint, r in report.reactions.items()
        if len(r.force_on_b_n) == len(known) and len(known) > 1
    }


def gap_pictures(evidence: GapEvidence) -> Pictures:
    """The gap: its place, its causes, and the motion that is explained worst."""
    report = evidence.report
    release = {c.experiment: c.release_s or 0.0 for c in evidence.channels}
    release |= {o.experiment: float(o.after.time_s[0]) for o in evidence.overlays}
    channels = evidence.channels[: gap_page.MOST_CHANNELS]
    charts = [
        Linked(chart, "Measured against predicted", channel.experiment)
        for channel in channels
        for chart in (gap_page.compared(channel, report), gap_page.what_is_left(channel, report))
    ]
    charts += [
        Linked(
            chart,
            f"What is missing at {place_name(evidence.missing_at)}",
            one.experiment,
            release.get(one.experiment, 0.0),
        )
        for one, chart in zip(evidence.missing, gap_page.missing_forces(evidence), strict=False)
    ]
    return Pictures("diagnose", evidence.overlays, charts, "with the best cause", story=_gap_story(evidence))


def _gap_story(evidence: GapEvidence) -> dict[str, Any]:
    report = evidence.report
    badge, meaning = MEANING[report.verdict]
    places = [p for p in report.suspected if p.probability >= gap_page.LEAST][: gap_page.MOST_PLACES]
    return {
        "badge": badge,
        "meaning": meaning,
        "figures": gap_page.key_figures(report),
        "places": [_bar(gap_page.Bar(place_name(p.at), p.probability)) | {"at": p.at} for p in places],
        "causes": [
            _bar(c) | {"amounts": [list(a) for a in c.amounts], "alike": list(c.alike), "note": c.note}
            for c in gap_page.causes(report)
        ],
        "next": next_sentence(report.next_experiment),
        "shrink": [str(bars) for bars in gap_page.shrink_figures(report)],
        "detectable": [
            [f"{d.kind.replace('_', ' ')}{f', {what}' if (what := parameter_name(d.parameter)) else ''}",
             d.on if isinstance(d.on, str) else ", ".join(d.on), least(d)]
            for d in report.detectable
        ],
        "inseparable": [inseparable_name(group) for group in report.inseparable],
    }  # fmt: skip


def _bar(bar: gap_page.Bar) -> dict[str, Any]:
    return {"name": bar.name, "probability": bar.probability, "percent": bar.percent}


def _by_run(channels: Sequence[Channel]) -> list[tuple[str, list[Channel]]]:
    grouped: dict[str, list[Channel]] = {}
    for channel in channels:
        grouped.setdefault(channel.experiment, []).append(channel)
    return list(grouped.items())
