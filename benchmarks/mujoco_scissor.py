"""How long MuJoCo takes for a step of a rigid 3-D scissor: the figure that ours is printed beside.

Run `python benchmarks/mujoco_scissor.py`; `time_mujoco_scissor` serves a benchmark that prints both in one run.
MuJoCo carries tree coordinates, hinges about the pins, and closes each cell in one of two ways.  `one`: a single
`connect` (3 rows), the cheapest, enough while the bars stay in parallel planes.  `two`: a `connect` at either end of
the pin (6 rows), which also holds the pin's axis, redundant rows and all, as every joint of ours does.  Steps run in C
(`mj_step(nstep=...)`), on one core; of MuJoCo's dense and sparse Jacobians the faster one counts.
"""

from __future__ import annotations

import importlib
import statistics
import time
from typing import Any

BAR_M, ANGLE_RAD, BAR_KG = 0.2, 0.6, 0.05
STIFFNESS_N_PER_M = 50.0
HALF_PIN_M = 0.01


def _mujoco() -> Any:
    return importlib.import_module("mujoco")


def scissor(cells: int, step_s: float, integrator: str, closure: str = "one") -> Any:
    """A compiled MjModel: crossed bars along x, a spring across the first cell, the first bar on a hinge.

    closure: `one` connect in the middle of each closing pin, or `two`, at its ends.
    """
    import numpy as np

    mujoco = _mujoco()
    half = BAR_M / 2
    c, s = half * np.cos(ANGLE_RAD), half * np.sin(ANGLE_RAD)
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.option.timestep = step_s
    spec.option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    about_z = np.array([BAR_KG * 2e-4 / 12, *2 * [BAR_KG * (BAR_M**2 + 1e-4) / 12]])
    world = spec.worldbody
    poses: dict[str | None, tuple[Any, float]] = {None: (np.zeros(2), 0.0)}

    def bar(name: str, parent: Any, on: str | None, centre: tuple[float, float], angle: float, pin: tuple) -> Any:
        p_parent, turn = poses[on]
        back = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        d = angle - turn
        body = parent.add_body(
            name=name,
            pos=[*(back @ (np.array(centre) - p_parent)), 0.0],
            quat=[np.cos(d / 2), 0, 0, np.sin(d / 2)],
        )
        body.explicitinertial, body.mass, body.inertia = True, BAR_KG, about_z
        body.ipos, body.iquat = [0, 0, 0], [1, 0, 0, 0]  # left alone, they become the body's place in its parent
        local = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]) @ (
            np.array(pin) - np.array(centre)
        )
        body.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1], pos=[*local, 0.0])
        poses[name] = (np.array(centre), angle)
        return body

    parent_a, on_a = world, None
    for i in range(cells):
        x = 2 * c * i
        a = bar(f"a{i}", parent_a, on_a, (x + c, 0.0), ANGLE_RAD, (x, -s))
        b = bar(f"b{i}", a, f"a{i}", (x + c, 0.0), -ANGLE_RAD, (x + c, 0.0))
        if i:
            # The tree runs b(i-1) -> a(i) -> b(i); the loop closes at the upper pin, a(i-1) to b(i).
            for along in (0.0,) if closure == "one" else (HALF_PIN_M, -HALF_PIN_M):
                pin = spec.add_equality(type=mujoco.mjtEq.mjEQ_CONNECT, objtype=mujoco.mjtObj.mjOBJ_BODY)
                pin.name1, pin.name2 = f"a{i - 1}", f"b{i}"
                pin.data = np.array([half, 0.0, along, *np.zeros(len(pin.data) - 3)])
                pin.solref, pin.solimp = (0.002, 1.0), (0.9999, 0.9999, 0.001, 0.5, 2.0)
        else:
            a.add_site(name="low", pos=[-half, 0, 0])
            b.add_site(name="high", pos=[-half, 0, 0])
        parent_a, on_a = b, f"b{i}"
    spring = spec.add_tendon(name="spring", stiffness=[STIFFNESS_N_PER_M, 0, 0], springlength=[1.5 * s, 1.5 * s])
    spring.wrap_site("low")
    spring.wrap_site("high")
    return spec.compile()


def time_mujoco_scissor(
    cells: int,
    *,
    step_s: float = 1e-3,
    integrator: str = "implicitfast",
    closure: str = "one",
    steps: int = 200,
    repeats: int = 5,
) -> dict[str, float | int | str]:
    """Processor time of one step [µs], median of `repeats` runs of `steps`, and how well loops and energy hold.

    Returns cells, step_us, jacobian, loop_error_m (largest gap), energy_error (largest drift of the energy over the
    largest kinetic energy), version.
    """
    import numpy as np

    mujoco = _mujoco()
    model = scissor(cells, step_s, integrator, closure)
    data, spent = mujoco.MjData(model), {}
    for name, kind in (("dense", mujoco.mjtJacobian.mjJAC_DENSE), ("sparse", mujoco.mjtJacobian.mjJAC_SPARSE)):
        if name == "dense" and cells > 60:
            continue  # grows with the cube
        model.opt.jacobian = kind
        runs = []
        for _ in range(repeats):
            mujoco.mj_resetData(model, data)
            mujoco.mj_forward(model, data)
            start = time.process_time()
            mujoco.mj_step(model, data, nstep=steps)
            runs.append((time.process_time() - start) / steps * 1e6)
        spent[name] = statistics.median(runs)
    fastest = min(spent, key=lambda name: spent[name])
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    mujoco.mj_resetData(model, data)
    mujoco.mj_forward(model, data)
    energies, kinetic, gap = [data.energy.sum()], [0.0], 0.0
    for _ in range(steps):
        mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)
        energies.append(data.energy.sum())
        kinetic.append(data.energy[1])
        gap = max(gap, float(np.abs(data.efc_pos[: data.ne]).max(initial=0.0)))
    return {
        "cells": cells,
        "step_us": spent[fastest],
        "jacobian": fastest,
        "loop_error_m": gap,
        "energy_error": float(np.abs(np.array(energies) - energies[0]).max() / max(kinetic)),
        "version": mujoco.__version__,
    }


SETTINGS = (("one", "implicitfast"), ("two", "implicitfast"), ("two", "RK4"))


if __name__ == "__main__":
    print("MuJoCo, 3-D scissor, h = 1 ms; energy over the largest kinetic energy")
    for count in (10, 23, 50):
        for closure, integrator in SETTINGS:
            timed = time_mujoco_scissor(count, closure=closure, integrator=integrator)
            print(
                f"{count:>4} cells, {closure} connect a loop, {integrator:12s} {timed['step_us']:6.0f} µs per step "
                f"({timed['jacobian']}), loops open by {timed['loop_error_m']:.1e} m, "
                f"energy off by {timed['energy_error']:.1e}"
            )
