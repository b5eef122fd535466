"""Friction of a 10-cell rigid scissor from Exudyn's data: our fit beside MuJoCo's toolbox, in one run.

python -m benchmarks.sysid                 everything below
python -m benchmarks.sysid race            both from starts 3x high and 3x low: errors, wall time to 0.3%
python -m benchmarks.sysid reversal        the same on a record in which every pin stops and turns back
python -m benchmarks.sysid coverage        how often 95% intervals hold the truth, over 40 draws of the noise
python -m benchmarks.sysid swing           a real pendulum's long free swing with four terms, from default values

Shared by all pins are 5 mN m s/rad of viscous damping and 3 mN m of Coulomb friction.  Seen are the angles of three
pins, 240 times a second, with noise of 0.2 mrad.  Times are wall times without compiling, medians of repeats taken in
turns, so that their ratio holds on a busy machine.  MuJoCo's side needs what `mujoco[sysid]` installs, the swing the
measurements (LINKTWIN_DATA, or ../shared/data beside the repository).
"""

import argparse
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline

from backend.blind.exudyn_engine import simulate_exudyn
from backend.fit.fit_study import fit_study
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.read import parse_mechanism, read_study
from backend.mechanism.study import Experiment, Release, Study
from benchmarks import mujoco_sysid
from benchmarks.mujoco_sysid import Found, Settings
from benchmarks.scissor import scissor

