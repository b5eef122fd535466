"""Whether it jams in a few lines, and as evidence for its page."""

from __future__ import annotations

from typing import TYPE_CHECKING

from backend.mechanism.jam_report import JamReport
from backend.report.evidence import JamEvidence, Motion
from backend.report.quantity import shown

if TYPE_CHECKING:
    from backend.jam.run import Jam


def jam_evidence(found: Jam) -> JamEvidence:
    """A finding as its page wants it; fixed bodies do not move and are left out."""
    run, fixed = found.run, {body.id for body in found.mechanism.bodies if body.fixed}
    moving = [body for body in run.position_m if body not in fixed]
    motion = Motion(run.time_s, {b: run.position_m[b] for b in moving}, {b: run.quaternion_wxyz[b] for b in moving})
    return JamEvidence(found.mechanism, motion, found.report)


def jam_text(report: JamReport) -> str:
    """What was found, in a screenful."""
    lines = [report.sentence]
    if report.lever is not None:
        lines.append(
            f"lever       {shown(report.lever)} of the drive would accelerate a copy without friction and play"
        )
    cone = report.friction_cone
    if cone and cone.holds and cone.friction_needed:
        held = f", up to {shown(cone.drive_held)} times the drive" if cone.drive_held is not None else ""
        lines.append(f"friction    {shown(cone.friction_needed)} of it is enough to hold the drive{held}")
    counted = f"{report.small_singular_values[0]} to {report.small_singular_values[-1]}"
    gap = f"{report.mobility[0]} to {report.mobility[-1]}"
    lines.append(f"mobility    {gap} by the spectrum's gap, {counted} by values below 1e-6")
    return "\n".join(lines)
