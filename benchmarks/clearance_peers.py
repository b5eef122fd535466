"""A scissor with loose pins in ours and in two engines nobody here wrote: how far apart, and how sharp each one is.

python -m benchmarks.clearance_peers            every case
python -m benchmarks.clearance_peers one        the cases with "one" in their name
python -m benchmarks.clearance_peers means      means over plays that no calliper tells apart, every pin loose

The 5-cell scissor opened by its spring, pins of 8 mm, 0.6 s from rest.  "Every pin" means all fifteen revolute joints:
pins between bars, the ground pin and the slider's pin; the slider's guide stays tight.  "One pin" is top1, where cells
1 and 2 meet.  "Unguided" starts flatter (0.6 rad) and has no slider, so that it also swings about its ground pin.  A
difference is the RMS over time of the tip's distance, over the RMS of the tip's way off the rigid motion, each over the
first 0.2, 0.3 and 0.6 s.

Where every pin is loose the motion is chaotic: engines, steps and plays 0.1% apart each choose another of many paths.
"means" compares what is left to compare: the mean paths over MANY such plays, and how far single ones stray from them.
"""

import itertools
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from backend.blind.exudyn_contact import Walls
from backend.blind.exudyn_engine import simulate_exudyn
from backend.blind.mujoco_engine import simulate_mujoco
from backend.blind.poses import rotation_matrix
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.read import parse_mechanism
from backend.simulate.run import simulate
from benchmarks.scissor import LENGTH_M, scissor

DURATION_S, SEEN_S = 0.6, 2e-3
UNTIL_S = (0.2, 0.3, 0.6)
STEP_S = {"ours": 1e-4, "Exudyn": 4e-5, "MuJoCo": 2e-5}
EXPLICIT_S = 1e-6
GUIDED, UNGUIDED = scissor(5), scissor(5, angle_rad=0.6, guided=False)
ONE = ["top1"]
TIP = ("a4", np.array([0.5 * LENGTH_M, 0.0, 0.0]))
STIFFER = 4.0
ALIKE = ("half step", "4x stiffness", "play + 0.1%")
NUDGE = 1.001  # of the play: what no drawing and no calliper tells
MANY = 16
PLAYS = np.linspace(2.0 - NUDGE, NUDGE, MANY)


@dataclass(frozen=True)
class Case:
    """A clearance on some pins (None: every one); who can run it."""

    name: str
    pins: list[str] | None
    parameters: dict[str, Any]
    engines: tuple[str, ...] = ("ours", "Exudyn", "MuJoCo")
    variants: tuple[str, ...] = field(default=ALIKE)
    linkage: Mechanism = GUIDED


CASES = (
    Case("one pin 1 mm", ONE, {"radial_m": 1e-3}),
    Case("every pin 0.5 mm", None, {"radial_m": 5e-4}),
    Case("every pin 1 mm", None, {"radial_m": 1e-3}),
    Case("unguided, every pin 0.5 mm", None, {"radial_m": 5e-4}, linkage=UNGUIDED),
    Case("unguided, every pin 1 mm", None, {"radial_m": 1e-3}, linkage=UNGUIDED),
    Case("one pin 1 mm, 2e5 N/m", ONE, {"radial_m": 1e-3, "stiffness_n_per_m": 2e5}),
    Case("one pin 1 mm, restitution 0.8", ONE, {"radial_m": 1e-3, "restitution": 0.8}),
    *(
        Case(
            f"one pin 1 mm, friction {mu:g}",
            ONE,
            {"radial_m": 1e-3, "friction_coefficient": mu},
            ("ours", "Exudyn"),
            (*ALIKE, "2x damping"),
        )
        for mu in (0.1, 0.3)
    ),
    *(
        Case(
            f"one pin 1 mm, friction {mu:g}, 1e6 N/m",
            ONE,
            {"radial_m": 1e-3, "friction_coefficient": mu, "stiffness_n_per_m": 1e6},
            variants=("half step", "2x damping"),
        )
        for mu in (0.1, 0.3)
    ),
)


