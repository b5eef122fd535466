"""The report of a jam: one sentence, the mechanism where it stands, and every indicator over time."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from backend.mechanism.jam_report import JamReport
from backend.report.chart import Chart, Series
from backend.report.evidence import JamEvidence, Overlay
from backend.report.page import write_page
from backend.report.pose_figure import pose_figure
from backend.report.quantity import shown

HOLDS = 10.0  # creep ratio below which it counts as at rest
SMALLEST = 1e-18  # drawn where a value is zero on a logarithmic axis
MOST_VALUES, MOST_JOINTS = 6, 8


def write_jam_page(evidence: JamEvidence, path: str | Path) -> Path:
    """Write the report as one HTML file; returns its path."""
    report, motion = evidence.report, evidence.motion
    onset = len(motion.time_s) - 1
    if report.onset_s is not None:
        onset = min(onset, int(np.searchsorted(motion.time_s, report.onset_s - 1e-9)))
    when = "Where it stands when it comes to rest" if report.onset_s is not None else "Where it is at the end"
    return write_page(
        "jam.html",
        path,
        title=evidence.mechanism.name + (f", {report.experiment}" if report.experiment else ""),
        sentence=report.sentence,
        cautions=cautions(report),
        key_figures=key_figures(report),
        pose=pose_figure(evidence.mechanism, motion, onset, report.at, when),
        mechanism=evidence.mechanism,
        overlay=Overlay(evidence.mechanism.name, motion),
        indicators=indicators(report),
        reactions=reactions(report),
        left_out=len(report.reactions) > MOST_JOINTS,
    )


def cautions(report: JamReport) -> list[str]:
    """What to keep in mind when reading the report."""
    said = [] if report.result == "done" else [report.result]
    if report.cause == "singularity" and report.onset_s == 0.0 and max(report.creep_ratio) > HOLDS:
        said.append("It starts at an exact dead centre: what moves later grew from rounding errors and means nothing.")
    return said


def key_figures(report: JamReport) -> list[tuple[str, str]]:
    """The numbers at the top of the page, each with what it means."""
    margin = report.margin
    if report.jammed:
        known = [("jammed", report.cause.replace("_", " "))]
    else:
        known = [("not jammed", f"in {shown(report.time_s[-1] - report.time_s[0])} s of motion")]
    if report.onset_s is not None:
        known.append((f"{shown(report.onset_s, 4)} s", "at rest since"))
    if report.cause in ("friction_lock", "insufficient_drive"):
        known.append((f"× {shown(margin.drive_factor)}" if margin.drive_factor else "none", "drive that frees it"))
        freeing = f"× {shown(margin.friction_factor)}" if margin.friction_factor is not None else "none"
        known.append((freeing, "friction below which it is free"))
    if report.lever is not None:
        known.append((shown(report.lever), "lever: share of the drive that joints do not carry"))
    return known


def indicators(report: JamReport) -> list[Chart]:
    """What says that it jams or not, over time."""
    t = np.array(report.time_s)
    marks = [(report.onset_s, "rest")] if report.onset_s is not None else []
    creep = np.maximum(report.creep_ratio, 1e-3)
    along = report.friction_cone_along
    missing = np.array([np.nan if value is None else value for value in along.shortage])
    values = np.array(report.singular_values).reshape(len(t), -1)[:, -MOST_VALUES:]
    driven = np.maximum(report.driven_singular_value, SMALLEST)
    return [
        Chart(
            "Creep ratio",
            "time [s]",
            "rate / rate at which friction holds",
            [Series("", t, creep, "c0"), Series("at rest below", t, np.full(len(t), HOLDS), "measured", "dashed")],
            marks=marks,
            log_y=True,
        ),
        Chart(
            "Can forces within the friction cones hold the drive?",
            "time [s]",
            "shortage of friction / load",
            [
                Series("", np.array(along.time_s), missing, "c1", "line"),
                Series("holds", t, 0.0 * t, "measured", "dashed"),
            ],
            marks=marks,
            note="Asked as if it stood still there. 0: friction can hold it. Gaps: no forces at all can.",
        ),
        Chart(
            "Lever of the drive",
            "time [s]",
            "smallest singular value of [J; drive]",
            [Series("", t, driven, "c2")],
            marks=marks,
            log_y=True,
            note="Falls to 0 at a dead centre of the drive.",
        ),
        Chart(
            "Ways to move",
            "time [s]",
            "count",
            [
                Series("by the spectrum's gap", t, np.array(report.mobility, float), "c0"),
                Series("singular values < 1e-6", t, np.array(report.small_singular_values, float), "c1", "dashed"),
            ],
            marks=marks,
            note="The count alone sees neither friction nor the drive.",
        ),
        Chart(
            "Smallest singular values of the joints' rows",
            "time [s]",
            "singular value",
            [Series("", t, np.maximum(values[:, k], SMALLEST), f"c{k}") for k in range(values.shape[1])],
            marks=marks,
            log_y=True,
        ),
    ]


def reactions(report: JamReport) -> list[Chart]:
    """Forces in the most loaded joints over time."""
    t = np.array(report.time_s)
    sizes = {id: np.linalg.norm(np.array(r.force_on_b_n), axis=-1) for id, r in report.reactions.items()}
    most = sorted(sizes, key=lambda id: -sizes[id].max(initial=0.0))[:MOST_JOINTS]
    series = [Series(id, t, sizes[id], f"c{k}") for k, id in enumerate(most)]
    return [Chart("Forces in the joints", "time [s]", "size [N]", series)] if series else []
