"""A simulated motion in a few lines, and as evidence for its page."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from backend.mechanism.mechanism import Mechanism
from backend.report.evidence import Motion, SimulationEvidence
from backend.report.quantity import shown

if TYPE_CHECKING:
    from backend.simulate.run import Run

MOST_JOINTS = 8


def simulation_evidence(mechanism: Mechanism, run: Run, forces_page: str = "") -> SimulationEvidence:
    """A run as its page wants it; fixed bodies do not move and are left out."""
    from backend.model.flexible import split

    mechanism = split(mechanism)
    moving = [body.id for body in mechanism.bodies if body.id in run.position_m and not body.fixed]
    return SimulationEvidence(
        mechanism=mechanism,
        motion=Motion(
            run.time_s,
            {body: run.position_m[body] for body in moving},
            {body: run.quaternion_wxyz[body] for body in moving},
        ),
        joint_positions=run.q,
        kinetic_j=run.kinetic_j,
        potential_j=run.potential_j,
        constraint_error_m=run.constraint_error_m,
        step_s=run.step_s,
        result=run.result,
        redundancy=run.redundancy.sentence() if run.redundancy else "",
        forces_page=forces_page,
    )


def summary_json(run: Run) -> dict[str, Any]:
    """What came of a run, as plain data: SI, names as in run.h5."""
    total = run.kinetic_j + run.potential_j
    return {
        "schema_version": "1.0",
        "mechanism": run.mechanism,
        "result": run.result,
        "duration_s": float(run.time_s[-1]),
        "step_s": run.step_s,
        "steps": len(run.time_s) - 1,
        "joints": {
            id: {"start": float(q[0]), "end": float(q[-1]), "lowest": float(q.min()), "highest": float(q.max())}
            for id, q in run.q.items()
        },
        "largest_reaction_n": {
            id: float(np.linalg.norm(force, axis=-1).max()) for id, force in run.reaction_force_n.items()
        },
        "energy_j": {"start": float(total[0]), "end": float(total[-1]), "most_kinetic": float(run.kinetic_j.max())},
        "constraint_error_m": float(run.constraint_error_m.max()),
        "solve": run.solve,
        "redundancy": _redundancy_json(run),
        "remarks": _remarks(run),
    }


def _redundancy_json(run: Run) -> dict[str, Any] | None:
    found = run.redundancy
    if found is None:
        return None
    return {
        "rows": len(found.rows),
        "rank": found.rank,
        "mobility": found.mobility,
        "redundant": [list(row) for row in found.redundant],
        "shared_by": [list(joints) for joints in found.shared],
        "reactions_not_unique": {joint: list(rows) for joint, rows in found.not_unique.items()},
        "idle": [motion.bodies[0] for motion in found.motions if motion.idle],
    }


def _remarks(run: Run) -> list[str]:
    """What is redundant, and how that was dealt with; steps that were solved in pieces."""
    said = [run.redundancy.sentence()] if run.redundancy else []
    said += [run.kept.sentence(len(run.time_s) - 1)] if run.kept else []
    if run.cut:
        said.append(
            f"{run.cut} of {len(run.time_s) - 1} steps had to be cut to be solved; in them blows give nothing back "
            f"and friction may lag: try a smaller step than {run.step_s:g} s"
        )
    return [sentence for sentence in said if sentence]


def summary_text(summary: Mapping[str, Any]) -> str:
    """A `summary_json` in a screenful."""
    s, joints, energy = summary, summary["joints"], summary["energy_j"]
    lines = [f"{s['mechanism']}: {shown(s['duration_s'], 4)} s in {s['steps']} steps, {s['result']}"]
    for id, q in list(joints.items())[:MOST_JOINTS]:
        start, end, low, high = (shown(q[name], 4) for name in ("start", "end", "lowest", "highest"))
        most = shown(s["largest_reaction_n"][id])
        lines.append(f"joint {id:<12} {start} to {end}, within {low} … {high}; reaction up to {most} N")
    if len(joints) > MOST_JOINTS:
        lines.append(f"and {len(joints) - MOST_JOINTS} more joints, in the motion file")
    lines.append(f"energy      {shown(1e3 * energy['start'])} to {shown(1e3 * energy['end'])} mJ")
    lines.append(f"constraints within {shown(s['constraint_error_m'])} m")
    return "\n".join([*lines, *s["remarks"]])
