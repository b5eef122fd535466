"""The twin beside its copy in MuJoCo: how far they part, and how well the copy's loops hold.

`python -m benchmarks.twin` prints the tables of docs/twin.md.
"""

import time
from typing import NamedTuple

import mujoco
import numpy as np

from backend.export.gather import gather
from backend.export.mjcf import mjcf
from backend.export.urdf import urdf
from backend.mechanism.mechanism import Mechanism
from backend.simulate.run import Run, simulate
from tests.mechanisms import bennett, double_pendulum, effect, fourbar, scissor, slider_crank, spatial_fourbar

DURATION_S, SEEN_S = 0.5, 0.01


class Copy(NamedTuple):
    """What MuJoCo made of a file, sampled; places by body."""

    time_s: np.ndarray
    place_m: dict[str, np.ndarray]
    attitude: dict[str, np.ndarray]
    """Body to world (T, 3, 3)."""
    q: dict[str, np.ndarray]
    """Joints that MuJoCo has a coordinate for [rad or m]."""
    open_m: float
    """Largest distance that any equality was open."""
    energy_lost: float
    """Largest change of the total energy, over the largest kinetic one."""
    wall_s: float


def main() -> None:
    """Print what parts twin and copy, then how that depends on the copy's step and stiffness."""
    print("| mechanism, 0.5 s from rest | equalities | apart by 0.1 s | largest, over size | turned, rad | open, m |")
    print("|---|---|---|---|---|---|")
    cases = linkages()
    runs = {name: simulate(mechanism, DURATION_S, 1e-4) for name, mechanism in cases.items()}
    for name, mechanism in cases.items():
        twin = gather(mechanism)
        text = mjcf(twin).text
        copy = follow(text, DURATION_S)
        far, turned = apart(runs[name], copy)
        print(
            f"| {name} | {text.count('<connect')} connect, {text.count('<weld')} weld | {far[:11].max():.1e} m | "
            f"{far.max() / twin.size:.1e} | {turned.max():.1e} | {copy.open_m:.1e} |"
        )
    print()
    print("| step, ms | integrator | time constant, steps | four-bar apart / size | loops open, m | energy lost | s |")
    print("|---|---|---|---|---|---|---|")
    twin, run = gather(cases["four-bar"]), runs["four-bar"]
    for step_s in (1e-3, 5e-4, 2.5e-4, 1e-4):
        for integrator in ("RK4", "implicitfast"):
            for steps in (2.0, 4.0, 8.0):
                copy = follow(mjcf(twin, step_s, steps).text, DURATION_S, integrator)
                far, _ = apart(run, copy)
                print(
                    f"| {1e3 * step_s:g} | {integrator} | {steps:g} | {far.max() / twin.size:.1e} | "
                    f"{copy.open_m:.1e} | {copy.energy_lost:.1e} | {copy.wall_s:.2f} |"
                )
    print()
    print("| as URDF, loaded by MuJoCo | largest, over size | turned apart, rad |")
    print("|---|---|---|")
    tree = cases["double pendulum"]
    copy = follow_urdf(tree, DURATION_S)
    far, turned = apart(runs["double pendulum"], copy)
    print(f"| double pendulum | {far.max() / gather(tree).size:.1e} | {turned.max():.1e} |")


def linkages() -> dict[str, Mechanism]:
    """Trees and loops, bare and with everything along their joints that both engines know."""
    grease = effect("grease", "viscous_friction", "all", damping_n_m_s_per_rad=1e-3)
    seals = effect("seals", "coulomb_friction", "all", friction_torque_n_m=2e-3)
    return {
        "double pendulum": double_pendulum(),
        "four-bar": fourbar(),
        "four-bar, grease and seals": fourbar([grease, seals]),
        "slider-crank": slider_crank(),
        "scissor, 3 cells": scissor(3),
        "scissor, 3 cells, grease and seals": scissor(3, [grease, seals]),
        "Bennett": bennett(),
        "spatial four-bar (RSSR)": spatial_fourbar(),
    }


def follow(text: str, duration_s: float, integrator: str = "RK4") -> Copy:
    """Let MuJoCo move a document of ours."""
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    return _followed(model, mujoco.MjData(model), duration_s)


def follow_urdf(mechanism: Mechanism, duration_s: float, step_s: float = 2.5e-4) -> Copy:
    """Let MuJoCo move the URDF, with what URDF cannot say (gravity, the start) set by hand."""
    twin = gather(mechanism)
    model = mujoco.MjModel.from_xml_string(urdf(twin).text)
    model.opt.gravity, model.opt.timestep = twin.gravity, step_s
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    data = mujoco.MjData(model)
    for joint in twin.joints:
        native = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, joint.id)
        if native >= 0:
            data.qpos[model.jnt_qposadr[native]] = joint.q
    return _followed(model, data, duration_s)


def _followed(model: mujoco.MjModel, data: mujoco.MjData, duration_s: float) -> Copy:
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    every, count = round(SEEN_S / model.opt.timestep), round(duration_s / SEEN_S) + 1
    names = {model.body(i).name: i for i in range(1, model.nbody)}
    scalar = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    joints = {model.joint(i).name: model.jnt_qposadr[i] for i in range(model.njnt) if model.jnt_type[i] in scalar}
    place = {name: np.zeros((count, 3)) for name in names}
    turned = {name: np.zeros((count, 3, 3)) for name in names}
    q = {name: np.zeros(count) for name in joints}
    energy, opened, started = np.zeros((count, 2)), 0.0, time.perf_counter()
    for n in range(count):
        if n:
            mujoco.mj_step(model, data, nstep=every)
        mujoco.mj_forward(model, data)  # poses lag the coordinates by a step
        for name, i in names.items():
            place[name][n], turned[name][n] = data.xpos[i], data.xmat[i].reshape(3, 3)
        for name, at in joints.items():
            q[name][n] = data.qpos[at]
        energy[n] = data.energy
        held = data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
        opened = max(opened, float(np.abs(data.efc_pos[held]).max(initial=0.0)))
    total = energy.sum(1)
    lost = float(np.ptp(total) / max(energy[:, 1].max(), 1e-300))
    return Copy(np.arange(count) * SEEN_S, place, turned, q, opened, lost, time.perf_counter() - started)


def apart(run: Run, copy: Copy) -> tuple[np.ndarray, np.ndarray]:
    """Largest distance [m] and angle [rad] between any body and its copy, at each sample."""
    nodes = np.round(copy.time_s / run.step_s).astype(int)
    far, turned = [], []
    for body, place in run.position_m.items():
        far.append(np.linalg.norm(copy.place_m[body] - place[nodes], axis=1))
        w, *v = run.quaternion_wxyz[body][nodes].T
        v = np.stack(v, 1)
        # x and y of the body in W, by R e = e + 2 v x (v x e + w e)
        axes = [e + 2 * np.cross(v, np.cross(v, e) + w[:, None] * e) for e in np.eye(3)]
        sines = [np.linalg.norm(np.cross(axes[k], copy.attitude[body][:, :, k]), axis=1) for k in range(3)]
        turned.append(np.max(sines, axis=0))
    return np.max(far, axis=0), np.max(turned, axis=0)


if __name__ == "__main__":
    main()
