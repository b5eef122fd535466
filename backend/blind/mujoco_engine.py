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

from backend.blind.closure import assemble, roots, set_in_motion, spanning_tree
from backend.blind.drawn import BODY_KINDS, JOINT_KINDS, Drawing, DrawnJoint, read_drawing
from backend.blind.peer import peer
from backend.blind.poses import (
    COORDINATE,
    PeerMotion,
    Poses,
    joint_rates,
    joint_rows,
    peer_motion,
    quaternion,
    size_m,
)

KINDS = frozenset((*JOINT_KINDS, *BODY_KINDS, "rotor_inertia"))
STOP_DAMPING = 4.0  # times critical: MuJoCo's stops give back 14% of the speed at 1
IMPEDANCE = 0.9999  # MuJoCo's largest; its default of 0.9 to 0.95 loses most of a loop's energy


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
) -> PeerMotion:
    """The mechanism's motion for `duration_s` from its drawn pose, at rest unless rates are given.

    mechanism: a Mechanism or its JSON document.  step_s: integrator step [s]; output_step_s: samples [s], a
    multiple of it.  inputs: columns time_s, effect, parameter, value (zero-order hold).
    integrator: "RK4", "implicitfast" or "Euler".  weld_time_s: how fast a weld pulls an error back
    (solref's first number), four steps if not given.
    Raises ValueError for an effect or joint it cannot imitate, RuntimeError when the motion is not finite.
    """
    mujoco = peer("mujoco")
    drawing = read_drawing(mechanism, inputs, engine="MuJoCo", kinds=KINDS)
    start = assemble(drawing, initial_joint_positions)
    set_in_motion(drawing, start, initial_joint_velocities)
    solref = (weld_time_s or 4.0 * step_s, 1.0)
    spec = _spec(drawing, start, solref)
    spec.option.timestep = step_s
    spec.option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    model = spec.compile()
    data = mujoco.MjData(model)
    _set_rates(drawing, start, model, data)
    every = max(1, round((output_step_s or step_s) / step_s))
    samples = round(duration_s / (every * step_s)) + 1
    poses = _record(drawing, start, model, data, samples, every)
    if not np.isfinite(poses.p_WB).all() or data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number:
        raise RuntimeError(f"MuJoCo's motion is not finite at a step of {step_s} s; halve the step")
    time_s = np.arange(samples) * every * step_s
    return peer_motion("MuJoCo", mujoco.__version__, step_s, drawing, time_s, poses)


def _spec(drawing: Drawing, start: Poses, solref: tuple[float, float]) -> Any:
    """The mechanism as MuJoCo sees it, at its start pose."""
    mujoco = peer("mujoco")
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.compiler.balanceinertia = False
    spec.option.gravity = drawing.gravity
    spec.option.tolerance = 1e-14
    spec.option.iterations = 200
    made: dict[int, Any] = {}
    for i, body in enumerate(drawing.bodies):
        if body.fixed:
            made[i] = _body(spec.worldbody, None, start, i, f"body:{i}")
    tree = spanning_tree(drawing)
    closing = _cuts(drawing, {k for k, _, _ in tree})
    shares = {i: 1.0 / (1 + sum(child == i for _, _, child in closing)) for i in drawing.moving}
    for i in roots(drawing):
        made[i] = _body(spec.worldbody, None, start, i, f"body:{i}")
        made[i].add_freejoint(name=f"free:{i}")
        _give_mass(made[i], drawing, i, shares[i])
    made |= _grow(drawing, start, made, tree, shares, solref)
    for k, parent, child in closing:
        half = _body(made[parent], parent, start, child, f"half:{k}")
        _give_mass(half, drawing, child, shares[child])
        _joint(half, drawing.joints[k], child, start, solref, k)
        weld = spec.add_equality(type=mujoco.mjtEq.mjEQ_WELD, objtype=mujoco.mjtObj.mjOBJ_BODY)
        weld.name1, weld.name2 = f"body:{child}", f"half:{k}"
        # Zeros ask for the relative pose of the start; the eleventh number weighs an angle as a length.
        weld.data = np.where(np.arange(len(weld.data)) == 10, size_m(drawing), 0.0)
        weld.solref, weld.solimp = solref, (IMPEDANCE, IMPEDANCE, 1e-3, 0.5, 2.0)
    for n, strut in enumerate(drawing.struts):
        tendon = spec.add_tendon(name=f"strut:{n}", stiffness=[strut.stiffness, 0, 0], damping=[strut.damping, 0, 0])
        tendon.springlength = [strut.free_length, strut.free_length]
        for end, i, p in (("a", strut.a, strut.p_A), ("b", strut.b, strut.p_B)):
            (made[i] if i >= 0 else spec.worldbody).add_site(name=f"strut:{n}{end}", pos=p)
            tendon.wrap_site(f"strut:{n}{end}")
    return spec


