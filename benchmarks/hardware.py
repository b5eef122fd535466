"""A stand-in for the paper's hardware: 23 cells sprung open from the stowed pose, tracked with 1 mm of noise.

python -m benchmarks.hardware [--picture FILE]                    about ten minutes
python -m benchmarks.hardware --bed 0.6 --duration 0.7             friction stops it on its way
python -m benchmarks.hardware --engine MuJoCo                      another reality

The scissor is drawn by samples/scissor/design.py: two springs of 2870 N/m across its first two cells, pins of 8.0 mm in
holes of 8.8 mm (0.4 mm of play), bars side by side.  What is filmed is Exudyn's motion of it, with play and viscous
friction at all 67 pins, friction on the bed and bars that cannot pass through each other; the drawing knows the bars'
widths and nothing of the rest.  Exudyn's steps are explicit: Newton's method stalls where so many pins strike.
Searches begin at a quarter of the play and at no friction at all.  The paper's twin of its own hardware was 10 to 20 mm
off.  The fitted twin also foretells a deployment with weaker springs, which it never saw.
"""

import argparse
import json
import tempfile
import time
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline

from backend.blind.exudyn_engine import simulate_exudyn
from backend.blind.mujoco_engine import simulate_mujoco
from backend.fit.fit_study import fit_study
from backend.fit.result import FitResult
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.read import parse_mechanism
from backend.mechanism.study import Experiment, Release, Study
from backend.simulate.run import Run, simulate
from benchmarks.identification import marker_paths
from cad_export.script import export_script

CELLS, STOWED_DEG, WIDTH_M = 23, 85.35, 0.016
SPRING_N_PER_M, WEAKER_N_PER_M, FREE_SHARE = 2870.0, 2000.0, 0.8
PLAY_M, DRAG, BED = 4e-4, 3e-3, 0.1  # m, N m s/rad, 1
RATE_HZ, NOISE_M, STILL = 240.0, 1e-3, 12
NODES_S, MUJOCO_S, EXUDYN_S, FIT_S = 1e-3, 5e-5, 2e-6, 1e-3
GRAVITY = 9.81  # m/s²
FREE = (
    "clearance:play.radial_m",
    "viscous_friction:drag.damping_n_m_s_per_rad",
    "surface_friction:bed.friction_coefficient",
)


def drawing(spring_n_per_m: float = SPRING_N_PER_M) -> dict[str, Any]:
    """The exporter's document."""
    settings = {
        "cells": str(CELLS),
        "angle_deg": str(STOWED_DEG),
        "spring_n_per_m": str(spring_n_per_m),
        "free_length_share": str(FREE_SHARE),
        "spring_cells": "2",
        "hole_mm": str(8.0 + 2e3 * PLAY_M),
    }
    with tempfile.TemporaryDirectory() as folder:
        design = Path(__file__).parents[1] / "samples" / "scissor" / "design.py"
        return json.loads(export_script(design, folder, settings).read_text(encoding="utf-8"))


def with_effects(
    document: dict[str, Any], play_m: float | dict[str, float], drag: float, bed: float, **walls: float
) -> Mechanism:
    """The scissor with what a real one has; play_m: of all pins, 0 for none, or of each by its name."""
    pins = [joint["id"] for joint in document["joints"] if joint["type"] == "revolute"]
    bars = [body["id"] for body in document["bodies"] if body["id"][0] in "AB"]
    half = 0.5 * WIDTH_M
    ends = {f"{end}_{side}_m": [x, 0.0, 0.0] for side in "ab" for end, x in (("start", 0.0), ("end", 0.2))}
    effects: list[dict[str, Any]] = [
        {"id": "drag", "kind": "viscous_friction", "on": pins, "parameters": {"damping_n_m_s_per_rad": drag}},
        {"id": "bed", "kind": "surface_friction", "on": bars, "parameters": {"friction_coefficient": bed}},
    ]
    if isinstance(play_m, dict):
        effects += [
            {"id": f"play_{pin}", "kind": "clearance", "on": [pin], "parameters": {"radial_m": play_m[pin], **walls}}
            for pin in pins
        ]
    elif play_m:
        effects.append({"id": "play", "kind": "clearance", "on": pins, "parameters": {"radial_m": play_m, **walls}})
    for layer in "AB":
        for i in range(CELLS - 1):
            touch = {"radius_a_m": half, "radius_b_m": half, **ends}
            on = [f"{layer}{i}", f"{layer}{i + 1}"]
            effects.append({"id": f"touch_{layer}{i}", "kind": "link_contact", "on": on, "parameters": touch})
    return parse_mechanism({**document, "effects": document["effects"] + effects})