def drawn(case: Case, stiffer: float = 1.0, wider: float = 1.0) -> dict[str, Any]:
    """The scissor's document with the case's clearance."""
    document = case.linkage.model_dump(mode="json")
    given = dict(case.parameters)
    given["radial_m"] *= wider
    if "stiffness_n_per_m" in given:
        given["stiffness_n_per_m"] *= stiffer
    every = [joint.id for joint in case.linkage.joints if joint.type == "revolute"]
    document["effects"].append({"id": "play", "kind": "clearance", "on": case.pins or every, "parameters": given})
    return document


def tip_path(motion: Any, every: int = 1) -> np.ndarray:
    """(T, 3) in W, of anything with position_m and quaternion_wxyz by body."""
    body, p = TIP
    return (motion.position_m[body] + rotation_matrix(motion.quaternion_wxyz[body]) @ p)[::every]


def ours(case: Case, step_s: float, stiffer: float, wider: float, dead: float) -> np.ndarray:
    """A rigid wall of ours has no stiffness to raise, and none has a damper."""
    run = simulate(parse_mechanism(drawn(case, stiffer, wider)), DURATION_S, step_s)
    if not run.done:
        raise RuntimeError(run.result)
    return tip_path(run, round(SEEN_S / step_s))


def exudyn(case: Case, step_s: float, stiffer: float, wider: float, dead: float) -> np.ndarray:
    """Where every pin is loose its steps are explicit, and its walls as stiff as these allow."""
    document = drawn(case, stiffer, wider)
    if case.pins is None:
        step_s *= EXPLICIT_S / STEP_S["Exudyn"]
        return tip_path(simulate_exudyn(document, DURATION_S, step_s, output_step_s=SEEN_S, explicit=True))
    walls = Walls(stiffer * Walls.rigid_stiffness, dead * Walls.damping_ratio, dead * Walls.soft_damping_ratio)
    return tip_path(simulate_exudyn(document, DURATION_S, step_s, output_step_s=SEEN_S, walls=walls))


def mujoco(case: Case, step_s: float, stiffer: float, wider: float, dead: float) -> np.ndarray:
    rate = np.sqrt(stiffer) / (6.0 * STEP_S["MuJoCo"])
    document = drawn(case, stiffer, wider)
    return tip_path(simulate_mujoco(document, DURATION_S, step_s, output_step_s=SEEN_S, wall_rate_per_s=rate))


ENGINES: dict[str, Callable[[Case, float, float, float, float], np.ndarray]] = {
    "ours": ours,
    "Exudyn": exudyn,
    "MuJoCo": mujoco,
}


def rigid_path(linkage: Mechanism) -> np.ndarray:
    document = linkage.model_dump(mode="json")
    return tip_path(simulate_exudyn(document, DURATION_S, 1e-3, output_step_s=SEEN_S, extrapolated=True))


def tip_difference(a: np.ndarray, b: np.ndarray, rigid: np.ndarray, until_s: float = DURATION_S) -> float:
    """RMS of the distance of two tips, over the RMS of b's from the rigid motion's; same samples."""
    seen = round(until_s / SEEN_S) + 1
    apart, off = (((one - other)[:seen] ** 2).sum(1).mean() for one, other in ((a, b), (b, rigid)))
    return float(np.sqrt(apart / off))


def differences(a: np.ndarray, b: np.ndarray, rigid: np.ndarray) -> str:
    """Over each horizon."""
    return " | ".join(f"{tip_difference(a, b, rigid, until):6.2%}" for until in UNTIL_S)


