"""The report of a simulated motion: what moved, and whether energy and constraints say it can be trusted."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from backend.report.chart import Chart, Series
from backend.report.evidence import Overlay, SimulationEvidence
from backend.report.page import write_page
from backend.report.quantity import shown

MOST_JOINTS = 8


def write_simulation_page(evidence: SimulationEvidence, path: str | Path) -> Path:
    """Write the report as one HTML file; returns its path."""
    t = evidence.motion.time_s
    worst = float(np.max(evidence.constraint_error_m, initial=0.0))
    return write_page(
        "simulation.html",
        path,
        title=evidence.mechanism.name,
        headline=f"{shown(float(t[-1]))} s simulated in steps of {shown(1e3 * evidence.step_s)} ms.",
        cautions=[] if evidence.result in ("", "done") else [evidence.result],
        key_figures=[
            (str(len(evidence.motion.position_m)), "bodies"),
            (str(len(evidence.joint_positions)), "joints that move"),
            (f"{shown(1e3 * float(np.max(evidence.kinetic_j)))} mJ", "most kinetic energy"),
            (f"{shown(1e3 * worst)} mm", "worst constraint error"),
        ],
        mechanism=evidence.mechanism,
        overlay=Overlay(evidence.mechanism.name, evidence.motion),
        joints=joint_charts(evidence),
        left_out=_left_out(len(evidence.joint_positions)),
        trust=_trust(evidence),
        checks=checks(evidence),
        redundancy=evidence.redundancy,
        forces_page=evidence.forces_page,
    )


def joint_charts(evidence: SimulationEvidence) -> list[Chart]:
    """Joint coordinates over time, turning and sliding apart."""
    t, charts = evidence.motion.time_s, []
    for slides, label, factor in ((False, "q [deg]", np.degrees(1.0)), (True, "q [mm]", 1e3)):
        ids = [id for id in evidence.joint_positions if (evidence.mechanism.joint(id).type == "prismatic") == slides]
        series = [
            Series(id, t, factor * evidence.joint_positions[id], f"c{i}") for i, id in enumerate(ids[:MOST_JOINTS])
        ]
        if series:
            charts.append(Chart("Sliding joints" if slides else "Turning joints", "time [s]", label, series))
    return charts


def _left_out(count: int) -> str:
    return (
        f"The first {MOST_JOINTS} joints of each kind are charted; run.h5 has all {count}."
        if count > MOST_JOINTS
        else ""
    )


def _trust(evidence: SimulationEvidence) -> str:
    total = evidence.kinetic_j + evidence.potential_j
    change = 1e3 * float(total[-1] - total[0])
    kinds = {effect.kind for effect in evidence.mechanism.effects}
    losing = sorted(k for k in kinds if "friction" in k or "drag" in k)
    driving = sorted(k for k in kinds if k.startswith(("applied_", "prescribed_", "effort_")))
    said = f"Total energy changes by {shown(change)} mJ from start to end. "
    if losing or driving:
        return said + f"It may: the drawing has {', '.join([*losing, *driving])}. "
    return said + "Nothing in the drawing adds or removes energy, so this is the error of the integration."


def checks(evidence: SimulationEvidence) -> list[Chart]:
    """Energy and open joints over time: whether the motion can be trusted."""
    t = evidence.motion.time_s
    kinetic, potential = 1e3 * evidence.kinetic_j, 1e3 * (evidence.potential_j - evidence.potential_j[0])
    energy = [
        Series("kinetic", t, kinetic, "c0"),
        Series("potential, from its start", t, potential, "c1"),
        Series("sum", t, kinetic + potential, "measured", "dashed"),
    ]
    error = [Series("", t, evidence.constraint_error_m, "c0")]
    positive = bool(np.any(evidence.constraint_error_m > 0))
    return [
        Chart("Energy", "time [s]", "energy [mJ]", energy),
        Chart("How far the joints stand open", "time [s]", "error [m]", error, log_y=positive),
    ]
