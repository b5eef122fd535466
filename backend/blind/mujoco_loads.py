"""What MuJoCo has no native element for: drives, pushes, drags, pads on the bed, a soft wall's losses, pin friction."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from backend.blind.contacts import DEAD, DEAD_BLOW, Pads, hunt_crossley, pair_mass
from backend.blind.drawing import Drawing, DrawnJoint, Strut
from backend.blind.peer import peer
from backend.blind.poses import Poses, cross

CREEP = 1e-5  # m/s: below it a pad's friction is proportional to speed, where the step lets it
SLOWEST_BLOW = 1e-2  # m/s: slower ones on a soft wall bounce less than they should


class Loads:
    """Forces that follow the motion at each stage of a step; drives and pin friction hold over a step."""

    def __init__(self, drawing: Drawing, start: Poses, model: Any, ids: Mapping[int, int], step_s: float, bare: bool):
        self.drawing, self.start, self.model, self.ids, self.step_s = drawing, start, model, ids, step_s
        joints = list(enumerate(drawing.joints))
        self.driven = [(joint, _dof(model, k)) for k, joint in joints if joint.drives]
        self.rubbing = [(joint, _dof(model, k)) for k, joint in joints if joint.rub_radius]
        # A preload without stiffness does not occur: both come from torsion springs.
        self.struts = drawing.struts if bare else []
        self.walls = [
            _SoftWall(drawing, joint, *(model.site(f"{end}:{k}").id for end in ENDS))
            for k, joint in joints
            if joint.play and np.isfinite(joint.play.stiffness)
        ]
        self.now = 0.0
        acting = (self.driven, drawing.pushes, drawing.drags, drawing.pads, self.walls, self.struts)
        self.silent = not (any(acting) or self.rubbing)

    def advance(self, data: Any, steps: int) -> None:
        """Step."""
        mujoco = peer("mujoco")
        if self.silent:
            mujoco.mj_step(self.model, data, nstep=steps)
            return
        mujoco.set_mjcb_passive(self._apply)
        try:
            for _ in range(steps):
                self.now = data.time
                if self.rubbing:
                    self._rub(data)
                mujoco.mj_step(self.model, data)
        finally:
            mujoco.set_mjcb_passive(None)

    def _rub(self, data: Any) -> None:
        """Pin friction of the coming step, from the reactions of the last."""
        mujoco = peer("mujoco")
        if data.time == 0.0:
            mujoco.mj_forward(self.model, data)
        mujoco.mj_rnePostConstraint(self.model, data)
        for joint, dof in self.rubbing:
            if dof is not None:
                native = self.model.dof_jntid[dof]
                force, axis = data.cfrc_int[self.model.jnt_bodyid[native], 3:], data.xaxis[native]
                load = float(np.linalg.norm(force - (force @ axis) * axis))
                self.model.dof_frictionloss[dof] = joint.friction + joint.rub_radius * load

    def _apply(self, model: Any, data: Any) -> None:
        """MuJoCo asks for passive forces with kinematics and velocities at hand."""
        for joint, dof in self.driven:
            if dof is not None:
                data.qfrc_passive[dof] += joint.drive(self.now)
        data.xfrc_applied[:] = 0.0
        for push in self.drawing.pushes:
            load = push.size(self.now) * push.direction
            if push.torque:
                self._add(data, push.a, np.zeros(3), None, load)
                self._add(data, push.b, np.zeros(3), None, -load)
            else:
                point = self._point(data, push.a, push.p_A)
                self._add(data, push.a, load, point)
                self._add(data, push.b, -load, point)
        for drag in self.drawing.drags:
            if drag.body in self.ids:
                point = data.xipos[self.ids[drag.body]]
                v = self._velocity(data, drag.body, point)
                self._add(data, drag.body, -(drag.linear + drag.quadratic * float(np.linalg.norm(v))) * v, point)
        for strut in self.struts:
            self._pull(data, strut)
        for pads in self.drawing.pads:
            self._brake(data, pads)
        for wall in self.walls:
            self._lose(data, wall)

    def _pull(self, data: Any, strut: Strut) -> None:
        p_a, p_b = self._point(data, strut.a, strut.p_A), self._point(data, strut.b, strut.p_B)
        length = float(np.linalg.norm(p_b - p_a))
        n = (p_b - p_a) / length
        rate = float((self._velocity(data, strut.b, p_b) - self._velocity(data, strut.a, p_a)) @ n)
        force = (strut.stiffness * (length - strut.free_length) + strut.damping * rate) * n
        self._add(data, strut.a, force, p_a)
        self._add(data, strut.b, -force, p_b)

    def _brake(self, data: Any, pads: Pads) -> None:
        # An explicit step carries no steeper friction than this.
        creep = max(CREEP, 2.0 * pads.force * self.step_s / self.drawing.bodies[pads.body].mass)
        for p in pads.points:
            point = self._point(data, pads.body, p)
            v = self._velocity(data, pads.body, point)
            v = v - (v @ pads.normal) * pads.normal
            self._add(data, pads.body, -pads.force * v / np.sqrt(v @ v + creep**2), point)

    def _lose(self, data: Any, wall: _SoftWall) -> None:
        """The dissipative part of a soft wall's push on the pin (its spring is a tendon), and its friction."""
        play, (a, b) = wall.play, (wall.joint.a, wall.joint.b)
        offset = data.site_xpos[wall.pin] - data.site_xpos[wall.hole]
        distance = float(np.linalg.norm(offset))
        depth = distance - play.radial
        n = offset / max(distance, 1e-300)
        middle = data.site_xpos[wall.pin]
        approach = float((self._velocity(data, b, middle) - self._velocity(data, a, middle)) @ n)
        if depth <= 0.0:
            wall.blow = max(approach, SLOWEST_BLOW)
            return
        spring = play.stiffness * depth
        loss = wall.damping * approach if play.restitution < DEAD else spring * wall.c * approach / wall.blow
        loss = max(loss, -spring)  # a wall does not pull
        point = middle + (wall.joint.pin_radius - 0.5 * depth) * n
        slip = self._velocity(data, b, point) - self._velocity(data, a, point)
        slip = slip - (slip @ n) * n
        rub = play.friction * (spring + loss)
        creep = max(CREEP, 2.0 * rub * self.step_s / wall.mass)
        force = -loss * n - rub * slip / np.sqrt(slip @ slip + creep**2)
        self._add(data, b, force, point)
        self._add(data, a, -force, point)

    def _point(self, data: Any, i: int, p: np.ndarray) -> np.ndarray:
        if i not in self.ids:
            return self.start.p_WB[i] + self.start.R_WB[i] @ p
        id = self.ids[i]
        return data.xpos[id] + data.xmat[id].reshape(3, 3) @ p

    def _velocity(self, data: Any, i: int, point: np.ndarray) -> np.ndarray:
        if i not in self.ids:
            return np.zeros(3)
        mujoco, twist, id = peer("mujoco"), np.zeros(6), self.ids[i]
        mujoco.mj_objectVelocity(self.model, data, mujoco.mjtObj.mjOBJ_BODY, id, twist, 0)
        return twist[3:] + cross(twist[:3], point - data.xipos[id])  # mjOBJ_BODY is centred at the centre of mass

    def _add(
        self, data: Any, i: int, force: np.ndarray, point: np.ndarray | None, torque: np.ndarray | None = None
    ) -> None:
        if i in self.ids:
            id = self.ids[i]
            data.xfrc_applied[id, :3] += force
            if point is not None:
                data.xfrc_applied[id, 3:] += cross(point - data.xipos[id], force)
            if torque is not None:
                data.xfrc_applied[id, 3:] += torque


ENDS = ("hole", "pin")


class _SoftWall:
    """A loose pin whose wall has a stiffness: its losses, and the speed of the blow it takes."""

    def __init__(self, drawing: Drawing, joint: DrawnJoint, hole: int, pin: int):
        if joint.play is None:
            raise ValueError(f'joint "{joint.id}" is not loose; only loose pins have walls')
        self.joint, self.play, self.hole, self.pin, self.blow = joint, joint.play, hole, pin, SLOWEST_BLOW
        ends = ((joint.a, joint.p_AF, joint.R_AF), (joint.b, joint.p_BF, joint.R_BF))
        self.mass = pair_mass([(drawing.bodies[i], p, R[:, 2]) for i, p, R in ends])
        self.damping = 2.0 * DEAD_BLOW * float(np.sqrt(self.play.stiffness * self.mass))
        self.c = hunt_crossley(max(self.play.restitution, DEAD))


def _dof(model: Any, k: int) -> int | None:
    mujoco = peer("mujoco")
    native = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, f"joint:{k}")
    return int(model.jnt_dofadr[native]) if native >= 0 else None
