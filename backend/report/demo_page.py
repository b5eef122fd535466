"""The report of the demonstration: drawn, seen, fitted against the truth, and put to an unseen load."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from backend.mechanism.fit_report import Residual
from backend.mechanism.mechanism import Mechanism
from backend.report.evidence import Channel, DemoEvidence
from backend.report.fit_page import cautions, overlaid, pooled
from backend.report.page import write_page
from backend.report.quantity import at_the_bench, shown


def write_demo_page(evidence: DemoEvidence, path: str | Path) -> Path:
    """Write the report as one HTML file; returns its path."""
    fit = evidence.fit
    before, after, unit = _prediction_errors(fit.report.held_out)
    return write_page(
        "demo.html",
        path,
        title=fit.title,
        headline="A linkage was drawn, filmed and fitted. Then the twin was asked about a load it had never seen.",
        key_figures=[
            (f"{shown(before)} {unit}", "error of the drawing on the unseen load"),
            (f"{shown(after)} {unit}", "error of the fitted twin on it"),
            (_verdict(evidence), "true values inside their 95% intervals"),
            (f"{shown(sum(seconds for _, seconds in evidence.steps), 2)} s", "for the whole run"),
        ],
        mechanism=fit.mechanism,
        drawn=_drawn(fit.mechanism),
        parts=_parts(fit.mechanism),
        seen=_seen(evidence),
        stills=[{"png": base64.b64encode(png).decode(), "time": f"{time_s:.3f} s"} for time_s, png in evidence.stills],
        reality=evidence.reality,
        report=fit.report,
        truth=dict(fit.truth),
        cautions=cautions(fit.report),
        overlays=fit.overlays,
        fitted=[overlaid(channel) for channel in _telling([c for c in fit.channels if c.use == "fit"])],
        prediction=f"{evidence.unseen} The drawing misses it by {shown(before)} {unit} rms, the fitted twin by "
        f"{shown(after)} {unit}: {shown(before / after, 2)} times closer.",
        predicted=[overlaid(channel) for channel in _telling(evidence.prediction)],
        steps=evidence.steps,
        files=evidence.files,
    )


def _prediction_errors(rows: Sequence[Residual]) -> tuple[float, float, str]:
    """Rms distance of drawing and of twin on the unseen load, over all its markers, in one unit."""
    units = {row.unit for row in rows}
    if len(units) != 1 or any(row.before is None for row in rows):
        raise ValueError(
            f"the fit has held-out errors in {sorted(units) or 'no unit'}; the demonstration compares the drawing and "
            "the twin on at least one held-out experiment, all in one unit"
        )
    unit, factor = at_the_bench(units.pop())
    return factor * pooled(rows, "before"), factor * pooled(rows), unit


def _verdict(evidence: DemoEvidence) -> str:
    known = [p for p in evidence.fit.report.parameters if p.name in evidence.fit.truth]
    inside = 0
    for p in known:
        low, high = p.ci95 or (None, None)
        if low is not None and high is not None:
            inside += low <= evidence.fit.truth[p.name] <= high
    return f"{inside} of {len(known)}"


def _drawn(mechanism: Mechanism) -> str:
    moving = sum(not body.fixed for body in mechanism.bodies)
    rubs = sorted({effect.kind.replace("_", " ") for effect in mechanism.effects if "friction" in effect.kind})
    tool = mechanism.provenance.tool if mechanism.provenance and mechanism.provenance.tool else "CAD"
    holds = f"and {', '.join(rubs)}" if rubs else "and no friction"
    return (
        f"“{mechanism.name}”, drawn in {tool}: {moving} moving parts on {len(mechanism.joints)} joints. "
        f"The drawing knows shapes and masses {holds}."
    )


def _telling(channels: Sequence[Channel]) -> list[Channel]:
    """One coordinate of each of the four places that the drawing misses most: its worst."""
    worst: dict[str, Channel] = {}
    for channel in sorted(channels, key=_missed_by_drawing, reverse=True):
        worst.setdefault(channel.at, channel)
    return list(worst.values())[:4]


def _missed_by_drawing(channel: Channel) -> float:
    missed = channel.rms(channel.after if channel.before is None else channel.before)
    return missed if np.isfinite(missed) else np.inf


def _parts(mechanism: Mechanism) -> list[dict]:
    return [
        {
            "name": body.name or body.id,
            "mass_g": None if body.inertial is None or body.fixed else 1e3 * body.inertial.mass_kg,
            "joints": ", ".join(j.id for j in mechanism.joints if body.id in (j.body_a, j.body_b)),
        }
        for body in mechanism.bodies
    ]


def _seen(evidence: DemoEvidence) -> str:
    tracks = {c.at for c in evidence.fit.channels if c.use == "fit"}
    return (
        f"{evidence.frames} frames at {shown(evidence.frames_per_s)} frames per second. The tracker found the dots "
        f"in each frame and turned them into metres with the marks on the bed: {len(tracks)} tracks, each point "
        "with its own uncertainty."
    )
