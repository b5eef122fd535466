"""Cost of a step with and without the compiled kernel, beside MuJoCo in the same run.

python -m benchmarks.kernel               # 10 to 400 cells, some minutes
python -m benchmarks.kernel --cells 23
"""

import argparse
import os
import time

import equinox as eqx
import jax
import numpy as np

from backend.mechanism.effect import Effect
from backend.model.build import build
from backend.model.system import system
from backend.simulate.invariants import constraint_error, kinetic_energy, potential_energy
from backend.simulate.kernel import call
from benchmarks.dynamics import STEPS, let_go, median_s
from benchmarks.mujoco_scissor import SETTINGS, time_mujoco_scissor
from benchmarks.scissor import scissor

LARGEST_LOOSE = 50  # cells
LARGEST_MUJOCO = 100  # cells; its cost a step then already outgrows the wait


def loose_pins(cells: int) -> list[Effect]:
    """A millimetre of play at every pin."""
    pins = [joint.id for joint in scissor(cells).joints if joint.type == "revolute"]
    return [Effect(id="play", kind="clearance", on=pins, parameters={"radial_m": 1e-3})]


def ours(cells: int, switch: str, loose: bool = False) -> dict[str, float]:
    """µs per step of processor time, seconds of compilation, and the largest opening of a joint [m]."""
    os.environ[call.SWITCH] = switch
    jax.clear_caches()
    model = build(scissor(cells), loose_pins(cells) if loose else ())
    begin = time.perf_counter()
    compiled = eqx.filter_jit(let_go).lower(model).compile()
    compile_s = time.perf_counter() - begin
    path = compiled(model)
    if bool(path.lost.any()):
        raise RuntimeError(f"{cells} cells, kernel {switch}: a step was lost")
    plant = system(model)
    kinetic = np.asarray(kinetic_energy(plant, path))[:-1]  # the last node's velocity has one side only
    energy = kinetic + np.asarray(potential_energy(plant, path))[:-1]
    return {
        "newton": float(path.iterations.mean()),
        "us": median_s(compiled, model) / (STEPS + 1) * 1e6,
        "compile": compile_s,
        "drift": float(constraint_error(plant, path).max()),
        "energy": float(np.abs(energy - energy[0]).max() / kinetic.max()),
    }


def main(cells: list[int]) -> None:
    """One line a size; MuJoCo's settings as `connects per loop, integrator`."""
    print("µs per step of h = 1 ms, rigid 3-D scissor, one core; drift: largest opening of a joint [m]")
    for count in cells:
        off = ours(count, "off")
        on = ours(count, "on") if built() else None
        line = f"{count:>4} cells  {told('JAX', off)}"
        print(line + (f"  {told('kernel', on)}" if on else ""), flush=True)
        loose = {}
        if count <= LARGEST_LOOSE:
            loose = {name: ours(count, switch, True) for name, switch in (("JAX", "off"), ("kernel", "on"))}
            print(
                "            1 mm at every pin: " + "  ".join(told(name, of) for name, of in loose.items()), flush=True
            )
        for closure, integrator in SETTINGS if count <= LARGEST_MUJOCO else ():
            peer = time_mujoco_scissor(count, closure=closure, integrator=integrator)
            ratios = f"kernel {on['us'] / peer['step_us']:.2f}x, " if on else ""
            print(
                f"            MuJoCo {closure}, {integrator:12s} {peer['step_us']:6.0f} ({peer['loop_error_m']:.0e} m, "
                f"energy {peer['energy_error']:.0e}): {ratios}JAX {off['us'] / peer['step_us']:.2f}x"
                + "".join(f", loose {name} {of['us'] / peer['step_us']:.2f}x" for name, of in loose.items()),
                flush=True,
            )


def told(name: str, of: dict[str, float]) -> str:
    """One way's figures."""
    held = f"{of['drift']:.0e} m, energy {of['energy']:.0e}, compile {of['compile']:.1f} s, Newton {of['newton']:.1f}"
    return f"{name} {of['us']:6.0f} ({held})"


def built() -> bool:
    """Whether the kernel can be had here."""
    os.environ[call.SWITCH] = "on"
    return call.available()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cells", type=int, nargs="*", default=[10, 23, 50, 100, 200, 400])
    arguments = parser.parse_args()
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})  # the figures are for one core
    main(arguments.cells)
