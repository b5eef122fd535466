"""Fit the five real studies from default starting values; print fit and held-out errors beside their targets.

    python benchmarks/real_studies.py [study ...]

Needs the measurements: LINKTWIN_DATA, or ../shared/data beside the repository. Each line says what was asked.
"""

import os
import sys
import time
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

os.environ.setdefault("JAX_ENABLE_X64", "1")
os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false")

import numpy as np

from backend.fit.fit_study import fit_study
from backend.fit.result import FitResult, Overlay
from backend.mechanism.read import read_study
from benchmarks.compiling import COMPILING

FOLDER = Path(os.environ.get("LINKTWIN_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))


@dataclass(frozen=True)
class Case:
    """A study, what is free, and the largest error asked for: fit, and each held-out run."""

    free: tuple[str, ...]
    unit: str
    fit: float | None = None
    held_out: tuple[float, ...] = ()
    published: tuple[tuple[str, float, float], ...] = ()  # name, value, relative tolerance: to compare, never to start


CASES = {
    "emps": Case(
        ("viscous_friction:slide", "coulomb_friction:slide", "effort_offset:slide"), "m", None, (0.006,),
        (
            ("viscous_friction:slide.damping_n_s_per_m", 203.5, 0.08),
            ("coulomb_friction:slide.friction_force_n", 20.4, 0.08),
            # Published as resistance, force = M a + ... + offset: as a push on the carriage it is +3.16 N.
            ("effort_offset:slide.force_n", 3.16, 0.15),
        ),
    ),
    "multiarm_single": Case(
        ("coulomb_friction:j1", "air_drag:link1", "length_error:link1"), "rad", 0.006, (0.025,)
    ),
    "dfki_double_pendulum": Case(("coulomb_friction:*",), "rad", None, (0.065,)),
    "schmidt_lipson_pendulum": Case(("air_drag:link1", "length_error:link1"), "rad", 0.017),
    "ibm_double_pendulum": Case(("coulomb_friction:*", "camera_rotation:camera"), "angles", None, (0.040, 0.035)),
}  # fmt: skip


def link_angles(result: FitResult, experiment: str) -> tuple[np.ndarray, np.ndarray]:
    """Measured and simulated angles from the vertical of both links, from the three filmed points."""
    of = {o.at: o for o in result.overlays if o.experiment == experiment}

    def angles(values) -> np.ndarray:
        chain = [values(of[f"marker:{m}"]) for m in ("pivot", "elbow", "tip")]
        return np.stack([np.arctan2(b[:, 0] - a[:, 0], -(b[:, 1] - a[:, 1])) for a, b in pairwise(chain)])

    return angles(lambda o: _xz(o, o.measured)), angles(lambda o: _xz(o, o.after))


def _xz(overlay: Overlay, values: np.ndarray) -> np.ndarray:
    return values[:, [overlay.coordinates.index(c) for c in ("x_m", "z_m")]]


def error(result: FitResult, experiment: str, unit: str) -> float:
    """Root mean square error of one experiment over its samples in motion."""
    if unit == "angles":
        measured, simulated = link_angles(result, experiment)
        return float(np.sqrt(np.mean((np.unwrap(simulated - measured)) ** 2)))
    rows = [r for r in (*result.report.residuals, *result.report.held_out) if r.experiment == experiment]
    return float(np.sqrt(np.average([r.rms**2 for r in rows], weights=[r.count for r in rows]))) if rows else np.inf


def report(name: str, case: Case) -> bool:
    study = read_study(FOLDER / name / "study.json")
    began = time.perf_counter()
    result = fit_study(study, case.free)
    wall = time.perf_counter() - began
    compiling = sum(COMPILING)
    COMPILING.clear()
    unit = "rad" if case.unit == "angles" else case.unit
    print(f"\n{name}: {', '.join(case.free)}   {wall:.0f} s, of them {compiling:.0f} s compiling")
    for p, i in zip(result.report.parameters, result.report.identifiability, strict=True):
        sd = "unbounded" if p.sd is None else f"{p.sd:.2g}"
        profile = "" if i.profile is None else f", profile {_end(i.profile[0])} .. {_end(i.profile[1])}"
        print(f"  {p.name:46s} {p.value:12.6g} +- {sd} {p.unit}{profile}")
    good = result.report.converged
    for published, value, tolerance in case.published:
        found = result.values[published]
        good &= abs(found / value - 1) <= tolerance
        print(f"  {published:46s} {found / value - 1:+.1%} from the published {value:g} (asked: {tolerance:.0%})")
    errors = [error(result, e.id, case.unit) for e in study.fit]
    total = float(np.sqrt(np.mean(np.square(errors))))
    good &= case.fit is None or total <= case.fit
    asked = "" if case.fit is None else f"   asked <= {case.fit:g}"
    print(f"  fit {total:.4g} {unit}{asked}")
    for k, e in enumerate(study.held_out):
        found = error(result, e.id, case.unit)
        asked = f"   asked <= {case.held_out[k]:g}" if k < len(case.held_out) else ""
        good &= k >= len(case.held_out) or found <= case.held_out[k]
        print(f"  held out {e.id}: {found:.4g} {unit}{asked}")
    for warning in result.report.warnings:
        print(f"  ! {warning}")
    print(f"  {result.report.message} {'MET' if good else 'NOT MET'}")
    return good


def _end(value: float | None) -> str:
    return "open" if value is None else f"{value:.5g}"


def main() -> int:
    if not FOLDER.is_dir():
        print(f"Skipped: no measurements at {FOLDER}. Set LINKTWIN_DATA to the folder of the real studies.")
        return 0
    names = sys.argv[1:] or list(CASES)
    return 0 if all([report(name, CASES[name]) for name in names]) else 1


if __name__ == "__main__":
    sys.exit(main())