CELLS, ANGLE_RAD, SPRING_N_PER_M = 10, 0.9, 300.0
TRUTH = np.array([5e-3, 3e-3])  # viscous [N m s/rad], Coulomb [N m]
FREE = ("viscous_friction:drag.damping_n_m_s_per_rad", "coulomb_friction:rub.friction_torque_n_m")
SEEN = ("mid0", "mid4", "mid9")
RATE_HZ, SIGMA_RAD = 240.0, 2e-4
ENOUGH, STALLED = 3e-3, 0.2  # relative errors: what is asked of both parameters, and what nobody would call a fit
STARTS = {"3x high": 3.0, "3x low": 1.0 / 3.0}
USUAL, COARSE = Settings("RK4", 1e-3, corrected=True), Settings("RK4", 4e-3, corrected=True)
THEIRS = (
    Settings("implicitfast", 1e-3, corrected=False),
    Settings("implicitfast", 1e-3, corrected=True),
    Settings("RK4", 1e-3, corrected=False),
    USUAL,
    Settings("RK4", 1e-3, corrected=True, optimizer="mujoco"),
    COARSE,
)
MISSING = "MuJoCo's toolbox is not installed (pip install 'mujoco[sysid]'): ours alone."
SWING = ("viscous_friction:j1", "coulomb_friction:j1", "air_drag:link1", "length_error:link1")
FOLDER = Path(os.environ.get("LINKTWIN_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))


@dataclass(frozen=True)
class Record:
    """How long is filmed, and the steps of Exudyn and of our fits (None: the default, here the sampling interval).

    rivals: which of our steps is timed against which of MuJoCo's settings.
    """

    duration_s: float
    exudyn_step_s: float
    steps_s: tuple[float | None, ...]
    rivals: tuple[tuple[float | None, Settings], ...]


# Before the pins turn back all is smooth, and Exudyn's error at 1 ms is below 1e-7 rad.  Where they do, friction jumps
# within a step, which costs every engine first order: only small steps tell the truth there.
OPENING = Record(0.7, 1e-3, (None, 2 / RATE_HZ), ((None, USUAL), (2 / RATE_HZ, COARSE)))
REVERSAL = Record(1.0, 2e-4, (None, 1e-3), ((1e-3, USUAL),))
FINE_S = 0.5 / RATE_HZ  # a step's own error is then a tenth of what noise leaves


def drawn(values: np.ndarray) -> Mechanism:
    """The scissor with viscous and Coulomb friction at all pins."""
    document = scissor(CELLS, ANGLE_RAD, SPRING_N_PER_M).model_dump(mode="json", exclude_none=True)
    pins = [joint["id"] for joint in document["joints"] if joint["type"] == "revolute"]
    for name, value in zip(FREE, values.tolist(), strict=True):
        kind, place = name.split(":")
        id, parameter = place.split(".")
        document["effects"].append({"id": id, "kind": kind, "on": pins, "parameters": {parameter: value}})
    return parse_mechanism(document)


@cache
def filmed(record: Record) -> tuple[np.ndarray, np.ndarray]:
    """Sample times and the true angles (T, pins) there, by Exudyn."""
    began, nodes_s = time.perf_counter(), 1e-3
    motion = simulate_exudyn(drawn(TRUTH), record.duration_s, record.exudyn_step_s, output_step_s=nodes_s)
    angles = np.stack([motion.joint_positions[pin] for pin in SEEN], 1)
    time_s = np.arange(0.0, record.duration_s, 1.0 / RATE_HZ)
    print(f"Exudyn: {record.duration_s:g} s at {1e3 * record.exudyn_step_s:g} ms, {_since(began)}", flush=True)
    return time_s, CubicSpline(np.arange(angles.shape[0]) * nodes_s, angles)(time_s)


def measured(record: Record, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """The same with noise."""
    time_s, angles = filmed(record)
    return time_s, angles + SIGMA_RAD * np.random.default_rng(seed).standard_normal(angles.shape)


def ours(record: Record, seed: int, factor: float, step_s: float | None = None) -> Found:
    """Our fit with default settings but for the step, from `factor` times the truth."""
    time_s, angles = measured(record, seed)
    tables = [
        pd.DataFrame({"time_s": time_s, "joint": pin, "q": angles[:, i], "sigma": SIGMA_RAD})
        for i, pin in enumerate(SEEN)
    ]
    run = Experiment("opening", "fit", Release(time_s=0.0), joint_positions=pd.concat(tables, ignore_index=True))
    study = Study(drawn(factor * TRUTH), (run,))
    began, seconds = time.perf_counter(), []

    def watch(_: float, words: str) -> None:
        if "iteration" in words:
            seconds.append(time.perf_counter() - began)

    result = fit_study(study, FREE, profiles=False, step_s=step_s, progress=watch)
    wall_s = time.perf_counter() - began
    path = np.array([[i.parameters[name] for name in FREE] for i in result.report.history])
    values = np.array([result.values[name] for name in FREE])
    return Found(values, 1.96 * result.uncertainty.sd[: len(FREE)], (np.array(seconds), path), wall_s)


def theirs(settings: Settings, record: Record, seed: int, factor: float) -> Found:
    """MuJoCo's toolbox on the same samples."""
    time_s, angles = measured(record, seed)
    spec = mujoco_sysid.scissor_spec(CELLS, ANGLE_RAD, SPRING_N_PER_M, settings.integrator, settings.step_s, SEEN)
    return mujoco_sysid.identify(spec, settings, time_s, angles, factor * TRUTH)


def error(found: Found) -> np.ndarray:
    """Relative, of each parameter."""
    return found.values / TRUTH - 1.0


def seconds_to_enough(found: Found) -> float:
    """When the search came within 0.3% of both for good; infinite if it did not."""
    if np.abs(error(found)).max() > ENOUGH:
        return np.inf
    seconds, path = found.path
    outside = np.flatnonzero(np.abs(path / TRUTH - 1.0).max(1) > ENOUGH)
    after = outside[-1] + 1 if outside.size else 0
    return float(seconds[after]) if after < seconds.size else found.wall_s


def race(record: Record, repeats: int) -> None:
    """Every method from both starts."""
    filmed(record)
    methods: dict[str, Callable[[float], Found]] = {}
    for step_s in record.steps_s:
        began = time.perf_counter()
        ours(record, 1, 1.5, step_s)
        print(f"{_ours(step_s)}, first fit, compiling and all: {_since(began)}", flush=True)
        methods[_ours(step_s)] = lambda factor, h=step_s: ours(record, 0, factor, h)
    if mujoco_sysid.available():
        for settings in THEIRS:
            methods[settings.words] = lambda factor, s=settings: theirs(s, record, 0, factor)
    else:
        print(MISSING)
    print(f"{'method':>40} {'start':>8} {'viscous off':>12} {'Coulomb off':>12} {'wall':>7} {'to 0.3%':>8}")
    reached: dict[str, list[float]] = {name: [] for name in methods}
    for start, factor in STARTS.items():
        runs: dict[str, list[Found]] = {name: [] for name in methods}
        for _ in range(repeats):
            for name, method in methods.items():
                runs[name].append(method(factor))
        for name, found in runs.items():
            off, wall = error(found[0]), float(np.median([f.wall_s for f in found]))
            soon = float(np.median([seconds_to_enough(f) for f in found]))
            reached[name].append(soon)
            note = "  STALLED" if np.abs(off).max() > STALLED else ""
            to = f"{soon:7.2f}s" if np.isfinite(soon) else "   never"
            print(f"{name:>40} {start:>8} {off[0]:12.2%} {off[1]:12.2%} {wall:6.2f}s {to}{note}", flush=True)
    for step_s, settings in record.rivals:
        if settings.words in reached:
            ratios = ", ".join(
                f"{a / b:.2f}" if np.isfinite(b) else "it never does"
                for a, b in zip(reached[_ours(step_s)], reached[settings.words], strict=True)
            )
            print(f"time to 0.3%, {_ours(step_s)} over {settings.words}: {ratios} (asked: <= 1.0)", flush=True)


def _ours(step_s: float | None) -> str:
    return f"ours, {1e3 * (step_s or 1 / RATE_HZ):.3g} ms"


def coverage(record: Record, count: int) -> None:
    """Intervals against the truth, from both starts in turn."""
    filmed(record)
    methods: dict[str, Callable[[int, float], Found]] = {
        _ours(FINE_S): lambda seed, factor: ours(record, seed, factor, FINE_S)
    }
    if mujoco_sysid.available():
        for settings in (replace(USUAL, corrected=False), USUAL):
            methods[settings.words] = lambda seed, factor, s=settings: theirs(s, record, seed, factor)
    else:
        print(MISSING)
    for name, method in methods.items():
        off, held = [], []
        for seed in range(count if name == _ours(FINE_S) else min(count, 40)):
            found = method(100 + seed, list(STARTS.values())[seed % len(STARTS)])
            off.append(error(found))
            held.append(np.abs(found.values - TRUTH) <= found.half_width)
            if (seed + 1) % 10 == 0:
                _covered(name, np.array(off), np.array(held))


def _covered(name: str, off: np.ndarray, held: np.ndarray) -> None:
    mean, worst, share = off.mean(0), np.abs(off).max(0), held.mean(0)
    print(
        f"{name:>40} {len(off):3} seeds: 95% intervals hold viscous {share[0]:4.0%}, Coulomb {share[1]:4.0%}; mean off "
        f"{mean[0]:.3%}, {mean[1]:.3%}, worst {worst[0]:.2%}, {worst[1]:.2%}; stalled "
        f"{int((np.abs(off).max(1) > STALLED).sum())}",
        flush=True,
    )


def swing() -> None:
    """A real pendulum let go from two heights (a third held out), with and without horizon continuation."""
    folder = FOLDER / "multiarm_single"
    if not folder.is_dir():
        print(f"Swing skipped: no measurements at {folder}. Set LINKTWIN_DATA to the folder of the real studies.")
        return
    study = read_study(folder / "study.json")
    print(f"multiarm_single: {', '.join(SWING)} free, from default values (a trapped search ends at 0.65 rad)")
    ways: tuple[tuple[str, Sequence[float]], ...] = (("horizons", (0.1, 0.35)), ("whole records at once", ()))
    for words, horizons in ways:
        began = time.perf_counter()
        result = fit_study(study, SWING, horizons=horizons, profiles=False)
        print(
            f"{words:>40}: rms {result.rms('fit', 'rad'):.4f} rad, held out {result.rms('held_out', 'rad'):.4f} rad, "
            f"{result.solution.status}, {_since(began)} compiling and all",
            flush=True,
        )


def _since(began: float) -> str:
    return f"{time.perf_counter() - began:.0f} s"


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("part", nargs="?", default="all", choices=("all", "race", "reversal", "coverage", "swing"))
    parser.add_argument("--count", type=int, default=40, help="seeds of the coverage; at most 40 of MuJoCo's")
    parser.add_argument("--repeats", type=int, default=3, help="runs that each time is the median of")
    asked = parser.parse_args()
    if asked.part in ("all", "race"):
        race(OPENING, asked.repeats)
    if asked.part in ("all", "reversal"):
        race(REVERSAL, asked.repeats)
    if asked.part in ("all", "coverage"):
        coverage(OPENING, asked.count)
    if asked.part in ("all", "swing"):
        swing()


if __name__ == "__main__":
    main()