def variants(case: Case, engine: str) -> Iterator[tuple[str, float, float, float, float]]:
    """(name, step, stiffness, play, damping of a dead blow), the latter three as factors.

    Half of an explicit step is four times the stiffness.
    """
    step_s = STEP_S[engine]
    every = {
        "half step": (0.5 * step_s, 1.0, 1.0, 1.0),
        "4x stiffness": (step_s, STIFFER, 1.0, 1.0),
        "play + 0.1%": (step_s, 1.0, NUDGE, 1.0),
        "2x damping": (step_s, 1.0, 1.0, 2.0),
    }
    soft = "stiffness_n_per_m" in case.parameters
    for name in case.variants:
        known = {
            "4x stiffness": engine == "MuJoCo" or (bool(case.pins) and engine != "ours") or soft,
            "2x damping": engine == "Exudyn",
        }
        if known.get(name, True):
            yield (name, *every[name])


def compare(case: Case, rigid: np.ndarray) -> None:
    """Print the case: the engines against each other, and each against itself."""
    seen: dict[str, np.ndarray] = {}
    for engine in case.engines:
        run, begin = ENGINES[engine], time.process_time()
        seen[engine] = run(case, STEP_S[engine], 1.0, 1.0, 1.0)
        spent = time.process_time() - begin
        off = 1e3 * np.sqrt(((seen[engine] - rigid) ** 2).sum(1).mean())
        print(f"{case.name:<34} {engine:<7} tip {off:6.2f} mm off rigid ({spent:.0f} s)", flush=True)
        for name, *settings in variants(case, engine):
            try:
                line = differences(run(case, *settings), seen[engine], rigid)
            except RuntimeError:
                line = "stops"
            print(f"{'':<34} {engine}, {name:<20} {line}", flush=True)
    for one, other in itertools.combinations(seen, 2):
        line = differences(seen[one], seen[other], rigid)
        print(f"{case.name:<34} {one + ' - ' + other:<28} {line}", flush=True)


def compare_means(case: Case, rigid: np.ndarray) -> None:
    """Print how far the engines' mean paths are apart, and how far chance alone would put them."""
    seen: dict[str, np.ndarray] = {}
    off = float(np.sqrt(((ours(case, STEP_S["ours"], 1.0, 1.0, 1.0) - rigid) ** 2).sum(1).mean()))
    for engine in case.engines:
        run, step_s = ENGINES[engine], STEP_S[engine]
        seen[engine] = np.stack([run(case, step_s, 1.0, wider, 1.0) for wider in PLAYS])
    stray = {engine: float(np.sqrt(paths.var(0, ddof=1).sum(-1).mean())) for engine, paths in seen.items()}
    for engine, one in stray.items():
        print(f"{case.name:<28} {engine:<7} one path strays {one / off:6.2%} from the mean of {MANY}", flush=True)
    for one, other in itertools.combinations(seen, 2):
        apart = np.sqrt(((seen[one].mean(0) - seen[other].mean(0)) ** 2).sum(1).mean()) / off
        chance = np.hypot(stray[one], stray[other]) / np.sqrt(MANY) / off
        print(f"{case.name:<28} {one + ' - ' + other:<17} means {apart:6.2%} apart; by chance {chance:.2%}", flush=True)


def main(wanted: str = "") -> None:
    if wanted == "means":
        for case in CASES:
            if case.pins is None and case.linkage is GUIDED:
                compare_means(case, rigid_path(GUIDED))
        return
    print(f"steps [s] {STEP_S}; differences over the first {', '.join(map(str, UNTIL_S))} s")
    for linkage in (GUIDED, UNGUIDED):
        rigid = rigid_path(linkage)
        travel = 1e3 * np.linalg.norm(rigid - rigid[0], axis=1).max()
        print(f"rigid tip travels {travel:.0f} mm ({'guided' if linkage is GUIDED else 'unguided'})")
        for case in CASES:
            if wanted in case.name and case.linkage is linkage:
                compare(case, rigid)


if __name__ == "__main__":
    main(*sys.argv[1:2])
