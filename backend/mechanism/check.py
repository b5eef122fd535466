"""The report of a drawing's graph, for people and for programs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from backend.mechanism.graph import GraphReport


def check_json(report: GraphReport) -> dict[str, Any]:
    """The report as plain data, ready for JSON."""
    return {"ok": report.ok, **report.model_dump(mode="json")}


def check_text(report: GraphReport) -> str:
    """The report in a screenful of sentences."""
    joints = ", ".join(f"{count} {type}" for type, count in sorted(report.joints.items())) or "none"
    lines = [
        f"{report.name}: {many(report.moving_bodies, 'moving body', 'moving bodies')}, "
        f"{many(report.fixed_bodies, 'fixed body', 'fixed bodies')}, joints: {joints}; "
        f"{many(report.effects, 'effect')}, {many(report.markers, 'marker')}",
        f"loops     {len(report.loops)}" + (": " + few(_loop_names(report)) if report.loops else ""),
        f"mobility  {_mobility(report)}",
        f"redundant {_redundant(report)}",
        f"closure   {_closure(report)}",
    ]
    if report.gravity_idle:
        lines.append("gravity   lies along the axes of all joints: nothing falls, as on a table")
    for found in report.contacts:
        pairs = few(["-".join(pair) for pair in found.pairs])
        lines.append(
            f"contacts  {found.effect}: {many(len(found.pairs), 'pair')} may meet"
            + (f": {pairs}" if pairs else "")
            + (f"; none meets {few(list(found.shapeless))}, drawn without a bar's shape" if found.shapeless else "")
        )
    lines += [f"error: {text}" for text in report.errors]
    lines += [f"warning: {text}" for text in report.warnings]
    return "\n".join(lines)


def many(count: int, one: str, several: str = "") -> str:
    """`1 joint`, `2 joints`."""
    return f"{count} {one if count == 1 else several or one + 's'}"


def few(names: Sequence[str], shown: int = 6) -> str:
    """The first names, and how many more there are."""
    rest = len(names) - shown
    return ", ".join(names[:shown]) + (f" and {rest} more" if rest > 0 else "")


def _loop_names(report: GraphReport) -> list[str]:
    return ["-".join(loop.joints) for loop in report.loops]


def _mobility(report: GraphReport) -> str:
    mobility = report.mobility
    plane = mobility.by_count_in_plane
    counted = f"{mobility.by_count_in_space} by count in space (Kutzbach)"
    if plane is not None:
        counted = f"{plane} by count in the plane (Grübler), {counted}"
    return f"{mobility.by_rank} by rank at the {mobility.pose} pose; {counted}"


def _redundant(report: GraphReport) -> str:
    mobility = report.mobility
    if not mobility.redundant_rows:
        return f"none of {mobility.rows} constraint rows"
    named = few([f"{joint} {count}" for joint, count in mobility.redundant_by_joint.items()])
    return f"{mobility.redundant_rows} of {mobility.rows} constraint rows, at {named}"


def _closure(report: GraphReport) -> str:
    if not report.closure:
        return "no joints"
    gap = max(report.closure, key=lambda joint: joint.gap_mm)
    turn = max(report.closure, key=lambda joint: joint.turn_deg)
    state = "all joints meet" if report.closes else "the joints do not meet"
    most = f"{gap.gap_mm:.3g} mm ({gap.joint}) and {turn.turn_deg:.3g} deg ({turn.joint})"
    return f"{state}; as drawn at most {most}"