def tracked(mechanism: Mechanism, time_s: np.ndarray, paths: np.ndarray, seed: int) -> Study:
    """The motion as a camera's tracks, after some frames held by the latch."""
    rng = np.random.default_rng(seed)
    release = STILL / RATE_HZ
    time_s = np.concatenate([np.arange(STILL) / RATE_HZ, release + time_s])
    seen = np.concatenate([np.repeat(paths[:1], STILL, 0), paths])
    seen = seen + NOISE_M * rng.standard_normal(seen.shape)
    tables = [
        pd.DataFrame(
            {"time_s": time_s, "marker": marker.id, "x_m": seen[:, i, 0], "y_m": seen[:, i, 1], "z_m": np.nan}
        ).assign(sigma_m=NOISE_M)
        for i, marker in enumerate(mechanism.markers)
    ]
    run = Experiment("deployment", "fit", Release(time_s=release), tracks=pd.concat(tables, ignore_index=True))
    return Study(mechanism, (run,))


def at_samples(mechanism: Mechanism, motion: Run, time_s: np.ndarray, step_s: float = FIT_S) -> np.ndarray:
    """(T, markers, 2) in W."""
    paths = marker_paths(mechanism, motion)[..., :2]
    return CubicSpline(np.arange(len(paths)) * step_s, paths)(time_s)


def picture(time_s: np.ndarray, truth: np.ndarray, twins: dict[str, np.ndarray], path: Path) -> None:
    """How far every ninth node came, and the mean error in time."""
    figure, (above, errors) = plt.subplots(1, 2, figsize=(11, 4), width_ratios=(3, 2), layout="constrained")
    shown, milliseconds = range(0, truth.shape[1], 9), 1e3 * time_s
    for i in shown:
        above.plot(milliseconds, 1e3 * truth[:, i, 0], "k.", ms=3, label="filmed" if i == 0 else None)
    for (name, paths), colour in zip(twins.items(), ("tab:orange", "tab:blue", "tab:green"), strict=True):
        for i in shown:
            above.plot(milliseconds, 1e3 * paths[:, i, 0], color=colour, lw=1, label=name if i == 0 else None)
        error = 1e3 * np.linalg.norm(paths - truth, axis=-1)
        errors.plot(1e3 * time_s, error.mean(1), color=colour, label=name)
        errors.fill_between(1e3 * time_s, *np.quantile(error, (0.1, 0.9), axis=1), color=colour, alpha=0.2)
    errors.axhline(3.0, color="k", lw=0.5, ls=":")
    above.set(xlabel="time since the latch opened, ms", ylabel="x, mm", title="every ninth node")
    errors.set(xlabel="time since the latch opened, ms", ylabel="error of the nodes, mm", title="mean, 10% to 90%")
    errors.set(yscale="log", ylim=(1e-2, None))
    above.legend(fontsize=8)
    errors.legend(fontsize=8)
    figure.savefig(path, dpi=110)


def filmed(real: Mechanism, time_s: np.ndarray, engine: str = "MuJoCo", bed: float = BED) -> np.ndarray:
    """(T, markers, 3) in W, as another engine moves it."""
    until_s = float(time_s[-1]) + NODES_S
    if engine == "Exudyn":
        # What rubs on the bed may lose a third of its speed in a step, no more.
        creep = max(1e-5, 3.0 * bed * GRAVITY * EXUDYN_S)
        motion = simulate_exudyn(real, until_s, EXUDYN_S, output_step_s=NODES_S, explicit=True, friction_creep=creep)
    else:
        motion = simulate_mujoco(real, until_s, MUJOCO_S, output_step_s=NODES_S)
    return CubicSpline(motion.time_s, marker_paths(real, motion))(time_s)


def missed(name: str, at: np.ndarray, truth: np.ndarray) -> None:
    """Print how far nodes (T, markers, 2) are off."""
    error = 1e3 * np.linalg.norm(at - truth[..., :2], axis=-1)
    print(
        f"  {name:21}: mean node error {error.mean():.2f} mm, at the end {error[-1].mean():.2f} mm, "
        f"largest {error.max():.2f} mm",
        flush=True,
    )


