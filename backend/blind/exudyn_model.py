"""A drawing as Exudyn's items: nodes, bodies, markers, joints, connectors, loads, sensors."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from backend.blind.contacts import Capsules
from backend.blind.drawing import Drag, Drawing, DrawnJoint, Drive, Push, Strut
from backend.blind.exudyn_contact import Walls, add_capsules, add_pads, add_play
from backend.blind.peer import peer
from backend.blind.poses import Poses, joint_frame, joint_rows, quaternion

STOP_TIME_S = 2e-3  # of a stop's spring with the inertia at its joint; the damper makes it creep, not bounce
STOP_DAMPING = 4.0  # times critical: a body leaves with less than 2% of its speed


class ExudynModel:
    """The drawing, item by item, in an Exudyn system.

    first_rates: joint rates a moment after the start, which tell friction its sign at time 0.
    """

    def __init__(
        self,
        system: Any,
        drawing: Drawing,
        poses: Poses,
        creep: float,
        step_s: float,
        first_rates: Mapping[str, float],
        walls: Walls,
    ):
        self.exudyn, self.items = peer("exudyn"), peer("exudyn.itemInterface")
        self.output = self.exudyn.OutputVariableType
        self.system, self.mbs = system, system.AddSystem()
        self.drawing, self.poses, self.creep = drawing, poses, creep
        self.step_s, self.half = step_s, 0.5 * step_s
        self.first_rates, self.walls = first_rates, walls
        self.bodies: list[Any] = []
        self.nodes: dict[int, Any] = {}
        self.sensors: dict[int, tuple[Any, ...]] = {}
        self.held: dict[str, tuple[DrawnJoint, Any]] = {}

    def everything(self, keep: list[tuple[int, ...]] | None) -> None:
        """All items; `keep` says which rows each joint holds (None: every row)."""
        self.ground = self.mbs.AddObject(self.items.ObjectGround())
        for i in range(len(self.drawing.bodies)):
            self.bodies.append(self._body(i))
        for i, joint in enumerate(self.drawing.joints):
            markers = [
                self.marker(joint.a, joint.p_AF, joint.R_AF),
                self.marker(joint.b, joint.p_BF, joint.R_BF),
            ]
            held = self._hold(joint, markers, None if keep is None else keep[i])
            add_play(self, joint, markers)
            if joint.moves:
                self._effort(joint, markers, held)
        for strut in self.drawing.struts:
            self._strut(strut)
        for push in self.drawing.pushes:
            self._push(push)
        for drag in self.drawing.drags:
            self._drag(drag)
        for pads in self.drawing.pads:
            add_pads(self, pads)
        self._touching(self.drawing.capsules)

    def recorded(self) -> tuple[np.ndarray, Poses]:
        """Times and poses that the sensors stored."""
        first = next(iter(self.sensors.values()))
        time_s = self.mbs.GetSensorStoredData(first[0])[:, 0]
        moved = self.poses.held(len(time_s))
        for i, sensors in self.sensors.items():
            p, R, v, w = (self.mbs.GetSensorStoredData(sensor)[:, 1:] for sensor in sensors)
            moved.p_WB[:, i], moved.R_WB[:, i] = p, R.reshape(-1, 3, 3)
            moved.v_WB[:, i], moved.w_WB_B[:, i] = v, w
        return time_s, moved

    def recorded_forces(self, moved: Poses) -> dict[str, np.ndarray]:
        """Joint -> force of its constraints on body b (T, 3), in W; joints that hold nothing are left out."""
        forces = {}
        for joint, sensor in self.held.values():
            on_b, first = (1.0, (joint.b, joint.p_BF, joint.R_BF)) if joint.type == "universal" else (-1.0, None)
            _, R_WF = joint_frame(moved, *(first or (joint.a, joint.p_AF, joint.R_AF)))
            # Exudyn's multipliers stand on the side of the inertia: they push its second marker backwards.
            along_first = self.mbs.GetSensorStoredData(sensor)[:, 1:]
            forces[joint.id] = on_b * np.einsum("tij,tj->ti", R_WF, along_first)
        return forces

    def _body(self, i: int) -> Any:
        body, poses = self.drawing.bodies[i], self.poses
        if body.fixed:
            return None
        q = quaternion(poses.R_WB[i][None])[0]
        w, x, y, z = q
        # q' = ½ q ∘ (0, ω in body axes)
        q_dot = 0.5 * np.array([[-x, -y, -z], [w, -z, y], [z, w, -x], [-y, x, w]]) @ poses.w_WB_B[i]
        node = self.mbs.AddNode(
            self.items.NodeRigidBodyEP(
                referenceCoordinates=[*poses.p_WB[i], *q], initialVelocities=[*poses.v_WB[i], *q_dot]
            )
        )
        c = body.p_BC
        J = body.inertia + body.mass * (c @ c * np.eye(3) - np.outer(c, c))  # Exudyn's is about the body's origin
        self.nodes[i] = node
        number = self.mbs.AddObject(
            self.items.ObjectRigidBody(
                mass=body.mass,
                inertia=[J[0, 0], J[1, 1], J[2, 2], J[1, 2], J[0, 2], J[0, 1]],
                centerOfMass=body.p_BC,
                nodeNumber=node,
            )
        )
        mass = self.mbs.AddMarker(self.items.MarkerBodyMass(bodyNumber=number))
        self.mbs.AddLoad(self.items.LoadMassProportional(markerNumber=mass, loadVector=self.drawing.gravity))
        self.sensors[i] = self._recording(number)
        return number

    def _recording(self, number: Any, at: np.ndarray | None = None) -> tuple[Any, ...]:
        """Sensors of a body's pose and rates; at: where its origin is in Exudyn's body, if elsewhere."""
        out, at = self.output, np.zeros(3) if at is None else at
        kinds = (out.Position, out.RotationMatrix, out.Velocity, out.AngularVelocityLocal)
        stored = {"storeInternal": True, "writeToFile": False, "localPosition": list(at)}
        return tuple(
            self.mbs.AddSensor(self.items.SensorBody(bodyNumber=number, outputVariableType=kind, **stored))
            for kind in kinds
        )

    def wall(self, what: str, drawn: float, mass: float) -> tuple[float, float]:
        """Stiffness [N/m] and inelastic damper [N s/m] of a wall, its own or what stands for a rigid one."""
        stiffness = self.walls.stiffness(drawn)
        return stiffness, self.walls.damping(drawn, stiffness, mass)

    def marker(self, i: int, p: np.ndarray, R: np.ndarray | None = None) -> Any:
        """A marker at a point (and frame) of a body; the assembled world pose where the body is fixed."""
        R = np.eye(3) if R is None else R
        number = self.bodies[i] if i >= 0 else None
        if number is None:
            number = self.ground
            if i >= 0:
                p, R = self.poses.p_WB[i] + self.poses.R_WB[i] @ p, self.poses.R_WB[i] @ R
        return self.mbs.AddMarker(
            self.items.MarkerBodyRigid(bodyNumber=number, localHT=self.exudyn.HT(rotation=R, translation=p))
        )

    def _hold(self, joint: DrawnJoint, markers: list[Any], rows: tuple[int, ...] | None) -> Any:
        """The joint's constraints, if it has any to hold."""
        held = set(joint.held if rows is None else rows)
        if not held or (self._still(joint.a) and self._still(joint.b)):
            return None
        axes = [int(k in held) for k in range(6)]
        # Exudyn's universal joint keeps x of its first marker across y of its second, ours y of a across x of b.
        pair = markers[::-1] if joint.type == "universal" else markers
        made = self.mbs.AddObject(self.items.ObjectJointGeneric(markerNumbers=pair, constrainedAxes=axes))
        sensor = self.items.SensorObject(
            objectNumber=made, outputVariableType=self.output.ForceLocal, storeInternal=True, writeToFile=False
        )
        self.held[joint.id] = joint, self.mbs.AddSensor(sensor)
        return made

    def _touching(self, pairs: list[Capsules]) -> None:
        for pair in pairs:
            add_capsules(self, pair)

    def _still(self, i: int) -> bool:
        return i < 0 or self.bodies[i] is None

    def _effort(self, joint: DrawnJoint, markers: list[Any], held: Any) -> None:
        """The joint's law as one spring-damper about or along its z."""

        def radial_load(mbs: Any) -> float:
            x, y, _ = mbs.GetObjectOutput(held, self.output.ForceLocal)
            return float(np.hypot(x, y))

        load = radial_load if joint.rub_radius and held is not None else None
        law = _law(joint, self.creep, self.half, self.first_rates.get(joint.id), self._stop_stiffness(joint), load)
        if law is None:
            return
        if joint.turns:
            # The data coordinate lets Exudyn count whole turns.
            turn = float(joint_rows(joint, self.poses)[5])
            count = self.items.NodeGenericData(initialCoordinates=[turn], numberOfDataCoordinates=1)
            node = self.mbs.AddNode(count)
            spring = self.items.ObjectConnectorTorsionalSpringDamper(
                markerNumbers=markers, nodeNumber=node, springTorqueUserFunction=law
            )
        else:
            spring = self.items.ObjectConnectorLinearSpringDamper(
                markerNumbers=markers, axisMarker0=[0, 0, 1], springForceUserFunction=law
            )
        self.mbs.AddObject(spring)

    def _stop_stiffness(self, joint: DrawnJoint) -> tuple[float, float]:
        """Spring and damper of a stop, from the lighter of the two bodies at the joint."""
        inertias = []
        for i, p, R in ((joint.a, joint.p_AF, joint.R_AF), (joint.b, joint.p_BF, joint.R_BF)):
            body = self.drawing.bodies[i]
            if not body.fixed:
                arm = np.cross(R[:, 2], p - body.p_BC)
                turning = R[:, 2] @ body.inertia @ R[:, 2] + body.mass * arm @ arm
                inertias.append(turning if joint.turns else body.mass)
        inertia = min(inertias, default=1.0)
        return inertia / STOP_TIME_S**2, 2.0 * STOP_DAMPING * inertia / STOP_TIME_S

    def _strut(self, strut: Strut) -> None:
        self.mbs.AddObject(
            self.items.ObjectConnectorSpringDamper(
                markerNumbers=[self.marker(strut.a, strut.p_A), self.marker(strut.b, strut.p_B)],
                referenceLength=strut.free_length,
                stiffness=strut.stiffness,
                damping=strut.damping,
            )
        )

    def _push(self, push: Push) -> None:
        """A load on a and its opposite on b; a force's opposite acts at the same point of space."""
        body_b = None if self._still(push.b) else self.bodies[push.b]

        def along(sign: float):
            return lambda mbs, t, load: sign * _across(push.size, t, self.half) * push.direction

        Load = self.items.LoadTorqueVector if push.torque else self.items.LoadForceVector
        for i, sign, p in ((push.a, 1.0, push.p_A), (push.b, -1.0, np.zeros(3))):
            if not self._still(i):
                marker = self.marker(i, p)
                self.mbs.AddLoad(Load(markerNumber=marker, loadVector=[0, 0, 0], loadVectorUserFunction=along(sign)))
        if push.torque or body_b is None:
            return

        def moment(mbs, t, load):
            p_WP = self._point(push.a, push.p_A)
            p_WB = mbs.GetObjectOutputBody(body_b, self.output.Position, [0, 0, 0])
            return -_across(push.size, t, self.half) * np.cross(p_WP - p_WB, push.direction)

        marker = self.marker(push.b, np.zeros(3))
        load = self.items.LoadTorqueVector(markerNumber=marker, loadVector=[0, 0, 0], loadVectorUserFunction=moment)
        self.mbs.AddLoad(load)

    def _point(self, i: int, p: np.ndarray) -> np.ndarray:
        if self._still(i):
            return self.poses.p_WB[i] + self.poses.R_WB[i] @ p
        return np.asarray(self.mbs.GetObjectOutputBody(self.bodies[i], self.output.Position, list(p)))

    def _drag(self, drag: Drag) -> None:
        if self._still(drag.body):
            return

        def force(mbs, t, item, displacement, velocity, stiffness, damping, offset):
            v = np.asarray(velocity)
            return (drag.linear + drag.quadratic * np.linalg.norm(v)) * v

        markers = [
            self.marker(-1, np.zeros(3)),
            self.marker(drag.body, self.drawing.bodies[drag.body].p_BC),
        ]
        damper = self.items.ObjectConnectorCartesianSpringDamper(markerNumbers=markers, springForceUserFunction=force)
        self.mbs.AddObject(damper)


