"""A scissor with loose pins in two engines nobody here wrote: how far apart they are, and how sharp each one is.

python -m benchmarks.clearance_peers            every case
python -m benchmarks.clearance_peers one        the cases with "one" in their name

The 5-cell scissor opened by its spring, pins of 8 mm, 0.6 s from rest.  "Every pin" means all fifteen revolute joints:
pins between bars, the ground pin and the slider's pin; the slider's guide stays tight.  "One pin" is top1, where cells
1 and 2 meet.  A difference is the RMS over time of the tip's distance, over the RMS of the tip's way off the rigid
motion.
"""

import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from backend.blind.exudyn_contact import Walls
from backend.blind.exudyn_engine import simulate_exudyn
from backend.blind.mujoco_engine import simulate_mujoco
from backend.blind.poses import PeerMotion, rotation_matrix
from benchmarks.scissor import LENGTH_M, scissor

DURATION_S, SEEN_S = 0.6, 2e-3
STEP_S = {"Exudyn": 4e-5, "MuJoCo": 2e-5}
ONE = ["top1"]
EVERY = [joint.id for joint in scissor(5).joints if joint.type == "revolute"]
TIP = ("a4", np.array([0.5 * LENGTH_M, 0.0, 0.0]))
STIFFER = 4.0
NUDGE = 1.001  # of the play: what no drawing and no calliper tells


@dataclass(frozen=True)
class Case:
    """A clearance on some pins; who can run it."""

    name: str
    pins: list[str]
    parameters: dict[str, Any]
    engines: tuple[str, ...] = ("Exudyn", "MuJoCo")
    variants: tuple[str, ...] = field(default=("half step", "4x stiffness", "play + 0.1%"))


CASES = (
    Case("one pin 1 mm", ONE, {"radial_m": 1e-3}),
    Case("every pin 0.5 mm", EVERY, {"radial_m": 5e-4}),
    Case("every pin 1 mm", EVERY, {"radial_m": 1e-3}),
    Case("one pin 1 mm, 2e5 N/m", ONE, {"radial_m": 1e-3, "stiffness_n_per_m": 2e5}),
    Case("one pin 1 mm, restitution 0.8", ONE, {"radial_m": 1e-3, "restitution": 0.8}),
    *(
        Case(f"one pin 1 mm, friction {mu:g}", ONE, {"radial_m": 1e-3, "friction_coefficient": mu}, ("Exudyn",))
        for mu in (0.1, 0.3)
    ),
    *(
        Case(
            f"one pin 1 mm, friction {mu:g}, 1e6 N/m",
            ONE,
            {"radial_m": 1e-3, "friction_coefficient": mu, "stiffness_n_per_m": 1e6},
            variants=("half step",),
        )
        for mu in (0.1, 0.3)
    ),
)


def drawn(case: Case | None, stiffer: float = 1.0, wider: float = 1.0) -> dict[str, Any]:
    """The scissor's document with the case's clearance; None: rigid."""
    document = scissor(5).model_dump(mode="json")
    if case:
        given = dict(case.parameters)
        given["radial_m"] *= wider
        if "stiffness_n_per_m" in given:
            given["stiffness_n_per_m"] *= stiffer
        document["effects"].append({"id": "play", "kind": "clearance", "on": case.pins, "parameters": given})
    return document


def exudyn(case: Case, step_s: float, stiffer: float, wider: float) -> PeerMotion:
    walls = Walls(rigid_stiffness=stiffer * Walls.rigid_stiffness)
    return simulate_exudyn(drawn(case, stiffer, wider), DURATION_S, step_s, output_step_s=SEEN_S, walls=walls)


def mujoco(case: Case, step_s: float, stiffer: float, wider: float) -> PeerMotion:
    rate = np.sqrt(stiffer) / (6.0 * STEP_S["MuJoCo"])
    document = drawn(case, stiffer, wider)
    return simulate_mujoco(document, DURATION_S, step_s, output_step_s=SEEN_S, wall_rate_per_s=rate)


ENGINES: dict[str, Callable[[Case, float, float, float], PeerMotion]] = {"Exudyn": exudyn, "MuJoCo": mujoco}


def tip(motion: Any) -> np.ndarray:
    """(T, 3) in W, of anything with position_m and quaternion_wxyz by body."""
    body, p = TIP
    return motion.position_m[body] + rotation_matrix(motion.quaternion_wxyz[body]) @ p


def tip_difference(a: Any, b: Any, rigid: Any) -> float:
    """RMS of the tip's distance between two motions, over the RMS of b's tip off the rigid motion; same samples."""
    apart, off = (((tip(one) - tip(other)) ** 2).sum(1).mean() for one, other in ((a, b), (b, rigid)))
    return float(np.sqrt(apart / off))


def variants(case: Case, engine: str) -> Iterator[tuple[str, float, float, float]]:
    """(name, step, stiffness, play), the latter two as factors."""
    step_s = STEP_S[engine]
    every = {
        "half step": (0.5 * step_s, 1.0, 1.0),
        "4x stiffness": (step_s, STIFFER, 1.0),
        "play + 0.1%": (step_s, 1.0, NUDGE),
    }
    yield from ((name, *every[name]) for name in case.variants)


def compare(case: Case, rigid: PeerMotion) -> None:
    """Print the case: the engines against each other, and each against itself."""
    seen: dict[str, PeerMotion] = {}
    for engine in case.engines:
        run, begin = ENGINES[engine], time.process_time()
        seen[engine] = run(case, STEP_S[engine], 1.0, 1.0)
        spent = time.process_time() - begin
        off = 1e3 * np.sqrt(((tip(seen[engine]) - tip(rigid)) ** 2).sum(1).mean())
        line = f"{case.name:<34} {engine:<7} tip {off:6.2f} mm off rigid ({spent:3.0f} s); itself:"
        for name, *settings in variants(case, engine):
            try:
                line += f"  {name} {tip_difference(run(case, *settings), seen[engine], rigid):.2%}"
            except RuntimeError:
                line += f"  {name} stops"
        print(line, flush=True)
    names = list(seen)
    for i, one in enumerate(names):
        for other in names[i + 1 :]:
            print(f"{case.name:<34} {one} - {other}  {tip_difference(seen[one], seen[other], rigid):.2%}", flush=True)


def main(wanted: str = "") -> None:
    rigid = simulate_exudyn(drawn(None), DURATION_S, 1e-3, output_step_s=SEEN_S, extrapolated=True)
    travel = 1e3 * np.linalg.norm(tip(rigid) - tip(rigid)[0], axis=1).max()
    print(f"rigid tip travels {travel:.0f} mm; steps [s] {STEP_S}")
    for case in CASES:
        if wanted in case.name:
            compare(case, rigid)


if __name__ == "__main__":
    main(*sys.argv[1:2])