def compared(name: str, twin: Mechanism, time_s: np.ndarray, truth: np.ndarray, step_s: float = FIT_S) -> np.ndarray:
    """The nodes (T, markers, 2) of a twin that starts where it is drawn, their errors printed."""
    at = at_samples(twin, simulate(twin, float(time_s[-1]) + 2.0 * step_s, step_s), time_s, step_s)
    missed(name, at, truth)
    return at


def as_fitted(result: FitResult, mechanism: Mechanism) -> np.ndarray:
    """The nodes (T, markers, 2) of the fit's own motion, which starts where the filmed one was found to start."""
    of = {overlay.at: overlay for overlay in result.overlays}
    seen = [of[f"marker:{marker.id}"] for marker in mechanism.markers]
    return np.stack([o.after[o.time_s >= o.release_s, :2] for o in seen], axis=1)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--duration", type=float, default=0.2)
    parser.add_argument("--bed", type=float, default=BED, help="coefficient of friction on the bed")
    parser.add_argument("--engine", choices=("Exudyn", "MuJoCo"), default="Exudyn", help="that moves what is filmed")
    parser.add_argument("--picture", type=Path)
    asked = parser.parse_args()
    document, weaker = drawing(), drawing(WEAKER_N_PER_M)
    begin = time.perf_counter()
    real = with_effects(document, PLAY_M, DRAG, asked.bed)
    time_s = np.arange(0.0, asked.duration, 1.0 / RATE_HZ)
    paths = filmed(real, time_s, asked.engine, asked.bed)
    length = 1e3 * np.ptp(paths[..., 0], axis=1)
    speed = np.linalg.norm(paths[-1] - paths[-2], axis=-1).mean() * RATE_HZ
    print(
        f"{CELLS} cells, {len(real.markers)} nodes: {asked.engine}'s motion in {time.perf_counter() - begin:.0f} s",
        flush=True,
    )
    print(f"  from {length[0]:.0f} to {length[-1]:.0f} mm, where its nodes move at {1e3 * speed:.1f} mm/s", flush=True)
    begin = time.perf_counter()
    study = tracked(with_effects(document, 0.25 * PLAY_M, 0.0, 0.0), time_s, paths, seed=1)
    result = fit_study(
        study, FREE, profiles=False, step_s=FIT_S,
        progress=lambda share, words: print(f"  {time.perf_counter() - begin:5.0f} s  {words}", flush=True),
    )  # fmt: skip
    print(f"fitted in {time.perf_counter() - begin:.0f} s: {result.solution.message}")
    for found, truth in zip(result.report.parameters, (PLAY_M, DRAG, asked.bed), strict=True):
        off = f"truth {truth:.4g}  ({100 * (found.value / truth - 1):+.1f}%)"
        low, high = found.ci95
        print(f"  {found.name:45} {found.value:.4g} +- {found.sd:.2g}, 95% {low:.3g} to {high:.3g}   {off}")
    print(f"  chi-square per sample {result.uncertainty.chi_square_per_point:.2f}", flush=True)
    found = tuple(result.values[name] for name in FREE)
    drawn = with_effects(document, 0.0, 0.0, 0.0)
    seen = {
        "as drawn": compared("as drawn", drawn, time_s, paths),
        "fitted": compared("fitted", with_effects(document, *found), time_s, paths),
        "fitted, its own start": as_fitted(result, real),
    }
    missed("fitted, its own start", seen["fitted, its own start"], paths)
    for step_s in (FIT_S, 0.25 * FIT_S):
        compared(f"true, at {1e3 * step_s:.2f} ms", real, time_s, paths, step_s)
    unseen = filmed(with_effects(weaker, PLAY_M, DRAG, asked.bed), time_s, asked.engine, asked.bed)
    print(f"springs of {WEAKER_N_PER_M:.0f} N/m, which the fit never saw:")
    compared("as drawn", with_effects(weaker, 0.0, 0.0, 0.0), time_s, unseen)
    compared("fitted", with_effects(weaker, *found), time_s, unseen)
    if asked.picture:
        picture(time_s, paths[..., :2], seen, asked.picture)


if __name__ == "__main__":
    main()
