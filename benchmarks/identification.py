"""The paper's synthetic test, 10 scissor cells with play and friction: how far off are what we find?

python -m benchmarks.identification                 every noise, one load, data of ours and of Exudyn
python -m benchmarks.identification --quick         noise 0 and 0.2 mm, data of ours alone

The truth is 1 mm of play at every pin and 0.01 for friction, once as a contact coefficient and once as viscous damping
of every pin [N m s/rad]; searches begin at half the play and three times the friction.  Seen are markers at both ends
of every second bar, 240 times a second, while the spring opens the scissor.  Data of ours come from the engine that
fits them, so they show only what noise does; Exudyn's come from a penalty contact that shares nothing with ours.
"""

import argparse
import time
from typing import Any

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline

from backend.blind.exudyn_engine import simulate_exudyn
from backend.blind.poses import rotation_matrix
from backend.fit.fit_study import fit_study
from backend.fit.result import FitResult
from backend.fit.solve import LeastSquares, solve
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.read import parse_mechanism
from backend.mechanism.study import Experiment, Release, Study
from backend.simulate.run import simulate
from benchmarks.scissor import LENGTH_M, scissor

CELLS, RATE_HZ, STILL = 10, 240.0, 12
RADIAL_M, FRICTION = 1e-3, 0.01
LEAST_SIGMA_M = 1e-7  # what noise-free samples are said to be good for
FINE_STEP_S = {"ours": 1e-3, "Exudyn": 4e-5}
NOISE_M = (0.0, 2e-4, 1e-3, 5e-3)
FORMS = {
    "contact": ("clearance:play.radial_m", "clearance:play.friction_coefficient"),
    "viscous": ("clearance:play.radial_m", "viscous_friction:drag.damping_n_m_s_per_rad"),
}


def drawn(form: str, radial_m: float, friction: float, cells: int = CELLS) -> Mechanism:
    """The scissor with play at every pin, friction in one of two forms, markers at both ends of every second bar."""
    document = scissor(cells).model_dump(mode="json", exclude_none=True)
    pins = [joint["id"] for joint in document["joints"] if joint["type"] == "revolute"]
    play: dict[str, Any] = {"radial_m": radial_m}
    if form == "contact":
        play["friction_coefficient"] = friction
    else:
        drag = {"damping_n_m_s_per_rad": friction}
        document["effects"].append({"id": "drag", "kind": "viscous_friction", "on": pins, "parameters": drag})
    document["effects"].append({"id": "play", "kind": "clearance", "on": pins, "parameters": play})
    document["markers"] = [
        {"id": f"{bar}{i}{side}", "body": f"{bar}{i}", "position_m": [sign * 0.45 * LENGTH_M, 0.0, 0.0]}
        for i in range(0, cells, 2)
        for bar in ("a", "b")
        for side, sign in (("l", -1.0), ("r", 1.0))
    ]
    return parse_mechanism(document)


def marker_paths(mechanism: Mechanism, motion: Any) -> np.ndarray:
    """(T, markers, 3) in W, of anything with position_m and quaternion_wxyz by body."""
    paths = [
        motion.position_m[m.body] + rotation_matrix(motion.quaternion_wxyz[m.body]) @ np.array(m.position_m)
        for m in mechanism.markers
    ]
    return np.stack(paths, 1)


def filmed(form: str, engine: str, duration_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Sample times since the release, and (T, markers, 3) without noise."""
    mechanism, step_s = drawn(form, RADIAL_M, FRICTION), FINE_STEP_S[engine]
    if engine == "ours":
        motion = simulate(mechanism, duration_s, step_s)
    else:
        motion = simulate_exudyn(mechanism, duration_s, step_s, output_step_s=1e-3)
    paths = marker_paths(mechanism, motion)
    time_s = np.arange(0.0, duration_s, 1.0 / RATE_HZ)
    nodes = np.arange(paths.shape[0]) * (step_s if engine == "ours" else 1e-3)
    return time_s, CubicSpline(nodes, paths)(time_s)


def study_of(form: str, time_s: np.ndarray, paths: np.ndarray, noise_m: float, seed: int) -> Study:
    """The samples with noise, before them a few of the scissor held still; searches begin from the drawn values."""
    mechanism = drawn(form, 0.5 * RADIAL_M, 3.0 * FRICTION)
    rng = np.random.default_rng(seed)
    release = STILL / RATE_HZ
    time_s = np.concatenate([np.arange(STILL) / RATE_HZ, release + time_s])
    paths = np.concatenate([np.repeat(paths[:1], STILL, 0), paths])
    seen = paths + noise_m * rng.standard_normal(paths.shape)
    tables = [
        pd.DataFrame(
            {
                "time_s": time_s,
                "marker": marker.id,
                "x_m": seen[:, i, 0],
                "y_m": seen[:, i, 1],
                "z_m": np.nan,
                "sigma_m": max(noise_m, LEAST_SIGMA_M),
            }
        )
        for i, marker in enumerate(mechanism.markers)
    ]
    run = Experiment("run", "fit", Release(time_s=release), tracks=pd.concat(tables, ignore_index=True))
    return Study(mechanism, (run,))


def unscaled(result: FitResult, start: np.ndarray) -> np.ndarray:
    """L-BFGS-B as one would first write it: metres and coefficients side by side."""
    problem = result.residuals.problem()
    naive = LeastSquares(
        problem.names, problem.residual, problem.linearise, problem.lower, problem.upper, np.ones_like(problem.scale),
        problem.data_rows,
    )  # fmt: skip
    return solve(naive, start, optimiser="lbfgsb", max_iterations=60).x[:2]


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--duration", type=float, default=0.2)
    asked = parser.parse_args()
    truth = np.array([RADIAL_M, FRICTION])
    print(f"{CELLS} cells, {asked.duration:g} s, error of play and friction; the paper: 146% and 13%")
    head = f"{'friction':>9} {'data':>7} {'noise':>7} {'method':>18} {'play':>10} {'friction':>10}"
    print(f"{head} {'sd of each':>17} {'wall':>6}")
    for form, names in FORMS.items():
        for engine in ("ours",) if asked.quick else ("ours", "Exudyn"):
            time_s, paths = filmed(form, engine, asked.duration)
            for noise in NOISE_M[: 2 if asked.quick else None]:
                study = study_of(form, time_s, paths, noise, seed=3)
                for method, optimiser in (("default", "lm"), ("L-BFGS-B scaled", "lbfgsb")):
                    begin = time.perf_counter()
                    result = fit_study(study, names, optimiser=optimiser, profiles=False, step_s=1e-3)
                    wall = time.perf_counter() - begin
                    found = np.array([result.values[name] for name in names])
                    sd = result.uncertainty.sd[:2] / truth
                    off = found / truth - 1.0
                    print(
                        f"{form:>9} {engine:>7} {1e3 * noise:5.1f}mm {method:>18} {off[0]:10.2e} {off[1]:10.2e}"
                        f" {sd[0]:8.1e} {sd[1]:8.1e} {wall:5.0f}s {result.solution.status}"
                        f" chi2 {result.uncertainty.chi_square_per_point:.2f}",
                        flush=True,
                    )
                begin = time.perf_counter()
                start = result.residuals.start
                off = unscaled(result, start) / truth - 1.0
                wall = time.perf_counter() - begin
                what = f"{form:>9} {engine:>7} {1e3 * noise:5.1f}mm {'L-BFGS-B unscaled':>18}"
                print(f"{what} {off[0]:10.2e} {off[1]:10.2e} {'':>17} {wall:5.0f}s", flush=True)


if __name__ == "__main__":
    main()