def _across(drive: Drive, time_s: float, half_step_s: float) -> float:
    """A held input where a step ends: the mean of both sides, so that the trapezoid over a jump is exact."""
    return 0.5 * (drive(max(0.0, time_s - half_step_s)) + drive(time_s + half_step_s))


def _law(
    joint: DrawnJoint,
    creep: float,
    half: float,
    first_rate: float | None,
    stop: tuple[float, float],
    radial_load: Callable[[Any], float] | None,
):
    """Resistance against growing q, as Exudyn's connectors ask for it; None where the joint is ideal."""
    bounded = joint.lower > -np.inf or joint.upper < np.inf
    if not (joint.stiffness or joint.damping or joint.friction or joint.drives or bounded or radial_load):
        return None
    stiff, damp = stop

    def resistance(mbs, t, item, q, rate, stiffness, damping, offset):
        effort = joint.stiffness * q - joint.preload - _across(joint.drive, t, half) + joint.damping * rate
        rub = joint.friction + (joint.rub_radius * radial_load(mbs) if radial_load else 0.0)
        if rub:
            slip = first_rate if t <= 0.0 and first_rate is not None else rate
            effort += rub * slip / (slip * slip + creep * creep) ** 0.5
        if bounded:
            over, under = q - joint.upper, joint.lower - q
            if over > 0.0:
                effort += max(0.0, stiff * over + damp * rate)
            elif under > 0.0:
                effort -= max(0.0, stiff * under - damp * rate)
        return effort

    return resistance
