"""MuJoCo as an independent peer: joint coordinates on a spanning tree, loops closed by stiff welds.

E. Todorov, T. Erez, Y. Tassa, "MuJoCo: a physics engine for model-based control", IROS 2012.
A loop is cut through a BODY, not through a joint: the body's mass is shared among its halves, which a weld
holds together.  So every joint, the closing ones too, is a native MuJoCo joint with its own coordinate,
friction and stops.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from backend.blind.closure import assemble, set_in_motion
from backend.blind.drawing import Drawing
from backend.blind.drawn import BODY_KINDS, JOINT_KINDS, read_drawing
from backend.blind.mujoco_loads import Loads
from backend.blind.mujoco_model import Wall, mujoco_spec
from backend.blind.peer import peer
from backend.blind.poses import PeerMotion, Poses, peer_motion

KINDS = frozenset((*JOINT_KINDS, *BODY_KINDS, "rotor_inertia"))


def simulate_mujoco(
    mechanism: Any,
    duration_s: float,
    step_s: float = 1e-4,
    *,
    output_step_s: float | None = None,
    initial_joint_velocities: Mapping[str, float] | None = None,
    initial_joint_positions: Mapping[str, float] | None = None,
    inputs: Any = None,
    integrator: str = "RK4",
    weld_time_s: float | None = None,
    wall_rate_per_s: float | None = None,
) -> PeerMotion:
    """The mechanism's motion for `duration_s` from its drawn pose, at rest unless rates are given.

    mechanism: a Mechanism or its JSON document.  step_s: integrator step [s]; output_step_s: samples [s], a
    multiple of it.  inputs: columns time_s, effect, parameter, value (zero-order hold).
    integrator: "RK4", "implicitfast" or "Euler".  weld_time_s: how fast a weld pulls an error back
    (solref's first number), four steps if not given.  wall_rate_per_s: of the oscillator that stands for a rigid wall,
    1 / (6 steps) if not given; contact wants steps of 0.02 ms or less.
    Raises ValueError for an effect or joint it cannot imitate, RuntimeError when the motion is not finite.
    """
    mujoco = peer("mujoco")
    drawing = read_drawing(mechanism, inputs, engine="MuJoCo", kinds=KINDS)
    start = assemble(drawing, initial_joint_positions)
    set_in_motion(drawing, start, initial_joint_velocities)
    solref = (weld_time_s or 4.0 * step_s, 1.0)
    _refuse(drawing)
    bare = any(joint.rub_radius for joint in drawing.joints)
    spec = mujoco_spec(drawing, start, solref, Wall(wall_rate_per_s or 1.0 / (6.0 * step_s)), bare)
    spec.option.timestep = step_s
    spec.option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    model = spec.compile()
    data = mujoco.MjData(model)
    _set_rates(drawing, start, model, data)
    every = max(1, round((output_step_s or step_s) / step_s))
    samples = round(duration_s / (every * step_s)) + 1
    poses = _record(drawing, start, model, data, samples, every, bare)
    if not np.isfinite(poses.p_WB).all() or data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number:
        raise RuntimeError(f"MuJoCo's motion is not finite at a step of {step_s} s; halve the step")
    time_s = np.arange(samples) * every * step_s
    return peer_motion("MuJoCo", mujoco.__version__, step_s, drawing, time_s, poses)


def _refuse(drawing: Drawing) -> None:
    """ValueError for what MuJoCo's constraints cannot say."""
    for joint in drawing.joints:
        play = joint.play
        if play is None or np.isfinite(play.stiffness):
            continue
        if play.friction:
            raise ValueError(
                f'joint "{joint.id}": MuJoCo has no clearance with friction_coefficient on a rigid wall here; '
                "give it a stiffness_n_per_m, or ask Exudyn"
            )
        if any(other.rub_radius for other in drawing.joints):
            raise ValueError(
                f'joint "{joint.id}": MuJoCo has no pin_friction beside clearance with a rigid wall here; '
                "give the clearance a stiffness_n_per_m, or ask Exudyn"
            )
    for pair in drawing.capsules:
        if np.isfinite(pair.stiffness):
            raise ValueError(
                f'effect "{pair.id}": MuJoCo has no link_contact with stiffness_n_per_m here; remove it, or ask Exudyn'
            )


def _set_rates(drawing: Drawing, start: Poses, model: Any, data: Any) -> None:
    """Coordinate rates that move every body, and every half of one, as the start says."""
    mujoco = peer("mujoco")
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    J, twist = [], []
    for id in range(1, model.nbody):
        i = _body_index(drawing, model, id)
        if i in drawing.moving:
            linear, angular = np.zeros((3, model.nv)), np.zeros((3, model.nv))
            mujoco.mj_jac(model, data, linear, angular, data.xpos[id], id)
            J += [linear, angular]
            twist += [start.v_WB[i], start.R_WB[i] @ start.w_WB_B[i]]
    if J and np.abs(twist).max() > 0.0:
        data.qvel[:] = np.linalg.lstsq(np.concatenate(J), np.concatenate(twist), rcond=None)[0]


def _body_index(drawing: Drawing, model: Any, id: int) -> int:
    """The drawn body that a MuJoCo body (body:i) or half body (half:joint:i) stands for."""
    return int(model.body(id).name.split(":")[-1])


def _record(drawing: Drawing, start: Poses, model: Any, data: Any, samples: int, every: int, bare: bool) -> Poses:
    """Step and sample.  MuJoCo's poses lag its coordinates by a step, so kinematics run before a sample."""
    mujoco = peer("mujoco")
    poses = start.held(samples)
    ids = {i: mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, f"body:{i}") for i in drawing.moving}
    loads = Loads(drawing, start, model, ids, model.opt.timestep, bare)
    twist = np.zeros(6)
    for t in range(samples):
        if t:
            loads.advance(data, every)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        for i, id in ids.items():
            poses.p_WB[t, i], poses.R_WB[t, i] = data.xpos[id], data.xmat[id].reshape(3, 3)
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, id, twist, 0)
            poses.w_WB_B[t, i], poses.v_WB[t, i] = poses.R_WB[t, i].T @ twist[:3], twist[3:]
    return poses
