"""What a diagnosis costs, compiling apart: a four-bar, and a scissor of ten cells.

python -m benchmarks.diagnosis [--cells N] [--only fourbar|scissor]      about twenty minutes

Six releases of two seconds at 90 frames/s with 0.5 mm of noise; reality is MuJoCo's motion with dry friction at one
joint that the drawing does not have. A second study of the same mechanism, other noise, goes through the same programs.
"""

import argparse
import time
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline

from backend.blind.mujoco_engine import simulate_mujoco
from backend.diagnose.library import SMOOTH, library
from backend.diagnose.run import diagnose_study
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.read import parse_mechanism, read_mechanism
from backend.mechanism.study import Experiment, Release, Study
from benchmarks.compiling import COMPILING
from benchmarks.identification import marker_paths
from benchmarks.scissor import scissor

RATE_HZ, SECONDS, NOISE_M, STILL = 90.0, 2.0, 5e-4, 20
AXES = ("x_m", "y_m", "z_m")
STEP_S, NODE_S = 2e-4, 2e-3
RELEASES = 6, 4  # made, and fitted


def rubbing(mechanism: Mechanism, joint: str, torque_n_m: float) -> Mechanism:
    """The mechanism with dry friction at one joint."""
    rub = {"id": "rub", "kind": "coulomb_friction", "on": [joint], "parameters": {"friction_torque_n_m": torque_n_m}}
    document = mechanism.model_dump(mode="json", exclude_none=True)
    return parse_mechanism({**document, "effects": [*document.get("effects", []), rub]})


def filmed(drawing: Mechanism, reality: Mechanism, released: str, positions: np.ndarray) -> list[np.ndarray]:
    """(frames, markers, 3) of every release, without noise."""
    time_s = np.arange(0.0, SECONDS, 1.0 / RATE_HZ)
    seen = []
    for q in positions:
        motion = simulate_mujoco(
            reality, SECONDS, STEP_S, output_step_s=NODE_S, initial_joint_positions={released: float(q)}
        )
        seen.append(CubicSpline(motion.time_s, marker_paths(drawing, motion))(time_s))
    return seen


def study_of(drawing: Mechanism, paths: list[np.ndarray], seed: int) -> Study:
    """The releases as tracks, after some frames at rest."""
    rng, release, experiments = np.random.default_rng(seed), STILL / RATE_HZ, []
    for k, path in enumerate(paths):
        seen = np.concatenate([np.repeat(path[:1], STILL, 0), path])
        time_s = np.arange(len(seen)) / RATE_HZ
        spread = np.ptp(np.concatenate(paths), axis=(0, 1))
        seen = np.where(spread > 1e-9, seen + NOISE_M * rng.standard_normal(seen.shape), np.nan)
        tables = [
            pd.DataFrame({"time_s": time_s, "marker": m.id, **{a: seen[:, i, k] for k, a in enumerate(AXES)}})
            for i, m in enumerate(drawing.markers)
        ]  # fmt: skip
        use = "fit" if k < RELEASES[1] else "held_out"
        table = pd.concat(tables, ignore_index=True).assign(sigma_m=NOISE_M)
        experiments.append(Experiment(f"release {k}", use, Release(time_s=release), tracks=table))
    return Study(drawing, tuple(experiments))


def report(name: str, drawing: Mechanism, joint: str, torque_n_m: float, positions: np.ndarray) -> None:
    """Two studies of one mechanism, timed."""
    paths = filmed(drawing, rubbing(drawing, joint, torque_n_m), joint, positions)
    print(f"\n{name}: {len(library(drawing, SMOOTH).candidates)} smooth candidates, {len(paths)} releases", flush=True)
    for seed in (1, 2):
        COMPILING.clear()
        began = time.perf_counter()
        found = diagnose_study(study_of(drawing, paths, seed)).report
        wall = time.perf_counter() - began
        print(f"  {wall:.0f} s, {sum(COMPILING):.0f} of them compiling: {found.verdict}: {found.sentence}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--cells", type=int, default=10)
    parser.add_argument("--only", choices=("fourbar", "scissor"))
    asked = parser.parse_args()
    if asked.only != "scissor":
        drawing = read_mechanism(Path(__file__).parents[1] / "samples" / "fourbar" / "mechanism.json")
        joint = next(j.id for j in drawing.joints if j.type == "revolute")
        report("four-bar", drawing, joint, 2e-3, np.linspace(-0.5, 0.5, RELEASES[0]))
    if asked.only != "fourbar":
        drawing = scissor(asked.cells)
        report(f"scissor of {asked.cells} cells", drawing, "mid0", 2e-3, np.linspace(-0.25, 0.25, RELEASES[0]))


if __name__ == "__main__":
    main()
