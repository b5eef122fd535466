"""Where loose, rubbing and bouncing mechanisms are hardest to follow: how many steps stay unsolved.

python -m benchmarks.stress           the shares of the grid in SHARES, drawn with a fixed seed
python -m benchmarks.stress all       the whole grid

3-D scissors with play at every pin, 100 steps each; crank linkages that a torque drives through their dead centres.
A program is compiled once per linkage, every number of a case is traced.
"""

import itertools
import sys
import time
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from backend.mechanism.mechanism import Mechanism
from backend.mechanism.read import parse_mechanism
from backend.model.build import build
from backend.model.model import Model
from backend.model.state import Start, drawn_pose
from backend.model.system import TOLERANCE, system
from backend.simulate.rollout import UNSOLVED, Trajectory, rollout
from backend.simulate.run import HALVINGS, simulate
from benchmarks.redundancy import parallelogram
from benchmarks.scissor import scissor
from tests.mechanisms import slider_crank

STEPS, SEED, G = 100, 5, 9.80665
RADIAL_M = (0.0, 5e-5, 5e-4, 2e-3)
FRICTION = (0.0, 0.1, 0.3, 1.0, 2.0)
STEP_S = (2.5e-4, 1e-3, 4e-3)
PUSH_G = (0.0, 20.0)  # beside gravity as drawn, from the first moment on
RESTITUTION = (0.0, 0.8)
SHARES = {"scissor 1": 1.0, "scissor 5": 1.0, "scissor 10": 0.5, "scissor 23": 0.2, "scissor 50": 0.1}
PUSHED = np.array([1.0, -1.0, 0.3]) / np.linalg.norm([1.0, -1.0, 0.3])
TORQUE_N_M = 0.05  # on the crank, half a turn and more in 0.1 s


class Case(NamedTuple):
    """One motion of the grid."""

    radial_m: float
    friction: float
    step_s: float
    push_g: float
    restitution: float


class Outcome(NamedTuple):
    """What became of one motion."""

    case: Case
    cut: int
    """Steps that were cut in two at least once."""
    unsolved: int
    """Steps whose residual stayed above the tolerance though they count as solved."""
    lost_at: int | None
    finite: bool
    iterations: np.ndarray


LINKAGES: dict[str, Callable[[], Mechanism]] = {
    **{f"scissor {cells}": lambda cells=cells: scissor(cells) for cells in (1, 5, 10, 23, 50)},
    "slider-crank": lambda: slider_crank(angle=0.3),
    "parallelogram": parallelogram,
}
GRID = [Case(*values) for values in itertools.product(RADIAL_M, FRICTION, STEP_S, PUSH_G, RESTITUTION)]


def drawn(name: str, case: Case) -> Mechanism:
    """The linkage with play at every pin; crank linkages with a torque on their crank."""
    document = LINKAGES[name]().model_dump(mode="json", exclude_none=True)
    pins = [joint["id"] for joint in document["joints"] if joint["type"] == "revolute"]
    play = {"radial_m": case.radial_m, "friction_coefficient": case.friction, "restitution": case.restitution}
    document["effects"].append({"id": "play", "kind": "clearance", "on": pins, "parameters": play})
    if not name.startswith("scissor"):
        torque = {"torque_n_m": TORQUE_N_M, "axis": [0, 0, 1]}
        document["effects"].append({"id": "motor", "kind": "applied_torque", "on": ["crank"], "parameters": torque})
    weight = np.array(document["gravity_m_per_s2"]) + case.push_g * G * PUSHED
    return parse_mechanism({**document, "gravity_m_per_s2": weight.tolist()})


@eqx.filter_jit
def follow(model: Model, step_s: jax.Array) -> Trajectory:
    """The motion from rest at the drawn pose."""
    plant = system(model)
    start = Start(drawn_pose(model, plant), jnp.zeros((model.topology.slots, 6)))
    return rollout(plant, start, step_s, STEPS, None, HALVINGS)


def placed(model: Model, case: Case, gravity: np.ndarray) -> Model:
    """The case's numbers in a model that is compiled already."""
    play = {"radial_m": case.radial_m, "friction_coefficient": case.friction, "restitution": case.restitution}
    model = model.with_parameters({("play", name): jnp.asarray(value) for name, value in play.items()})
    weight = jnp.asarray(gravity + case.push_g * G * PUSHED)
    return eqx.tree_at(lambda m: m.drawing.gravity, model, weight)


def outcome(model: Model, case: Case, gravity: np.ndarray) -> Outcome:
    path = jax.tree.map(np.asarray, follow(placed(model, case, gravity), jnp.asarray(case.step_s)))
    lost = np.flatnonzero(path.lost)
    held = ~path.lost
    return Outcome(
        case,
        int((path.halvings[held] > 0).sum()),
        int((path.error[held] > UNSOLVED * TOLERANCE).sum()),
        int(lost[0]) if lost.size else None,
        all(np.isfinite(leaf).all() for leaf in (path.pose.position, path.velocity, path.reaction, path.q)),
        path.iterations[held],
    )


def line(name: str, outcomes: list[Outcome]) -> str:
    iterations = np.concatenate([o.iterations for o in outcomes])
    cut, unsolved = sum(o.cut for o in outcomes), sum(o.unsolved for o in outcomes)
    lost = sum(o.lost_at is not None for o in outcomes)
    return (
        f"{name:<24} {len(outcomes):8d} {iterations.size:8d} {iterations.mean():11.2f} {iterations.max():5d}"
        f" {cut:6d} {unsolved:9d} {lost:5d}"
    )


HEAD = f"{'':<24} {'motions':>8} {'steps':>8} {'iterations':>11} {'max':>5} {'cut':>6} {'unsolved':>9} {'lost':>5}"


def main(which: str = "") -> None:
    rng, begin = np.random.default_rng(SEED), time.perf_counter()
    seen: dict[str, list[Outcome]] = {}
    print(HEAD)
    for name in LINKAGES:
        share = 1.0 if which == "all" else SHARES.get(name, 0.5)
        cases = [case for case in GRID if rng.random() < share]
        model = build(drawn(name, GRID[0]))
        gravity = np.asarray(model.drawing.gravity)
        seen[name] = [outcome(model, case, gravity) for case in cases]
        print(line(name, seen[name]), f"  {time.perf_counter() - begin:4.0f} s", flush=True)
    every = [o for outcomes in seen.values() for o in outcomes]
    for field in Case._fields:
        print()
        for value in sorted({getattr(o.case, field) for o in every}):
            print(line(f"{field} {value:g}", [o for o in every if getattr(o.case, field) == value]))
    gone = [(name, o) for name, outcomes in seen.items() for o in outcomes if o.lost_at is not None]
    print("\nlost:" if gone else "\nnone lost")
    for name, o in gone:
        print(f"  {name:<14} step {o.lost_at:3d}  {o.case}")
    for name, o in gone[:3]:
        print(f"  {name}: {simulate(drawn(name, o.case), STEPS * o.case.step_s, o.case.step_s).result}")
    steps = sum(o.iterations.size for o in every)
    print(
        f"\n{len(every)} motions, {steps} steps, {sum(o.cut for o in every)} cut, "
        f"{sum(o.unsolved for o in every)} above the tolerance, {len(gone)} motions lost, "
        f"{sum(not o.finite for o in every)} not finite; {time.perf_counter() - begin:.0f} s"
    )


if __name__ == "__main__":
    main(*sys.argv[1:2])
