"""Friction of every pin of a scissor by itself: slopes with every simulation, slopes forwards, adjoint gradients.

python -m benchmarks.many_joints [--cells 10 23] [--duration 0.5] [--ways adjoint forward together] [--profiles]

Exudyn moves a scissor of uneven bars, whose pins rub between half and twice as much as drawn; seen are the angles of
all pins, 240 times a second with 0.2 mrad of noise.  Fits begin at the drawing's value, held by a tolerance of its
size.  Each way goes twice: the first time compiles.  Times are processor time, then that of a clock on the wall.
"""

import argparse
import time
from dataclasses import replace
from typing import get_args

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline

from backend.blind.exudyn_engine import simulate_exudyn
from backend.fit.fit_study import fit_study
from backend.fit.price import Way
from backend.fit.result import FitResult
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.read import parse_mechanism
from backend.mechanism.study import Experiment, Release, Study, Tolerance
from tests.fit.test_sparse import uneven_scissor

DAMPING, SPREAD = 2e-3, 0.5  # drawn [N m s/rad]; of the logarithm of the true ones
UNEVEN_M, RATE_HZ, SIGMA_RAD, NODES_S = 5e-3, 240.0, 2e-4, 1e-3


def drawn(cells: int, damping: dict[str, float] | None = None) -> Mechanism:
    """A scissor with pins off their middles and viscous friction at each."""
    document = uneven_scissor(DAMPING, cells, UNEVEN_M).model_dump(mode="json", exclude_none=True)
    for effect in document["effects"]:
        if damping is not None and effect["kind"] == "viscous_friction":
            effect["parameters"]["damping_n_m_s_per_rad"] = damping[effect["on"][0]]
    return parse_mechanism(document)


def measured(cells: int, duration_s: float, seed: int = 1) -> Study:
    """All pins' angles, as Exudyn moves them, with noise."""
    rng = np.random.default_rng(seed)
    drawing = drawn(cells)
    pins = [joint.id for joint in drawing.joints if joint.type == "revolute"]
    truth = dict(zip(pins, DAMPING * np.exp(SPREAD * rng.standard_normal(len(pins))), strict=True))
    motion = simulate_exudyn(drawn(cells, truth), duration_s, NODES_S, output_step_s=NODES_S)
    time_s = np.arange(0.0, duration_s, 1.0 / RATE_HZ)
    tables = []
    for pin in pins:
        angle = motion.joint_positions[pin]
        q = CubicSpline(np.arange(angle.size) * NODES_S, angle)(time_s) + SIGMA_RAD * rng.standard_normal(time_s.size)
        tables.append(pd.DataFrame({"time_s": time_s, "joint": pin, "q": q, "sigma": SIGMA_RAD}))
    run = Experiment("opening", "fit", Release(time_s=0.0), joint_positions=pd.concat(tables, ignore_index=True))
    loose = [Tolerance(kind="viscous_friction", on=(pin,), sd=DAMPING) for pin in pins]
    return Study(drawing, (run,), tuple(loose))


def fitted(study: Study, way: Way, profiles: bool) -> FitResult:
    """The fit, and what it took."""
    begin, began = time.process_time(), time.perf_counter()
    result = fit_study(study, [], profiles=profiles, derivatives=way)
    spent, passed = time.process_time() - begin, time.perf_counter() - began
    print(
        f"  {way:9} {spent:7.1f} s, {passed:6.1f} s, {len(result.report.history)} iterations, objective "
        f"{result.solution.objective:.3f}",
        flush=True,
    )
    return result


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--cells", type=int, nargs="*", default=[10, 23])
    parser.add_argument("--duration", type=float, default=0.5)
    parser.add_argument("--ways", nargs="*", choices=get_args(Way), default=["adjoint", "forward", "together"])
    parser.add_argument("--profiles", action="store_true", help="likelihood intervals as well, as the command line has")
    asked = parser.parse_args()
    for cells in asked.cells:
        study = measured(cells, asked.duration)
        print(f"{cells} cells, {len(study.tolerances)} pins", flush=True)
        ends = [[fitted(study, way, asked.profiles) for way in asked.ways] for _ in range(2)][-1]
        first, sd = ends[0], ends[-1].uncertainty.sd
        print(f"  by cost: {replace(first.residuals, way=None).derivatives}")
        apart = np.max(np.abs(first.solution.x - ends[-1].solution.x) / sd)
        print(
            f"  first and last way: {apart:.1g} sd apart, sd {np.max(np.abs(first.uncertainty.sd / sd - 1)):.1g}",
            flush=True,
        )
        if asked.profiles:
            one, other = (
                np.array([i.profile or (None, None) for i in e.report.identifiability], float)
                for e in (first, ends[-1])
            )
            print(f"  ends of their profiles: {np.nanmax(np.abs(one - other) / sd[: len(one), None]):.1g} sd apart")


if __name__ == "__main__":
    main()