def _grow(drawing: Drawing, start: Poses, made: dict, tree: list, shares: dict, solref: tuple) -> dict[int, Any]:
    """Bodies that hang, joint by joint, on those made so far."""
    grown = dict(made)
    for k, parent, child in tree:
        if parent in grown and child not in grown:
            grown[child] = _body(grown[parent], parent, start, child, f"body:{child}")
            _give_mass(grown[child], drawing, child, shares[child])
            _joint(grown[child], drawing.joints[k], child, start, solref, k)
    return grown


def _cuts(drawing: Drawing, tree: set[int]) -> list[tuple[int, int, int]]:
    """Joints outside the tree: (joint, body that carries it, body that is cut in halves)."""
    cuts = []
    for k, joint in enumerate(drawing.joints):
        fixed_a, fixed_b = drawing.bodies[joint.a].fixed, drawing.bodies[joint.b].fixed
        if k not in tree and not (fixed_a and fixed_b):
            cuts.append((k, joint.b, joint.a) if fixed_b else (k, joint.a, joint.b))
    return cuts


def _body(parent: Any, parent_index: int | None, start: Poses, i: int, name: str) -> Any:
    p, R = start.p_WB[i], start.R_WB[i]
    if parent_index is not None:
        R_WP = start.R_WB[parent_index]
        p, R = R_WP.T @ (p - start.p_WB[parent_index]), R_WP.T @ R
    return parent.add_body(name=name, pos=p, quat=quaternion(R[None])[0])


def _give_mass(made: Any, drawing: Drawing, i: int, share: float) -> None:
    body = drawing.bodies[i]
    J = share * body.inertia
    made.explicitinertial = True
    made.mass, made.ipos = share * body.mass, body.p_BC
    made.fullinertia = [J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2]]


def _joint(made: Any, joint: DrawnJoint, child: int, start: Poses, solref: tuple, k: int) -> None:
    """A native joint whose coordinate is q less its value at the start."""
    mujoco = peer("mujoco")
    if not joint.moves:
        return
    q = float(joint_rows(joint, start)[COORDINATE[joint.type]])
    # MuJoCo turns the child against its parent: a child that is body_a needs the axis the other way round.
    p, axis = (joint.p_BF, joint.R_BF[:, 2]) if child == joint.b else (joint.p_AF, -joint.R_AF[:, 2])
    kind = mujoco.mjtJoint.mjJNT_HINGE if joint.turns else mujoco.mjtJoint.mjJNT_SLIDE
    native = made.add_joint(name=f"joint:{k}", type=kind, pos=p, axis=axis)
    native.damping = [joint.damping, 0, 0]
    native.frictionloss = joint.friction
    native.armature = joint.inertia
    native.solref_friction = solref
    native.solref_limit = (solref[0], STOP_DAMPING)
    native.solimp_friction = native.solimp_limit = (IMPEDANCE, IMPEDANCE, 1e-3, 0.5, 2.0)
    if joint.stiffness:
        native.stiffness = [joint.stiffness, 0, 0]
        native.springref = joint.preload / joint.stiffness - q
    if joint.lower > -np.inf or joint.upper < np.inf:
        native.limited = mujoco.mjtLimited.mjLIMITED_TRUE
        native.range = [max(joint.lower - q, -1e3), min(joint.upper - q, 1e3)]


