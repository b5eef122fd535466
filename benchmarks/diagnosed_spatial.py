"""Gaps of mechanisms outside the plane, in MuJoCo's motions: what the diagnosis says beside what is true.

python -m benchmarks.diagnosed_spatial [CASE ...]      some two minutes a case on one core

Six releases of two seconds from rest, three coordinates of every marker at 90 frames/s with 0.5 mm of noise; two of
the releases are held out.
"""

import argparse
import time
from dataclasses import dataclass

import numpy as np

from backend.diagnose.run import diagnose_study
from backend.mechanism.gap_report import CauseSet
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.read import parse_mechanism
from benchmarks.diagnosis import RELEASES, filmed, study_of
from tests.mechanisms import bead_on_bar, bennett, document, effect


@dataclass(frozen=True)
class Case:
    """A drawing, where it is released, and what reality has beside it."""

    drawing: Mechanism
    released: str
    positions: tuple[float, float]
    kind: str
    on: str
    parameters: dict[str, float]


def seen(mechanism: Mechanism, **markers: tuple[float, float, float]) -> Mechanism:
    """The mechanism with one marker on each of these bodies, in body axes [m]."""
    listed = [{"id": f"m_{body}", "body": body, "position_m": list(at)} for body, at in markers.items()]
    return parse_mechanism({**document(mechanism), "markers": listed})


LOOP = seen(bennett(), link0=(0.15, 0, 0), link1=(0.1, 0, 0), link2=(0.1, 0, 0))
BEAD = seen(bead_on_bar(), bar=(0.1, 0, 0), bead=(0, 0, 0))
HELD = effect("back", "extension_spring", ["bar", "bead"], anchor_a_m=[0, 0, 0], anchor_b_m=[0, 0, 0],
              stiffness_n_per_m=4.0, free_length_m=0.1)  # fmt: skip
SPRUNG = BEAD.model_copy(update={"effects": (HELD,)})
CASES = {
    "friction": Case(LOOP, "j0", (-0.3, 0.4), "coulomb_friction", "j2", {"friction_torque_n_m": 2e-3}),
    "drag": Case(LOOP, "j0", (-0.3, 0.4), "linear_drag", "link1", {"n_s_per_m": 0.15}),
    "rail": Case(SPRUNG, "pin", (-0.5, 0.9), "viscous_friction", "rail", {"damping_n_s_per_m": 0.05}),
}


def said(cause: CauseSet) -> str:
    """A cause with its numbers, as one reads it."""
    names = []
    for one in cause.effects:
        values = ", ".join(f"{name} {q.value:.4g} +- {q.sd:.1g}" for name, q in one.parameters.items())
        names.append(f"{one.kind} at {'+'.join(one.on)} ({values})")
    return " with ".join(names)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("cases", nargs="*", choices=[[], *CASES], default=[])
    for name in parser.parse_args().cases or CASES:
        case = CASES[name]
        real = effect("real", case.kind, [case.on], **case.parameters)
        reality = case.drawing.model_copy(update={"effects": (*case.drawing.effects, real)})
        paths = filmed(case.drawing, reality, case.released, np.linspace(*case.positions, RELEASES[0]))
        began = time.process_time()
        found = diagnose_study(study_of(case.drawing, paths, 1)).report
        print(f"\n{name}: {case.drawing.name}, true {case.kind} at {case.on} {case.parameters}")
        print(f"  {found.verdict}: {found.sentence} ({time.process_time() - began:.0f} s)")
        for cause in found.causes[:3]:
            print(f"  {cause.probability:.3f} {said(cause)}")
        print(f"  unknown {found.probability_unknown:.3f}", flush=True)


if __name__ == "__main__":
    main()
