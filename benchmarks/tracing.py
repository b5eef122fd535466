"""What a first program of a mechanism costs before it runs: traced, lowered and compiled, in processor seconds.

python -m benchmarks.tracing

Slopes in two directions and sixteen motions side by side, of the sample's four-bar, rigid and with play at every pin:
with loops whose slopes go round with them (`simulate/loop.py`), and as JAX makes them from whole loops.  Before them
what it takes to put the model and its system together.
"""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from backend.fit.prediction import with_values
from backend.mechanism.effect import Effect
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.read import read_mechanism
from backend.model.build import build
from backend.model.model import Address, Model
from backend.model.state import Start, drawn_pose
from backend.model.system import system
from backend.simulate import rollout as rollouts
from backend.simulate.assemble import let_go
from backend.simulate.loop import loop

FOURBAR = Path(__file__).resolve().parents[1] / "samples" / "fourbar" / "mechanism.json"
STEP_S, STEPS, HALVINGS, SAMPLES = 1e-3, 200, 8, 16


def whole(wanted: Callable, onward: Callable, given: Any, state: Any) -> Any:
    """JAX's own way with a loop."""
    return lax.while_loop(lambda s: wanted(given, s), lambda s: onward(given, s), state)


def drawn(loose: bool) -> tuple[Mechanism, tuple[Address, Address]]:
    """The four-bar, and two numbers of it that vary."""
    drag = Effect(kind="viscous_friction", id="drag", on="all", parameters={"damping_n_m_s_per_rad": 1e-3})
    play = Effect(kind="clearance", id="play", on="all", parameters={"radial_m": 5e-4, "friction_coefficient": 0.1})
    drag_at = ("drag", "damping_n_m_s_per_rad")
    mechanism = read_mechanism(FOURBAR)
    if not loose:
        rub = Effect(kind="coulomb_friction", id="rub", on="all", parameters={"friction_torque_n_m": 1e-3})
        more, varied = (drag, rub), (drag_at, ("rub", "friction_torque_n_m"))
    else:
        more, varied = (drag, play), (drag_at, ("play", "radial_m"))
    return mechanism.model_copy(update={"effects": (*mechanism.effects, *more)}), varied


def programs(loose: bool, addresses: tuple[Address, Address]) -> dict[str, Callable]:
    """Each takes a model, its start and values."""

    def path(model: Model, start: Start, x: jax.Array) -> jax.Array:
        plant = system(with_values(model, tuple((a,) for a in addresses), x))
        end = jnp.asarray(STEPS)
        motion = rollouts.rollout(plant, start, STEP_S, STEPS, None, HALVINGS if loose else 0, end)
        return motion.pose.position

    def slopes(model: Model, start: Start, x: jax.Array) -> tuple:
        def along(direction: jax.Array) -> tuple:
            return jax.jvp(lambda x: path(model, start, x), (x,), (direction,))

        return jax.vmap(along, out_axes=(None, 0))(jnp.eye(2))

    def batch(model: Model, start: Start, x: jax.Array) -> jax.Array:
        return jax.vmap(lambda x: path(model, start, x))(x * jnp.linspace(1.0, 1.5, SAMPLES)[:, None])

    return {"two slopes": slopes, "sixteen side by side": batch}


def seconds(call: Callable, *arguments: Any) -> tuple[float, Any]:
    """Processor time of a call, and what it returns."""
    begin = time.process_time()
    made = jax.block_until_ready(call(*arguments))
    return time.process_time() - begin, made


def measured(function: Callable, arguments: tuple) -> tuple[str, Any]:
    """Seconds to trace, lower, compile and run, and what a run returns."""
    jax.clear_caches()
    begin = time.process_time()
    trace = jax.jit(lambda *x: function(*x)).trace(*arguments)
    traced = time.process_time()
    lowered = trace.lower()
    low = time.process_time()
    compiled = lowered.compile()
    ready = time.process_time()
    result = compiled(*arguments)
    run = min(seconds(compiled, *arguments)[0] for _ in range(5))
    return f"{traced - begin:6.1f} {low - traced:7.1f} {ready - low:8.1f} {run:8.3f}", result


def main() -> None:
    """Print the table."""
    print(f"{'four-bar':10s} {'program':22s} {'loops':10s} traced lowered compiled    run s")
    for loose in (False, True):
        mechanism, addresses = drawn(loose)
        name = "loose" if loose else "rigid"
        built, model = seconds(build, mechanism)
        summed, plant = seconds(system, model)
        print(f"{name:10s} {'model and its system':22s} {'':10s} {built + summed:6.1f}")
        start = let_go(plant, drawn_pose(model, plant))
        x = jnp.array([model.parameters[a].value for a in addresses], dtype=float)
        for title, function in programs(loose, addresses).items():
            results = []
            for way, used in (("JAX's", whole), ("ours", loop)):
                rollouts.loop = used
                told, result = measured(function, (model, start, x))
                print(f"{name:10s} {title:22s} {way:10s} {told}", flush=True)
                results.append(result)
            for one, other in zip(*map(jax.tree.leaves, results), strict=True):
                np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-9)


if __name__ == "__main__":
    main()