def _set_rates(drawing: Drawing, start: Poses, model: Any, data: Any) -> None:
    for k, joint in enumerate(drawing.joints):
        if (dof := _dof(model, k)) is not None:
            data.qvel[dof] = joint_rates(joint, start)[COORDINATE[joint.type]]


def _dof(model: Any, k: int) -> int | None:
    mujoco = peer("mujoco")
    native = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, f"joint:{k}")
    return int(model.jnt_dofadr[native]) if native >= 0 else None


def _record(drawing: Drawing, start: Poses, model: Any, data: Any, samples: int, every: int) -> Poses:
    """Step and sample.  MuJoCo's poses lag its coordinates by a step, so kinematics run before a sample."""
    mujoco = peer("mujoco")
    poses = start.held(samples)
    ids = {i: mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, f"body:{i}") for i in drawing.moving}
    loads = _Loads(drawing, start, model, ids)
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


class _Loads:
    """What MuJoCo has no native element for: drives, pushes, drags."""

    def __init__(self, drawing: Drawing, start: Poses, model: Any, ids: Mapping[int, int]):
        self.drawing, self.start, self.model, self.ids = drawing, start, model, ids
        self.driven = [(joint, _dof(model, k)) for k, joint in enumerate(drawing.joints) if joint.drives]
        # A preload without stiffness does not occur: both come from torsion springs.
        self.now = 0.0
        self.silent = not (self.driven or drawing.pushes or drawing.drags)

    def advance(self, data: Any, steps: int) -> None:
        """Step; drives hold their value over a step, and forces follow the motion at each of its stages."""
        mujoco = peer("mujoco")
        if self.silent:
            mujoco.mj_step(self.model, data, nstep=steps)
            return
        mujoco.set_mjcb_passive(self._apply)
        try:
            for _ in range(steps):
                self.now = data.time
                mujoco.mj_step(self.model, data)
        finally:
            mujoco.set_mjcb_passive(None)

    def _apply(self, model: Any, data: Any) -> None:
        """MuJoCo asks for passive forces with kinematics and velocities at hand."""
        mujoco = peer("mujoco")
        for joint, dof in self.driven:
            if dof is not None:
                data.qfrc_passive[dof] += joint.drive(self.now)
        for push in self.drawing.pushes:
            load = push.size(self.now) * push.direction
            force, torque = (np.zeros(3), load) if push.torque else (load, np.zeros(3))
            point = self._point(data, push.a, push.p_A)
            self._add(data, push.a, force, torque, point)
            self._add(data, push.b, -force, -torque, point)
        for drag in self.drawing.drags:
            if drag.body in self.ids:
                twist, id = np.zeros(6), self.ids[drag.body]
                mujoco.mj_objectVelocity(self.model, data, mujoco.mjtObj.mjOBJ_BODY, id, twist, 0)
                v = twist[3:]  # mjOBJ_BODY is centred at the centre of mass
                force = -(drag.linear + drag.quadratic * float(np.linalg.norm(v))) * v
                self._add(data, drag.body, force, np.zeros(3), data.xipos[id])

    def _point(self, data: Any, i: int, p: np.ndarray) -> np.ndarray:
        if i not in self.ids:
            return self.start.p_WB[i] + self.start.R_WB[i] @ p
        id = self.ids[i]
        return data.xpos[id] + data.xmat[id].reshape(3, 3) @ p

    def _add(self, data: Any, i: int, force: np.ndarray, torque: np.ndarray, point: np.ndarray) -> None:
        mujoco = peer("mujoco")
        if i in self.ids:
            mujoco.mj_applyFT(self.model, data, force, torque, point, self.ids[i], data.qfrc_passive)
