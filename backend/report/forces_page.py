"""The report of joint forces: where and when joints carry most, on which body, and which reactions are unique."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from backend.mechanism.mechanism import Mechanism
from backend.report.chart import Chart, Series
from backend.report.evidence import Motion
from backend.report.force_arrows import force_arrows
from backend.report.page import write_page
from backend.report.quantity import shown
from backend.report.skeleton import best_view, skeleton_of

if TYPE_CHECKING:
    from backend.simulate.joint_forces import JointLoad

MOST_CHARTS = 12
MOST_TOGETHER = 8
NOTHING = 1e-6  # of the largest: below it a component is the solver's rounding


def write_forces_page(
    mechanism: Mechanism,
    motion: Motion,
    loads: Sequence[JointLoad],
    path: str | Path,
    *,
    table: str,
    result: str = "done",
    solve: str = "compliance",
) -> Path:
    """Write forces.html; loads: strongest joint first; table: file that holds every number."""
    peaks = peak_table(motion.time_s, loads)
    node = int(np.argmax(loads[0].force_n)) if loads else 0
    when = float(motion.time_s[node])
    undecided = [load for load in loads if load.not_unique]
    return write_page(
        "forces.html",
        path,
        title=mechanism.name,
        headline=_headline(loads, when),
        cautions=[] if result == "done" else [result],
        key_figures=_figures(loads, when, len(undecided)),
        arrows=force_arrows(mechanism, motion, loads, node, f"At {shown(when)} s, the largest force") if loads else "",
        uniqueness=_uniqueness(loads, undecided, solve),
        peaks=peaks,
        together=_together(motion.time_s, loads),
        charts_of_joints=_charts(mechanism, motion, loads),
        left_out=f"The {MOST_CHARTS} joints that carry most are charted; {table} has all {len(loads)}."
        if len(loads) > MOST_CHARTS
        else "",
        table=table,
    )


def peak_table(time_s: np.ndarray, loads: Sequence[JointLoad]) -> list[dict[str, Any]]:
    """One row per joint: its largest force and torque, when, as vectors, and what is unique; plain data, SI."""
    most = max((float(load.torque_n_m.max()) for load in loads), default=0.0)
    rows = []
    for load in loads:
        force, torque = int(np.argmax(load.force_n)), int(np.argmax(load.torque_n_m))
        size, turns = float(load.force_n[force]), float(load.torque_n_m[torque])
        turns = turns if turns > NOTHING * most else 0.0
        rows.append(
            {
                "joint": load.joint,
                "type": load.type,
                "parent": load.parent.body,
                "child": load.child.body,
                "force_n": size,
                "force_at_s": float(time_s[force]),
                "unique_force_n": float(load.unique_force_n.max()) if load.not_unique is not None else None,
                "force_on_child_world_n": _cleared(load.child.force_W[force], size),
                "force_on_child_body_n": _cleared(load.child.force_B[force], size),
                "force_on_parent_body_n": _cleared(load.parent.force_B[force], size),
                "torque_n_m": turns,
                "torque_at_s": float(time_s[torque]) if turns else None,
                "uniqueness": load.uniqueness,
            }
        )
    return rows


def _cleared(vector: np.ndarray, size: float) -> list[float]:
    """Components that are rounding of the solver are written as zero."""
    return np.where(np.abs(vector) > NOTHING * size, vector, 0.0).tolist()


def _headline(loads: Sequence[JointLoad], when: float) -> str:
    if not loads:
        return "Nothing is joined, so no joint carries anything."
    first = loads[0]
    return (
        f"Joint {first.joint} carries most: {shown(float(first.force_n.max()))} N at {shown(when)} s, "
        f"between {first.parent.body} and {first.child.body}."
    )


def _figures(loads: Sequence[JointLoad], when: float, undecided: int) -> list[tuple[str, str]]:
    if not loads:
        return []
    torque = max(float(load.torque_n_m.max()) for load in loads)
    return [
        (f"{shown(float(loads[0].force_n.max()))} N", f"largest force, at {shown(when)} s"),
        (f"{shown(torque)} N m", "largest torque at a joint"),
        (str(len(loads)), "joints"),
        (str(undecided), "joints with reactions that are not unique"),
    ]


def _uniqueness(loads: Sequence[JointLoad], undecided: Sequence[JointLoad], solve: str) -> str:
    if any(load.not_unique is None for load in loads):
        return "Whether the reactions are unique was not examined: the mechanism has too many held rows."
    if not undecided:
        return "Every reaction is unique: statics and dynamics of rigid parts leave no choice."
    chosen = (
        "joints that give way alike" if solve == "compliance" else "redundant rows let go, which carry nothing then"
    )
    return (
        f"At {len(undecided)} of {len(loads)} joints rigid parts leave some reactions open: the mechanism is "
        "overconstrained, and what such a row carries depends on the parts' stiffness and on assembly. The numbers "
        f"below are those of {chosen}. The table says which; the others are unique."
    )


def _together(time_s: np.ndarray, loads: Sequence[JointLoad]) -> list[Chart]:
    series = [Series(load.joint, time_s, load.force_n, f"c{i}") for i, load in enumerate(loads[:MOST_TOGETHER])]
    return [Chart("Size of the force", "time [s]", "force [N]", series)] if series else []


def _charts(mechanism: Mechanism, motion: Motion, loads: Sequence[JointLoad]) -> list[Chart]:
    """Force against time per joint: what the child feels, and its mirror image on the parent."""
    view = best_view(skeleton_of(mechanism).placed(motion))
    names = "xyz"[int(np.argmax(view.right))], "xyz"[int(np.argmax(view.up))]
    charts = []
    for load in loads[:MOST_CHARTS]:
        series = [Series("size", motion.time_s, load.force_n, "measured")]
        for side, on in load.sides:
            style = "line" if side == "child" else "dashed"
            for k, (axis, tone) in enumerate(zip(names, ("c0", "c2"), strict=True)):
                series.append(Series(f"{axis} on {on.body}", motion.time_s, view.seen(on.force_W)[:, k], tone, style))
        charts.append(Chart(f"{load.joint}, {load.uniqueness}", "time [s]", "force, world axes [N]", series))
    return charts
