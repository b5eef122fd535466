"""Joint forces beside statics worked out by hand, and beside Exudyn.

`python -m benchmarks.joint_forces` prints the tables of docs/forces.md.
"""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from backend.blind.exudyn_engine import simulate_exudyn
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.read import read_mechanism
from backend.simulate.joint_forces import JointLoad, joint_forces
from backend.simulate.run import simulate
from tests.mechanisms import WEIGHTLESS, Z, bar, bar_inertia, body, drawing, effect, pendulum, sliding_mass

SAMPLES = Path(__file__).parents[1] / "samples"
GRAVITY = 9.81
SEEN_S = 1e-2


class Known(NamedTuple):
    """A reaction that can be worked out by hand, and what was simulated, in one unit."""

    what: str
    expected: float
    found: float
    unit: str

    @property
    def error(self) -> float:
        """Relative."""
        return abs(self.found - self.expected) / abs(self.expected)


def main() -> None:
    """Print both tables."""
    print("| by hand | expected | simulated | differs by |")
    print("|---|---|---|---|")
    for case in (supported_bar, truss, clamped_bar, swinging_bar, loaded_rail):
        for known in case():
            print(f"| {known.what} | {known.expected:.6f} {known.unit} | {known.found:.6f} | {known.error:.1e} |")
    print()
    print("| against Exudyn, 0.5 s | h | joint | peak, unique part | largest difference / peak |")
    print("|---|---|---|---|---|")
    for name in ("fourbar", "slider_crank"):
        mechanism = read_mechanism(SAMPLES / name / "mechanism.json")
        for step_s in (1e-3, 2.5e-4):
            for joint, (peak, error) in beside_exudyn(mechanism, 0.5, step_s).items():
                print(f"| {name} | {1e3 * step_s:g} ms | {joint} | {peak:.4f} N | {error:.1e} |")


def supported_bar(load: float = 7.0, at: float = 0.3, length: float = 1.0, mass: float = 0.5) -> list[Known]:
    """A bar on a pin and a roller, with a load between them: each end takes its lever's share and half the weight."""
    roller = body("roller", (length, 0, 0), Rotation.identity(), 0.1, np.array([2e-5, 2e-5, 2e-5]))
    joints = [
        ("pin", "revolute", "ground", "bar", (0, 0, 0), Z),
        ("wrist", "revolute", "roller", "bar", (length, 0, 0), Z),
        ("rail", "prismatic", "ground", "roller", (length, 0, 0), (1.0, 0, 0)),
    ]
    push = effect("load", "applied_force", ["bar"], force_n=load, direction=[0, -1, 0], point_m=[at, 0, 0])
    drawn = drawing("supported bar", [bar("bar", (0, 0, 0), (length, 0, 0), mass), roller], joints, [push])
    loads = _loads(drawn, 0.02)
    half, share = 0.5 * mass * GRAVITY, at / length
    return [
        Known("supported bar, pin", load * (1 - share) + half, loads["pin"].child.force_W[-1, 1], "N"),
        Known("supported bar, roller", load * share + half, loads["wrist"].child.force_W[-1, 1], "N"),
    ]


def truss(load: float = 12.0, angle: float = 0.6, length: float = 0.5) -> list[Known]:
    """Two bars between the ground and an apex that carries a load: load / (2 sin θ) along each."""
    half, high = length * math.cos(angle), length * math.sin(angle)
    bars = [bar("left", (-half, 0, 0), (0, high, 0)), bar("right", (half, 0, 0), (0, high, 0))]
    joints = [
        ("foot_left", "revolute", "ground", "left", (-half, 0, 0), Z),
        ("foot_right", "revolute", "ground", "right", (half, 0, 0), Z),
        ("apex", "revolute", "left", "right", (0, high, 0), Z),
    ]
    push = effect("load", "applied_force", ["left"], force_n=load, direction=[0, -1, 0], point_m=[length, 0, 0])
    loads = _loads(drawing("two-bar truss", bars, joints, [push], gravity=WEIGHTLESS), 0.02)
    along = load / (2 * math.sin(angle))
    return [Known(f"two-bar truss, {joint}", along, loads[joint].force_n[-1], "N") for joint in loads]


def clamped_bar(length: float = 0.4, mass: float = 0.3) -> list[Known]:
    """A bar held at one end alone: its weight, and its weight times half its length."""
    clamp = [("clamp", "fixed", "ground", "bar", (0, 0, 0), Z)]
    drawn = drawing("clamped bar", [bar("bar", (0, 0, 0), (length, 0, 0), mass)], clamp)
    load = _loads(drawn, 0.02)["clamp"]
    return [
        Known("clamped bar, force", mass * GRAVITY, load.child.force_W[-1, 1], "N"),
        Known("clamped bar, moment", 0.5 * mass * GRAVITY * length, load.child.torque_W[-1, 2], "N m"),
    ]


def swinging_bar(length: float = 0.2, mass: float = 0.1) -> list[Known]:
    """A bar let go level: at the bottom the pin carries m g + m ω² L/2 with ½ J ω² = m g L/2."""
    load = _loads(pendulum(0.5 * math.pi, length, mass), 0.5)["pin"]
    about_pin = bar_inertia(mass, length)[2] + 0.25 * mass * length**2
    omega_square = mass * GRAVITY * length / about_pin
    most = mass * GRAVITY + 0.5 * mass * length * omega_square
    return [Known("bar at the bottom of its swing", most, float(load.force_n.max()), "N")]


def loaded_rail(force: float = 2.0, mass: float = 0.5) -> list[Known]:
    """A block driven out along a rail: the rail's own point feels the block's weight on a lever that grows."""
    push = effect("push", "applied_force", ["block"], force_n=force, direction=[1, 0, 0])
    load = _loads(sliding_mass([push], mass, gravity=(0, -GRAVITY, 0)), 0.3)["rail"]
    travel = 0.5 * force / mass * 0.3**2
    return [Known("rail, moment at its own point", -travel * mass * GRAVITY, load.parent.torque_W[-1, 2], "N m")]


def beside_exudyn(mechanism: Mechanism, duration_s: float, step_s: float) -> dict[str, tuple[float, float]]:
    """Joint -> peak of the unique part of its force [N], and the largest difference from Exudyn's over that peak."""
    run = simulate(mechanism, duration_s, step_s)
    peer = simulate_exudyn(mechanism, duration_s, 2.5e-4, output_step_s=SEEN_S)
    every, found = round(SEEN_S / step_s), {}
    for load in joint_forces(mechanism, run):
        # The first sample is left out: Exudyn's first multipliers are not yet those of the motion.
        seen = slice(every, None, every)
        apart = load.sure_W[seen] @ (load.child.force_W[seen] - peer.joint_force_n[load.joint][1:])[..., None]
        peak = float(load.unique_force_n.max())
        found[load.joint] = peak, float(np.linalg.norm(apart, axis=1).max()) / peak
    return found


def _loads(mechanism: Mechanism, duration_s: float) -> dict[str, JointLoad]:
    run = simulate(mechanism, duration_s, 1e-3)
    if not run.done:
        raise RuntimeError(run.result)
    return {load.joint: load for load in joint_forces(mechanism, run)}


if __name__ == "__main__":
    main()
