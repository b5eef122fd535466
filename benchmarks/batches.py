"""Rollouts a second of a batch, with and without the compiled kernel, beside MuJoCo's threaded rollout.

python -m benchmarks.batches              # on every core it is given
"""

import os
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from backend.blind import mujoco_engine
from backend.blind.closure import assemble
from backend.blind.drawn import read_drawing
from backend.blind.mujoco_model import Wall, mujoco_spec
from backend.jam.batch import TOGETHER
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.read import read_mechanism
from backend.model.build import build
from backend.model.state import Start, drawn_pose
from backend.model.system import system
from backend.simulate.assemble import closed
from backend.simulate.kernel import call
from backend.simulate.rollout import rollout
from benchmarks.mujoco_scissor import SETTINGS
from benchmarks.mujoco_scissor import scissor as mujoco_scissor
from benchmarks.scissor import scissor

SAMPLES = Path(__file__).parents[1] / "samples"
BATCH, STEP_S, STEPS, REPEATS = 256, 1e-3, 200, 3
CORES = len(os.sched_getaffinity(0))
RATE_PER_S = 1.0 / (6.0 * STEP_S)  # of walls, of which the four-bar has none


def ours(mechanism: Mechanism, switch: str) -> float:
    """Rollouts a second, a thread a core; every sample has masses of its own."""
    os.environ[call.SWITCH] = switch
    jax.clear_caches()
    model = build(mechanism)
    plant = system(model)
    pose = closed(plant, drawn_pose(model, plant))

    def tip(scale):
        heavier = eqx.tree_at(lambda s: (s.mass, s.inertia), plant, (plant.mass * scale, plant.inertia * scale))
        path = rollout(heavier, Start(pose, jnp.zeros((model.topology.slots, 6))), STEP_S, STEPS)
        return path.pose.position[-1], path.lost[-1]

    @jax.jit
    def several(scales):
        return lax.map(tip, scales, batch_size=TOGETHER)

    shares = jnp.linspace(0.9, 1.1, BATCH).reshape(-1, 4 * TOGETHER)
    if bool(several(shares[0])[1].any()):
        raise RuntimeError(f"{mechanism.name}: a step was lost")
    with ThreadPoolExecutor(CORES) as pool:
        return BATCH / median_wall_s(lambda: list(pool.map(lambda s: jax.block_until_ready(several(s)), shares)))


def mujoco_rollouts(model) -> float:
    """Rollouts a second of mujoco.rollout, a thread a core."""
    import mujoco
    from mujoco.rollout import Rollout

    datas = [mujoco.MjData(model) for _ in range(CORES)]
    size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    state = np.zeros(size)
    mujoco.mj_getState(model, datas[0], state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    states = np.tile(state, (BATCH, 1))
    with Rollout(nthread=CORES) as pool:
        return BATCH / median_wall_s(lambda: pool.rollout(model, datas, states, nstep=STEPS))


def mujoco_fourbar(mechanism: Mechanism, integrator: str):
    """The drawing in MuJoCo, its loop closed by a weld through a body."""
    import mujoco

    drawing = read_drawing(mechanism, None, engine="MuJoCo", kinds=mujoco_engine.KINDS)
    spec = mujoco_spec(drawing, assemble(drawing, None), (2 * STEP_S, 1.0), Wall(RATE_PER_S), bare=False)
    spec.option.timestep = STEP_S
    spec.option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    return spec.compile()


def median_wall_s(work) -> float:
    """Median of wall-clock times: threads are what is compared."""
    times = []
    for _ in range(REPEATS):
        begin = time.perf_counter()
        work()
        times.append(time.perf_counter() - begin)
    return float(np.median(times))


def main() -> None:
    """One line a linkage."""
    print(f"{BATCH} rollouts of {STEPS} steps of 1 ms, {CORES} cores: rollouts a second")
    fourbar = read_mechanism(SAMPLES / "fourbar" / "mechanism.json")
    peers = {
        "four-bar": {f"weld, {i}": mujoco_fourbar(fourbar, i) for i in ("implicitfast", "RK4")},
        "scissor of 10 cells": {f"{c}, {i}": mujoco_scissor(10, STEP_S, i, c) for c, i in SETTINGS},
    }
    for name, drawn in (("four-bar", fourbar), ("scissor of 10 cells", scissor(10))):
        line = f"{name:20s} JAX {ours(drawn, 'off'):7.0f}"
        os.environ[call.SWITCH] = "on"
        if call.available():
            line += f"   kernel {ours(drawn, 'on'):7.0f}"
        for setting, model in peers[name].items():
            line += f"   MuJoCo ({setting}) {mujoco_rollouts(model):7.0f}"
        print(line, flush=True)


if __name__ == "__main__":
    main()
