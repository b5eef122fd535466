"""Two solves of overconstrained mechanisms: do they move alike, and whose reactions differ?

`python -m benchmarks.redundancy` prints the tables of docs/redundancy.md.
"""

import math

import numpy as np

from backend.mechanism.effect import Effect
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.read import parse_mechanism, read_mechanism
from backend.simulate.run import Run, simulate
from benchmarks.scissor import scissor

ASIDE = [0.8, 1.1, -9.7]  # gravity that also pulls out of a planar linkage's plane [m/s²]


def main() -> None:
    """Print both tables."""
    runs = []
    print("| mechanism | redundant | turns | rows chosen | steps carried | apart / length | joints open, m |")
    print("|---|---|---|---|---|---|---|")
    for name, mechanism, duration in cases():
        given = simulate(mechanism, duration, tolerance=1e-12)
        let_go = simulate(mechanism, duration, solve="reduced", tolerance=1e-12)
        runs.append((name, given, let_go))
        print(_line(name, given, let_go))
    print()
    print("| mechanism | joint | not unique | force N | differs by | torque N m | differs by |")
    print("|---|---|---|---|---|---|---|")
    for name, given, let_go in runs:
        for joint in list(given.reaction_force_n)[:2]:
            print(_reaction(name, joint, given, let_go))


def cases() -> list[tuple[str, Mechanism, float]]:
    """Drawings that are redundant, driven through the poses where a rank may change [s]."""
    return [
        ("four-bar through its dead centres", driven(read_mechanism("samples/fourbar/mechanism.json"), 0.003), 1.0),
        ("parallelogram through its change points", driven(parallelogram(), 0.1), 0.6),
        ("Bennett, a whole turn and more", driven(read_mechanism("samples/bennett/mechanism.json"), 0.1), 0.5),
        ("3-D scissor, 23 cells", scissor(23), 0.1),
    ]


def driven(mechanism: Mechanism, torque_n_m: float) -> Mechanism:
    """The drawing alone, pulled aside by gravity, with a steady torque at its first joint."""
    drawn = mechanism.model_dump(mode="json", exclude_none=True)
    push = Effect(id="push", kind="effort_offset", on=(mechanism.joints[0].id,), parameters={"torque_n_m": torque_n_m})
    return parse_mechanism({**drawn, "gravity_m_per_s2": ASIDE, "effects": [push.model_dump(mode="json")]})


def parallelogram(crank_m: float = 0.1, ground_m: float = 0.25, angle_rad: float = 1.0) -> Mechanism:
    """Crank and rocker alike, coupler as long as the ground, pins along z."""
    x, y = crank_m * math.cos(angle_rad), crank_m * math.sin(angle_rad)
    lean = [math.cos(0.5 * angle_rad), 0.0, 0.0, math.sin(0.5 * angle_rad)]
    back = [lean[0], 0.0, 0.0, -lean[3]]
    level = [1.0, 0.0, 0.0, 0.0]
    placed = {
        "crank": ([0.0, 0.0, 0.0], lean, crank_m),
        "coupler": ([x, y, 0.0], level, ground_m),
        "rocker": ([ground_m, 0.0, 0.0], lean, crank_m),
    }
    bodies = [{"id": "ground", "fixed": True}]
    for id, (position, turned, length) in placed.items():
        mass = 0.3 * length
        moment = {"xx": 1e-4 * mass, "yy": mass * length**2 / 12, "zz": mass * length**2 / 12}
        inertial = {"mass_kg": mass, "center_of_mass_m": [length / 2, 0.0, 0.0], "inertia_kg_m2": moment}
        bodies.append({"id": id, "pose": {"position_m": position, "quaternion_wxyz": turned}, "inertial": inertial})

    def pin(id: str, a: str, at_a: float, b: str, at_b: float) -> dict:
        turned = {"ground": level, "coupler": level, "crank": back, "rocker": back}
        ends = {"frame_a": (a, at_a), "frame_b": (b, at_b)}
        frames = {k: {"position_m": [at, 0.0, 0.0], "quaternion_wxyz": turned[body]} for k, (body, at) in ends.items()}
        return {"id": id, "type": "revolute", "body_a": a, "body_b": b, **frames}

    joints = [
        pin("A", "ground", 0.0, "crank", 0.0),
        pin("B", "crank", crank_m, "coupler", 0.0),
        pin("C", "coupler", ground_m, "rocker", crank_m),
        pin("D", "ground", ground_m, "rocker", 0.0),
    ]
    return parse_mechanism({"schema_version": "1.0", "name": "parallelogram", "bodies": bodies, "joints": joints})


def _line(name: str, given: Run, let_go: Run) -> str:
    if given.redundancy is None or let_go.kept is None:
        raise RuntimeError(f"{name}: too many rows to look for redundancy")
    points = np.concatenate([p[:1] for p in given.position_m.values()])
    length = float(np.linalg.norm(np.ptp(points, axis=0))) or 1.0
    apart = max(np.abs(given.position_m[body] - let_go.position_m[body]).max() for body in given.position_m)
    turns = max(np.ptp(q) for q in given.q.values()) / (2 * np.pi)
    return (
        f"| {name} | {len(given.redundancy.redundant)} | {turns:.1f} | {len(let_go.kept.removed)} | "
        f"{let_go.kept.carried} | {apart / length:.1e} | {let_go.constraint_error_m.max():.1e} |"
    )


def _reaction(name: str, joint: str, given: Run, let_go: Run) -> str:
    rows = given.redundancy.not_unique.get(joint, ()) if given.redundancy else ()
    cells = []
    for kind in ("reaction_force_n", "reaction_torque_n_m"):
        a, b = getattr(given, kind)[joint], getattr(let_go, kind)[joint]
        cells += [f"{np.abs(a).max():.3g}", f"{np.abs(a - b).max():.2g}"]
    return f"| {name} | {joint} | {', '.join(rows) or 'none'} | {' | '.join(cells)} |"


if __name__ == "__main__":
    main()
