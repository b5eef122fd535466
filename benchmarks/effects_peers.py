"""Effects and joints beside two engines nobody here wrote, on the same drawing with the same effect.

python -m benchmarks.effects_peers              every case
python -m benchmarks.effects_peers friction     the cases with "friction" in their name

From rest.  A difference is the largest over every sample and every joint coordinate [rad or m], and every marker [m].
"""

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from backend.blind.exudyn_engine import simulate_exudyn
from backend.blind.mujoco_engine import simulate_mujoco
from backend.mechanism.mechanism import Mechanism
from backend.simulate.run import simulate
from benchmarks import scissor as flat
from tests.mechanisms import SKEW_INERTIA, body, drawing, effect, fourbar, pendulum, scissor, slider_crank

SEEN_S = 2e-3


@dataclass(frozen=True)
class Case:
    """A drawing, and the steps [s] at which each engine runs it."""

    name: str
    draw: Callable[[], Mechanism]
    duration_s: float
    ours_s: float = 1e-4
    exudyn_s: float = 1e-4
    mujoco_s: float = 1e-4
    extrapolated: bool = False


def chain(type: str) -> Mechanism:
    """A skew body on a ball joint, and a second one on its end by a joint of the type: nothing lies in one plane."""
    elbow, axis = (0.2, 0, 0), (0.36, 0.48, 0.8)
    bodies = [
        body("upper", (0, 0, 0), Rotation.identity(), 0.1, SKEW_INERTIA, (0.1, 0, 0)),
        body("lower", elbow, Rotation.identity(), 0.08, SKEW_INERTIA, (0.03, 0.08, 0.02)),
    ]
    joints = [
        ("ball", "spherical", "ground", "upper", (0, 0, 0), axis),
        ("j", type, "upper", "lower", elbow, axis),
    ]
    markers = [("end", "lower", (0.25, 0.1, 0.02))]
    return drawing(f"{type} chain", bodies, joints, markers=markers, gravity=(1.0, -9.0, 3.0))


def on_the_bed() -> Mechanism:
    """A scissor that lies on the bed and opens by its spring."""
    lying = flat.scissor(3)
    rub = effect("bed", "surface_friction", "all", friction_coefficient=0.2)
    return lying.model_copy(update={"effects": (*lying.effects, rub)})


def on_a_post(**contact: float) -> Mechanism:
    """A pendulum that falls on a round post beside its way and rests there, or rebounds."""
    met = effect(
        "post",
        "link_contact",
        ["link", "ground"],
        start_a_m=[0, 0, 0],
        end_a_m=[0.2, 0, 0],
        start_b_m=[0.02, -0.12, -0.05],
        end_b_m=[0.02, -0.12, 0.05],
        radius_a_m=0.005,
        radius_b_m=0.01,
        **contact,
    )
    return pendulum(1.2, effects=[met])


def past_each_other() -> Mechanism:
    """Two pendulums whose bars cross in space, one at rest and one that falls on it."""
    parts = [pendulum(1.2).bodies[1].model_dump(mode="json", exclude_none=True)]
    foot = np.array([0.05, -0.12, -0.1])
    standing = {
        **parts[0],
        "id": "standing",
        "pose": {"position_m": foot.tolist(), "quaternion_wxyz": [float(np.sqrt(0.5)), 0.0, -float(np.sqrt(0.5)), 0.0]},
    }
    met = effect(
        "meet",
        "link_contact",
        ["link", "standing"],
        start_a_m=[0, 0, 0],
        end_a_m=[0.2, 0, 0],
        start_b_m=[0, 0, 0],
        end_b_m=[0.2, 0, 0],
        radius_a_m=0.01,
        radius_b_m=0.01,
    )
    pins = [
        ("pin", "revolute", "ground", "link", (0, 0, 0), (0, 0, 1)),
        ("foot", "revolute", "ground", "standing", tuple(foot), (0, 1, 0)),
    ]
    return drawing("crossing pendulums", [*parts, standing], pins, [met])


COULOMB = effect("dry", "coulomb_friction", "all", friction_torque_n_m=2e-3)
PIN = effect("rub", "pin_friction", "all", friction_coefficient=0.3)
PINS = effect("rub", "pin_friction", ["main", "crankpin"], friction_coefficient=0.3)
CASES = (
    Case("Coulomb friction, four-bar", lambda: fourbar([COULOMB]), 0.5),
    Case("Coulomb friction, scissor", lambda: scissor(3, [COULOMB], stiffness=100.0), 0.15),
    Case("pin friction, four-bar", lambda: fourbar([PIN]), 0.5),
    Case("pin friction, slider-crank", lambda: slider_crank(effects=[PINS]), 0.5),
    Case("joint stop, pendulum", lambda: pendulum(effects=[effect("end", "joint_stop", ["pin"], lower=-0.8)]), 0.6),
    Case("surface friction, scissor", on_the_bed, 0.3),
    Case("link contact, post", on_a_post, 0.4, exudyn_s=4e-5, mujoco_s=2e-5),
    Case("link contact, crossing bars", past_each_other, 0.25, exudyn_s=4e-5, mujoco_s=2e-5),
    *(
        Case(f"{type} joint", lambda type=type: chain(type), 0.3, exudyn_s=5e-4, extrapolated=True)
        for type in ("spherical", "cylindrical", "planar", "universal")
    ),
)  # fmt: skip


def largest(ours: Any, theirs: Any, every: int) -> tuple[float, float]:
    """Differences of joint coordinates and of markers."""
    q = [np.abs(ours.q[j][::every] - theirs.joint_positions[j]).max() for j in ours.q if j in theirs.joint_positions]
    m = [np.abs(p[::every] - theirs.marker_position_m[id]).max() for id, p in ours.markers_m.items()]
    return max(q, default=np.nan), max(m, default=np.nan)


def compare(case: Case) -> None:
    """Print one line."""
    mechanism, every = case.draw(), round(SEEN_S / case.ours_s)
    begin = time.process_time()
    ours = simulate(mechanism, case.duration_s, case.ours_s)
    if not ours.done:
        print(f"{case.name:<30} ours: {ours.result}", flush=True)
        return
    half = simulate(mechanism, case.duration_s, 0.5 * case.ours_s)
    pairs = [(half.q[j], q) for j, q in ours.q.items()] + [(half.markers_m[m], p) for m, p in ours.markers_m.items()]
    own = max(float(np.abs(finer[::2] - coarse).max()) for finer, coarse in pairs)
    travel = max(float(np.ptp(coarse, axis=0).max()) for _, coarse in pairs)
    line = f"{case.name:<30} travel {travel:5.2f}  ours at half the step {own:.0e}"
    line += f" ({time.process_time() - begin:.0f} s)"
    runs = {
        "Exudyn": lambda: simulate_exudyn(
            mechanism, case.duration_s, case.exudyn_s, output_step_s=SEEN_S, extrapolated=case.extrapolated
        ),
        "MuJoCo": lambda: simulate_mujoco(mechanism, case.duration_s, case.mujoco_s, output_step_s=SEEN_S),
    }
    for engine, run in runs.items():
        begin = time.process_time()
        try:
            joints, markers = largest(ours, run(), every)
            line += f"  {engine} {joints:.1e} / {markers:.1e} ({time.process_time() - begin:.0f} s)"
        except (RuntimeError, ValueError) as error:
            line += f"  {engine}: {error}"
    print(line, flush=True)


def main(wanted: str = "") -> None:
    print("largest difference of a joint coordinate [rad or m] / of a marker [m]")
    for case in CASES:
        if wanted in case.name:
            compare(case)


if __name__ == "__main__":
    main(*sys.argv[1:2])
