"""Joint forces on disk: forces.csv, a table that finite-element tools take as load cases."""

from pathlib import Path

import numpy as np
import pandas as pd

from backend.simulate.joint_forces import JointLoad
from backend.simulate.run import Run

MOST_LINES = 200_000  # 60 MB; longer motions are thinned, their peaks kept
AXES = ("x", "y", "z")

HEADER = """\
# Joint forces of '{name}', {steps} steps of {step_s:g} s{thinned}.
# One line per time, joint and side: what the joint puts ON that body (parent: the joint's body_a; child: its body_b).
# Units: s, m, N, N m. Torques are about the joint's point on the same body, whose place stands in the same line.
# Frames: _world is the drawing's right-handed world frame; _body is the body's own, its CAD part's origin and axes.
# Parent and child take equal and opposite forces. Friction, springs and drives inside the joint are included.
# A force is the impulse around its time over that span of time, so a blow stands as its mean over one step.
# unique: yes; or what rigid parts leave undetermined, in the joint's frame on the parent (z is the joint's axis).
# {choice}
"""
CHOICES = {
    "compliance": "Where it is not unique, the value is that of joints which give way alike (docs/redundancy.md).",
    "reduced": "Where it is not unique, the value is that of redundant rows let go (docs/redundancy.md).",
}


def write_forces(run: Run, loads: tuple[JointLoad, ...], path: str | Path) -> Path:
    """Write forces.csv, its header in lines that begin with #; returns its path."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    kept, thinned = _kept(run, loads)
    header = HEADER.format(
        name=run.mechanism.replace("\n", " "), steps=len(run.time_s) - 1, step_s=run.step_s, thinned=thinned,
        choice=CHOICES[run.solve],
    )  # fmt: skip
    frames = [_lines(run.time_s[kept], load, kept) for load in loads]
    with path.open("w", encoding="utf-8") as file:
        file.write(header)
        if frames:
            table = pd.concat(frames).sort_values("time_s", kind="stable")
            table.to_csv(file, index=False, float_format="%.9g", lineterminator="\n")
    return path


def _kept(run: Run, loads: tuple[JointLoad, ...]) -> tuple[np.ndarray, str]:
    """Nodes that are written: all, or every so many and each joint's peaks."""
    nodes = len(run.time_s)
    every = -(-2 * len(loads) * nodes // MOST_LINES) or 1
    peaks = {int(np.argmax(size)) for load in loads for size in (load.force_n, load.torque_n_m)} if every > 1 else set()
    kept = np.array(sorted({*range(0, nodes, every), *peaks}), dtype=int)
    return kept, f"; every {every}th step and each joint's peaks" if every > 1 else ""


def _lines(time_s: np.ndarray, load: JointLoad, kept: np.ndarray) -> pd.DataFrame:
    sides = []
    for side, on in load.sides:
        columns: dict[str, np.ndarray | str] = {"time_s": time_s, "joint": load.joint, "side": side, "body": on.body}
        vectors = {
            ("point", "world", "m"): on.point_W[kept],
            ("force", "world", "n"): on.force_W[kept],
            ("torque", "world", "n_m"): on.torque_W[kept],
            ("point", "body", "m"): np.tile(on.point_B, (len(kept), 1)),
            ("force", "body", "n"): on.force_B[kept],
            ("torque", "body", "n_m"): on.torque_B[kept],
        }
        for (what, frame, unit), values in vectors.items():
            columns |= {f"{what}_{axis}_{frame}_{unit}": values[:, k] for k, axis in enumerate(AXES)}
        columns["unique"] = "yes" if load.not_unique == () else load.uniqueness
        sides.append(pd.DataFrame(columns))
    return pd.concat(sides)
