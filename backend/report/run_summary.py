"""A simulated motion in a few lines, and as evidence for its page."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from backend.mechanism.mechanism import Mechanism
from backend.model.flexible import split
from backend.report.evidence import Motion, SimulationEvidence
from backend.report.quantity import shown

if TYPE_CHECKING:
    from backend.simulate.run import Run

MOST_JOINTS = 8


def simulation_evidence(mechanism: Mechanism, run: Run, forces_page: str = "") -> SimulationEvidence:
    """A run as its page wants it; fixed bodies do not move and are left out."""
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


def summary_text(run: Run) -> str:
    """What came of a run, in a screenful."""
    total = run.kinetic_j + run.potential_j
    lines = [f"{run.mechanism}: {shown(float(run.time_s[-1]), 4)} s in {len(run.time_s) - 1} steps, {run.result}"]
    for id, q in list(run.q.items())[:MOST_JOINTS]:
        start, end, low, high = (shown(float(value), 4) for value in (q[0], q[-1], q.min(), q.max()))
        most = shown(float(np.linalg.norm(run.reaction_force_n[id], axis=-1).max()))
        lines.append(f"joint {id:<12} {start} to {end}, within {low} … {high}; reaction up to {most} N")
    if len(run.q) > MOST_JOINTS:
        lines.append(f"and {len(run.q) - MOST_JOINTS} more joints, in the motion file")
    lines.append(f"energy      {shown(1e3 * float(total[0]))} to {shown(1e3 * float(total[-1]))} mJ")
    lines.append(f"constraints within {shown(float(run.constraint_error_m.max()))} m")
    if run.redundancy and (said := run.redundancy.sentence()):
        lines.append(said)
    if run.kept:
        lines.append(run.kept.sentence(len(run.time_s) - 1))
    return "\n".join(lines)
