"""One worn pin among the 67 of 23 cells sprung open: named by a sparse fit, and measured.

python -m benchmarks.one_bad_joint [--pin mid9] [--play-mm 1.0] [--seed 1]      about fifteen minutes

The stand-in of `benchmarks.hardware`, MuJoCo's motion with 1 mm of noise, with one pin that has more play than the
0.4 mm of the others.  The fit is told neither the play of any pin nor the friction on the bed and at the pins.
"""

import argparse
import time

import numpy as np
from scipy.interpolate import CubicSpline

from backend.blind.mujoco_engine import simulate_mujoco
from backend.fit.fit_study import fit_study
from benchmarks import hardware
from benchmarks.identification import marker_paths

WALLS = {"stiffness_n_per_m": 1e10, "restitution": 0.0, "friction_coefficient": 0.0}  # stated, as a maker of pins would
FREE = ("clearance:*", "viscous_friction:drag.damping_n_m_s_per_rad", "surface_friction:bed.friction_coefficient")


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--pin", default="mid9")
    parser.add_argument("--play-mm", type=float, default=1.0)
    parser.add_argument("--duration", type=float, default=0.2)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    document = hardware.drawing()
    pins = [joint["id"] for joint in document["joints"] if joint["type"] == "revolute"]
    even = dict.fromkeys(pins, hardware.PLAY_M)
    begin = time.perf_counter()
    real = hardware.with_effects(document, even | {asked.pin: 1e-3 * asked.play_mm}, hardware.DRAG, hardware.BED)
    motion = simulate_mujoco(real, asked.duration, hardware.MUJOCO_S, output_step_s=hardware.NODES_S)
    time_s = np.arange(0.0, asked.duration, 1.0 / hardware.RATE_HZ)
    paths = CubicSpline(motion.time_s, marker_paths(real, motion))(time_s)
    print(f"{len(pins)} pins: filmed in {time.perf_counter() - begin:.0f} s", flush=True)
    begin = time.perf_counter()
    drawn = hardware.with_effects(document, dict.fromkeys(pins, 0.5 * hardware.PLAY_M), 0.0, 0.0, **WALLS)
    found = fit_study(
        hardware.tracked(drawn, time_s, paths, asked.seed), FREE, sparse=True, profiles=False, step_s=hardware.FIT_S,
        progress=lambda share, words: print(f"  {time.perf_counter() - begin:5.0f} s  {words}", flush=True),
    )  # fmt: skip
    report, misfit = found.report, found.uncertainty.chi_square_per_point
    print(f"fitted in {time.perf_counter() - begin:.0f} s, chi-square per sample {misfit:.3f}")
    for value in report.parameters:
        sd = "unknown" if value.sd is None else f"{value.sd:.2g}"
        print(f"  {value.name:50} {value.value:.4g} +- {sd} {value.unit}")
    for one in report.deviations:
        print(f"  deviates: {one.name} from {one.others} by {one.difference:.4g} +- {one.sd} {one.unit}")
        print(f"    could also be: {', '.join(one.could_be) or 'nowhere else'}")
    for sentence in report.warnings:
        print(f"  {sentence}")
    more = 1e-3 * asked.play_mm - hardware.PLAY_M
    print(f"truth: {asked.pin}, {more:.4g} m more than the others' {hardware.PLAY_M:g} m")


if __name__ == "__main__":
    main()
