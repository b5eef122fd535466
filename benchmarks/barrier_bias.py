"""What the interior point's barrier does to a fitted clearance and friction, and that the default does not show.

python -m benchmarks.barrier_bias

10-cell scissor, every pin 1 mm loose with contact friction 0.01, 200 ms from rest at h = 1 ms, centres of all bars
each millisecond, no noise.  The data are made at the barrier named first; the fit (Levenberg-Marquardt on both numbers,
scaled) uses the barrier of each row.  κ = barrier x step.
"""

import time

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from backend.mechanism.effect import Effect
from backend.model.build import build
from backend.model.model import Model
from backend.model.state import Start, drawn_pose
from backend.model.system import system
from backend.simulate.assemble import closed
from backend.simulate.rollout import rollout
from benchmarks.scissor import scissor

CELLS, STEP_S, STEPS = 10, 1e-3, 200
RADIAL_M, FRICTION = 1e-3, 0.01
UNIT = np.array([1e-3, 0.01])
START = np.array([0.9, 1.5])  # of the unit
SHARP = 1e-12  # error of a step, so that differences between barriers are not the solver's


def loose_scissor() -> Model:
    pins = [joint.id for joint in scissor(CELLS).joints if joint.type == "revolute"]
    play = {"radial_m": RADIAL_M, "friction_coefficient": FRICTION}
    return build(scissor(CELLS), [Effect(id="play", kind="clearance", on=pins, parameters=play)])


def seen(model: Model, values: jax.Array, kappa: jax.Array) -> jax.Array:
    """Centres of all bars at each step."""
    pair = {("play", "radial_m"): values[0] * UNIT[0], ("play", "friction_coefficient"): values[1] * UNIT[1]}
    model = model.with_parameters(pair)
    plant = eqx.tree_at(lambda s: s.barrier, system(model, SHARP), kappa / STEP_S)
    start = Start(closed(plant, drawn_pose(model, plant)), jnp.zeros((model.topology.slots, 6)))
    return rollout(plant, start, STEP_S, STEPS).pose.position.ravel()


def main() -> None:
    model = loose_scissor()

    @jax.jit
    def linearised(values: jax.Array, kappa: jax.Array) -> tuple[jax.Array, jax.Array]:
        both = jax.vmap(lambda v: jax.jvp(lambda x: seen(model, x, kappa), (values,), (v,)), out_axes=(None, 0))
        return both(jnp.eye(2))

    def fit(data: jax.Array, kappa: float) -> tuple[np.ndarray, int]:
        values, damping = START.copy(), 1e-3
        now, slope = linearised(jnp.asarray(values), jnp.asarray(kappa))
        for count in range(40):
            off = np.asarray(now - data)
            J = np.asarray(slope).T
            H = J.T @ J
            change = np.linalg.solve(H + damping * np.diag(np.diag(H)), -J.T @ off)
            trial = np.maximum(values + np.clip(change, -0.3, 0.3), 1e-4)
            ahead, ahead_slope = linearised(jnp.asarray(trial), jnp.asarray(kappa))
            if np.sum(np.asarray(ahead - data) ** 2) < np.sum(off**2):
                moved = np.abs(trial - values).max()
                values, now, slope, damping = trial, ahead, ahead_slope, 0.1 * damping
                if moved < 1e-9:
                    return values, count
            else:
                damping *= 10.0
                if damping > 1e6:
                    return values, count
        return values, 40

    default = float(system(model).barrier) * STEP_S
    truth = np.array([RADIAL_M, FRICTION]) / UNIT
    begin = time.perf_counter()
    data = {kappa: linearised(jnp.asarray(truth), jnp.asarray(kappa))[0] for kappa in (1e-12, 1e-14)}
    print(f"compiled in {time.perf_counter() - begin:.0f} s; default κ at h = 1 ms: {default:.1e} J s")
    print(f"{'data κ':>8} {'fit κ':>8} {'δ off':>10} {'μ off':>10} {'iterations':>10}")
    for made, fitted in [(1e-12, k) for k in (1e-8, 1e-9, 1e-10, 1e-11, default)] + [(1e-14, default)]:
        values, count = fit(data[made], fitted)
        off = values / truth - 1.0
        print(f"{made:8.0e} {fitted:8.1e} {off[0]:10.2e} {off[1]:10.2e} {count:10d}", flush=True)


if __name__ == "__main__":
    main()
