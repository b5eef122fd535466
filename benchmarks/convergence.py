"""How a loose pin's motion settles as the step h and the barrier κ shrink together, and that at a fixed κ it does not.

python -m benchmarks.convergence

The 5-cell scissor opened by its spring, pin top1 loose by 1 mm: it falls through its hole, strikes, slides along the
wall.  RMS over 0.2 s of the tip's distance from the motion at the finest step and the default barrier.  A wall carries
γ = F h in a step and keeps its slack s with s γ = κ, so a force F stands off by s = κ / (F h): κ = ε h leaves the same
ε / F at every step, κ ∝ h² closes it, and a fixed κ opens it as h shrinks.
"""

from collections.abc import Callable
from pathlib import Path

import equinox as eqx
import jax.numpy as jnp
import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt

from backend.mechanism.effect import Effect
from backend.model.build import build
from backend.model.model import Model
from backend.model.state import Start, drawn_pose
from backend.model.system import system
from backend.simulate.assemble import closed
from backend.simulate.rollout import depart, march
from benchmarks.scissor import scissor

FINEST_S, DURATION_S, CHUNK = 1.5625e-5, 0.2, 50
STEPS_S = tuple(4e-3 / 2**k for k in range(7))
COARSEST_S, TIP = STEPS_S[0], "a4"
AT_S = 1e-3  # where every barrier but the default has its κ of the table's head
PICTURE = Path(__file__).parents[1] / "docs" / "pictures" / "convergence.png"

BARRIERS: dict[str, Callable[[float], float] | None] = {
    "default": None,
    "1e-9, fixed": lambda h: 1e-9,
    "1e-10, fixed": lambda h: 1e-10,
    "1e-9, with h": lambda h: 1e-9 * h / AT_S,
    "1e-9, with h²": lambda h: 1e-9 * (h / AT_S) ** 2,
}
_depart, _march = eqx.filter_jit(depart), eqx.filter_jit(march)


def tip(model: Model, step_s: float, kappa: float | None) -> np.ndarray:
    """Places of the last bar's middle at the coarsest step's times (T, 3)."""
    plant = system(model)
    if kappa is not None:
        plant = eqx.tree_at(lambda s: s.barrier, plant, jnp.asarray(kappa / step_s))
    start = Start(closed(plant, drawn_pose(model, plant)), jnp.zeros((model.topology.slots, 6)))
    carry, seen = (_depart(plant, start), jnp.zeros((), dtype=bool)), []
    for _ in range(round(DURATION_S / step_s) // CHUNK):
        carry, nodes = _march(plant, carry, jnp.asarray(step_s), CHUNK, None, 10)
        seen.append(np.asarray(nodes.pose.position[:, model.topology.slot(TIP)]))
    if bool(carry[1]):
        raise RuntimeError(f"a step of {step_s} s at κ {kappa} was lost")
    return np.concatenate(seen)[:: round(COARSEST_S / step_s)]


def main() -> None:
    play = Effect(id="play", kind="clearance", on=("top1",), parameters={"radial_m": 1e-3})
    model = build(scissor(5), [play])
    truth = tip(model, FINEST_S, None)
    print(f"default κ at 1 ms: {AT_S * float(system(model).barrier):.1e} J s; RMS of the tip's distance [µm]")
    print(f"{'h ms':>8}" + "".join(f"{name:>16}" for name in BARRIERS))
    off = np.zeros((len(STEPS_S), len(BARRIERS)))
    for row, h in enumerate(STEPS_S):
        for column, barrier in enumerate(BARRIERS.values()):
            apart = tip(model, h, barrier and barrier(h)) - truth
            off[row, column] = 1e6 * np.sqrt((apart**2).sum(1).mean())
        print(f"{1e3 * h:8.4f}" + "".join(f"{value:16.3f}" for value in off[row]), flush=True)
    figure, axes = plt.subplots(figsize=(5.6, 3.4), layout="constrained")
    for name, values in zip(BARRIERS, off.T, strict=True):
        axes.loglog(1e3 * np.array(STEPS_S), values, "o-", ms=3, lw=1.0, label=f"κ {name}")
    axes.set(xlabel="h, ms", ylabel="tip off the finest motion, µm")
    axes.legend(fontsize=7, frameon=False)
    figure.savefig(PICTURE, dpi=110)


if __name__ == "__main__":
    main()
