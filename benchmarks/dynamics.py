"""Cost of a step, of compilation and of derivatives, beside MuJoCo in the same run.

python -m benchmarks.dynamics              # everything, a few minutes
python -m benchmarks.dynamics --cells 23
"""

import argparse
import os
import time

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from backend.mechanism.effect import Effect
from backend.model.build import build
from backend.model.model import Model
from backend.model.state import Start, drawn_pose
from backend.model.system import system
from backend.simulate.assemble import closed
from backend.simulate.rollout import Trajectory, rollout
from benchmarks.scissor import scissor

STEP_S, STEPS, STARTS = 1e-3, 200, 8


def let_go(model: Model, tolerance: float = 1e-10) -> Trajectory:
    """200 ms of the drawn mechanism from rest."""
    plant = system(model, tolerance)
    pose = closed(plant, drawn_pose(model, plant))
    return rollout(plant, Start(pose, jnp.zeros((model.topology.slots, 6))), STEP_S, STEPS)


def median_s(call, *arguments, runs: int = 7) -> float:
    """Median processor time of a compiled call on one core: what other programs do to the machine stays out."""
    jax.block_until_ready(call(*arguments))
    times = []
    for _ in range(runs):
        begin = time.process_time()
        jax.block_until_ready(call(*arguments))
        times.append(time.process_time() - begin)
    return float(np.median(times))


def step_cost(cells: list[int]) -> None:
    """µs per step and seconds of compilation, rigid 3-D scissor."""
    titles = {"cells": 6, "bodies": 7, "compile s": 10, "us/step": 9, "us/step/cell": 13, "Newton": 7, "MuJoCo us": 10}
    print(" ".join(f"{title:>{width}}" for title, width in titles.items()))
    per_cell = {}
    for count in cells:
        model = build(scissor(count))
        begin = time.perf_counter()
        compiled = eqx.filter_jit(let_go).lower(model).compile()
        compile_s = time.perf_counter() - begin
        path = compiled(model)
        if bool(path.lost.any()):
            raise RuntimeError(f"{count} cells: a step was lost")
        cost = median_s(compiled, model) / (STEPS + 1) * 1e6
        per_cell[count] = cost / count
        print(
            f"{count:>6} {2 * count + 1:>7} {compile_s:>10.1f} {cost:>9.0f} {cost / count:>13.1f} "
            f"{float(path.iterations.mean()):>7.2f} {mujoco_cost(count):>10}"
        )
    print(f"cost per cell, largest over smallest: {max(per_cell.values()) / min(per_cell.values()):.2f}\n")


def mujoco_cost(cells: int) -> str:
    """MuJoCo's figure for its own 3-D scissor, '-' where it is not installed or too large to wait for."""
    if cells > 50:
        return "-"
    try:
        from benchmarks.mujoco_scissor import time_mujoco_scissor
    except ImportError:
        return "-"
    return f"{time_mujoco_scissor(cells)['step_us']:.0f}"


def derivative_cost(cells: int) -> None:
    """Forward and adjoint derivatives: time over a plain rollout, and agreement with central differences."""
    friction = [
        Effect(id="v", kind="viscous_friction", on="all", parameters={"damping_n_m_s_per_rad": 1e-4}),
        Effect(id="p", kind="pin_friction", on="all", parameters={"friction_coefficient": 0.1}),
        Effect(id="m", kind="mass_error", on=["a0"], parameters={"relative": 0.01}),
        Effect(id="l", kind="length_error", on="all", parameters={"relative": 0.001}),
    ]
    model = build(scissor(cells), friction)
    names = [
        ("v", "damping_n_m_s_per_rad"), ("p", "friction_coefficient"), ("m", "relative"), ("l", "relative"),
        ("spring", "stiffness_n_per_m"), ("spring", "free_length_m"),
    ]  # fmt: skip
    at = jnp.array([float(np.ravel(model.parameters[name].value)[0]) for name in names])
    unit = jnp.array([1e-4, 0.1, 1.0, 1.0, 50.0, 0.1])

    def seen(scaled, tolerance=1e-10):
        return let_go(model.with_parameters(dict(zip(names, scaled * unit, strict=True))), tolerance).pose.position[
            ::20
        ]

    scaled = at / unit
    plain = jax.jit(seen)
    loss = jax.jit(jax.grad(lambda x: jnp.sum(seen(x) ** 2)))
    forward = jax.jit(lambda x: jax.vmap(lambda v: jax.jvp(seen, (x,), (v,))[1])(jnp.eye(len(names))))
    base = median_s(plain, scaled)
    rows = [("adjoint (one gradient)", loss), (f"forward ({len(names)} parameters)", forward)]
    print(f"{cells}-cell scissor, {STEPS} steps: rollout {base * 1e3:.1f} ms")
    for name, call in rows:
        begin = time.perf_counter()
        jax.block_until_ready(call(scaled))
        first = time.perf_counter() - begin
        print(f"  {name}: {median_s(call, scaled) / base:.2f} x a rollout (first call {first:.1f} s)")
    slopes_of = jax.vmap(lambda x, v: jax.jvp(seen, (x,), (v,))[1], in_axes=(None, 0))
    starts = scaled * jnp.exp(0.1 * jax.random.normal(jax.random.key(0), (STARTS, len(names))))
    alone = STARTS * median_s(forward, starts[0])
    for words, size in (("one after the other", None), ("by twos", 2), ("by fours", 4), ("at once", STARTS)):
        together = jax.jit(
            lambda all_, size=size: lax.map(lambda x: slopes_of(x, jnp.eye(len(names))), all_, batch_size=size)
        )
        print(f"  slopes of {STARTS} starts in one program, {words}: {median_s(together, starts) / alone:.2f} x apart")
    fine = jax.jit(lambda x: seen(x, 1e-12))
    slope, values = np.asarray(forward(scaled)), np.asarray(plain(scaled))
    gradient = 2 * np.tensordot(slope, values, axes=values.ndim)
    adjoint = np.asarray(loss(scaled))
    print(f"  adjoint against forward: {np.abs(adjoint - gradient).max() / np.abs(gradient).max():.1e}")
    for i, (effect, parameter) in enumerate(names):
        errors = []
        for by in (1e-3, 1e-4, 1e-5):
            shift = jnp.zeros(len(names)).at[i].set(by * max(float(abs(scaled[i])), 1e-2))
            difference = np.asarray((fine(scaled + shift) - fine(scaled - shift)) / (2 * shift[i]))
            errors.append(np.linalg.norm(difference - slope[i]) / np.linalg.norm(difference))
        print(f"  {effect}.{parameter}: forward against central differences {min(errors):.1e}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cells", type=int, nargs="*", default=[10, 23, 50, 100, 200])
    arguments = parser.parse_args()
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})  # the figures are for one core
    step_cost(arguments.cells)
    derivative_cost(10)
