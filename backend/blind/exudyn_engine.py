"""Exudyn as an independent peer: generalised-α, implicit, every body a full 3-D pose with Euler parameters.

J. Gerstmayr, "Exudyn", Multibody System Dynamics (2023).  The integrator is Arnold and Brüls (2007).
Rows that repeat others (3 of Bennett's 20, three for each closed cell of a scissor) are left out beforehand; the
motion does not notice, and constraint_error_m reports all rows, the ones left out included.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from backend.blind.closure import assemble, independent_rows, set_in_motion
from backend.blind.drawn import BODY_KINDS, JOINT_KINDS, Drag, Drawing, DrawnJoint, Push, Strut, read_drawing
from backend.blind.poses import MET, PeerMotion, Poses, joint_rows, peer_motion, quaternion

KINDS = frozenset((*JOINT_KINDS, *BODY_KINDS))
CREEP = 1e-4  # rad/s or m/s: friction's sign(v) is v / sqrt(v² + CREEP²)
STOP_TIME_S = 2e-3  # a stop's spring turns a rigid body of the joint's inertia back in about this time


def simulate_exudyn(
    mechanism: Any,
    duration_s: float,
    step_s: float = 5e-4,
    *,
    output_step_s: float | None = None,
    initial_joint_velocities: Mapping[str, float] | None = None,
    initial_joint_positions: Mapping[str, float] | None = None,
    inputs: Any = None,
    extrapolated: bool = False,
    redundant_rows: str = "left out",
    spectral_radius: float = 0.9,
    friction_creep: float = CREEP,
) -> PeerMotion:
    """The mechanism's motion for `duration_s` from its drawn pose, at rest unless rates are given.

    mechanism: a Mechanism or its JSON document.  step_s: integrator step [s]; output_step_s: samples [s], a
    multiple of it.  inputs: columns time_s, effect, parameter, value (zero-order hold).
    redundant_rows: "left out", or "ignored" (all rows, least-norm reactions by a full-pivot solve: 10x slower).
    extrapolated: run at step_s and half of it, and cancel the error's h²: for smooth motions only.
    friction_creep: rate at which Coulomb friction is 71% mobilised [rad/s or m/s].
    Raises ValueError for an effect or joint it cannot imitate, RuntimeError when the integrator gives up.
    """
    import exudyn

    drawing = read_drawing(mechanism, inputs, engine="Exudyn", kinds=KINDS)
    start = assemble(drawing, initial_joint_positions)
    set_in_motion(drawing, start, initial_joint_velocities)
    keep = independent_rows(drawing, start) if redundant_rows == "left out" else None
    every = output_step_s or step_s

    def solved(step: float) -> tuple[np.ndarray, Poses]:
        build = _Build(exudyn.SystemContainer(), drawing, start, friction_creep)
        build.everything(keep)
        settings = _settings(duration_s, step, every, spectral_radius, every_row=keep is None)
        try:
            build.mbs.Assemble()
            build.mbs.SolveDynamic(settings)
        except exudyn.ExudynError as error:
            raise RuntimeError(
                f"Exudyn stopped before {duration_s} s at a step of {step} s; halve the step, raise friction_creep, "
                "or look for a dead centre on the way"
            ) from error
        return build.recorded()

    time_s, poses = solved(step_s)
    if extrapolated:
        poses = _extrapolated(poses, solved(0.5 * step_s)[1])
    return peer_motion("Exudyn", str(exudyn.__version__), step_s, drawing, time_s, poses)


def _settings(duration_s: float, step_s: float, every_s: float, spectral_radius: float, every_row: bool) -> Any:
    import exudyn

    settings = exudyn.SimulationSettings()
    integrator = settings.timeIntegration
    integrator.endTime = duration_s
    integrator.numberOfSteps = max(1, round(duration_s / step_s))
    integrator.generalizedAlpha.spectralRadius = spectral_radius
    integrator.newton.useModifiedNewton = False
    integrator.newton.relativeTolerance = 1e-10
    integrator.newton.absoluteTolerance = 1e-12
    integrator.verboseMode = 0
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = every_s * (1 - 1e-9)
    settings.linearSolver.solverType = exudyn.LinearSolverType.EigenSparse
    if every_row:
        settings.linearSolver.solverType = exudyn.LinearSolverType.EigenDense
        settings.linearSolver.ignoreSingularJacobian = True
    return settings


def _extrapolated(coarse: Poses, fine: Poses) -> Poses:
    """(4 fine - coarse) / 3: the error's h² term cancels (Richardson 1911); rotations made orthonormal again."""
    p, R, v, w = (
        (4.0 * f - c) / 3.0
        for c, f in (
            (coarse.p_WB, fine.p_WB),
            (coarse.R_WB, fine.R_WB),
            (coarse.v_WB, fine.v_WB),
            (coarse.w_WB_B, fine.w_WB_B),
        )
    )
    U, _, Vt = np.linalg.svd(R)
    return Poses(p, U @ Vt, v, w)


class _Build:
    """The drawing, item by item, in an Exudyn system."""

    def __init__(self, system: Any, drawing: Drawing, poses: Poses, creep: float):
        self.system, self.mbs = system, system.AddSystem()
        self.drawing, self.poses, self.creep = drawing, poses, creep
        self.bodies: list[Any] = []
        self.sensors: dict[int, tuple[Any, ...]] = {}

    def everything(self, keep: list[tuple[int, ...]] | None) -> None:
        """All items; `keep` says which rows each joint holds (None: every row)."""
        from exudyn.itemInterface import ObjectGround

        self.ground = self.mbs.AddObject(ObjectGround())
        for i in range(len(self.drawing.bodies)):
            self.bodies.append(self._body(i))
        for i, joint in enumerate(self.drawing.joints):
            markers = [self._marker(joint.a, joint.p_AF, joint.R_AF), self._marker(joint.b, joint.p_BF, joint.R_BF)]
            self._hold(joint, markers, None if keep is None else keep[i])
            if joint.moves:
                self._effort(joint, markers)
        for strut in self.drawing.struts:
            self._strut(strut)
        for push in self.drawing.pushes:
            self._push(push)
        for drag in self.drawing.drags:
            self._drag(drag)

    def recorded(self) -> tuple[np.ndarray, Poses]:
        """Times and poses that the sensors stored."""
        n, first = len(self.bodies), next(iter(self.sensors.values()))
        time_s = self.mbs.GetSensorStoredData(first[0])[:, 0]
        still, count = self.poses, len(time_s)
        moved = Poses(
            *(np.broadcast_to(a, (count, *a.shape)).copy() for a in (still.p_WB, still.R_WB)),
            np.zeros((count, n, 3)),
            np.zeros((count, n, 3)),
        )
        for i, sensors in self.sensors.items():
            p, R, v, w = (self.mbs.GetSensorStoredData(sensor)[:, 1:] for sensor in sensors)
            moved.p_WB[:, i], moved.R_WB[:, i] = p, R.reshape(-1, 3, 3)
            moved.v_WB[:, i], moved.w_WB_B[:, i] = v, w
        return time_s, moved

    def _body(self, i: int) -> Any:
        from exudyn import OutputVariableType as Output
        from exudyn.itemInterface import LoadMassProportional, MarkerBodyMass, NodeRigidBodyEP, ObjectRigidBody
        from exudyn.itemInterface import SensorBody

        body, poses = self.drawing.bodies[i], self.poses
        if body.fixed:
            return None
        q = quaternion(poses.R_WB[i][None])[0]
        w, x, y, z = q
        # q' = ½ q ∘ (0, ω in body axes)
        q_dot = 0.5 * np.array([[-x, -y, -z], [w, -z, y], [z, w, -x], [-y, x, w]]) @ poses.w_WB_B[i]
        node = self.mbs.AddNode(
            NodeRigidBodyEP(
                referenceCoordinates=[*poses.p_WB[i], *q], initialVelocities=[*poses.v_WB[i], *q_dot]
            )
        )
        about_origin = body.inertia + body.mass * (body.p_BC @ body.p_BC * np.eye(3) - np.outer(body.p_BC, body.p_BC))
        J = about_origin
        number = self.mbs.AddObject(
            ObjectRigidBody(
                mass=body.mass,
                inertia=[J[0, 0], J[1, 1], J[2, 2], J[1, 2], J[0, 2], J[0, 1]],
                centerOfMass=body.p_BC,
                nodeNumber=node,
            )
        )
        mass = self.mbs.AddMarker(MarkerBodyMass(bodyNumber=number))
        self.mbs.AddLoad(LoadMassProportional(markerNumber=mass, loadVector=self.drawing.gravity))
        kinds = (Output.Position, Output.RotationMatrix, Output.Velocity, Output.AngularVelocityLocal)
        self.sensors[i] = tuple(
            self.mbs.AddSensor(
                SensorBody(bodyNumber=number, outputVariableType=kind, storeInternal=True, writeToFile=False)
            )
            for kind in kinds
        )
        return number

    def _marker(self, i: int, p: np.ndarray, R: np.ndarray | None = None) -> Any:
        """A marker at a point (and frame) of a body; the assembled world pose where the body is fixed."""
        import exudyn
        from exudyn.itemInterface import MarkerBodyRigid

        R = np.eye(3) if R is None else R
        number = self.bodies[i] if i >= 0 else None
        if number is None:
            number = self.ground
            if i >= 0:
                p, R = self.poses.p_WB[i] + self.poses.R_WB[i] @ p, self.poses.R_WB[i] @ R
        return self.mbs.AddMarker(
            MarkerBodyRigid(bodyNumber=number, localHT=exudyn.HT(rotation=R, translation=p))
        )

    def _hold(self, joint: DrawnJoint, markers: list[Any], rows: tuple[int, ...] | None) -> None:
        from exudyn.itemInterface import ObjectJointGeneric

        held = set(MET[joint.type] if rows is None else rows)
        if held and not (self._still(joint.a) and self._still(joint.b)):
            self.mbs.AddObject(
                ObjectJointGeneric(markerNumbers=markers, constrainedAxes=[int(k in held) for k in range(6)])
            )

    def _still(self, i: int) -> bool:
        return i < 0 or self.bodies[i] is None

    def _effort(self, joint: DrawnJoint, markers: list[Any]) -> None:
        """The joint's law as one spring-damper about or along its z."""
        from exudyn.itemInterface import NodeGenericData, ObjectConnectorLinearSpringDamper
        from exudyn.itemInterface import ObjectConnectorTorsionalSpringDamper

        law = _law(joint, self.creep, self._stop_stiffness(joint))
        if law is None:
            return
        if joint.turns:
            # The data coordinate lets Exudyn count whole turns.
            turn = float(joint_rows(joint, self.poses)[5])
            node = self.mbs.AddNode(NodeGenericData(initialCoordinates=[turn], numberOfDataCoordinates=1))
            spring = ObjectConnectorTorsionalSpringDamper(
                markerNumbers=markers, nodeNumber=node, springTorqueUserFunction=law
            )
        else:
            spring = ObjectConnectorLinearSpringDamper(
                markerNumbers=markers, axisMarker0=[0, 0, 1], springForceUserFunction=law
            )
        self.mbs.AddObject(spring)

    def _stop_stiffness(self, joint: DrawnJoint) -> tuple[float, float]:
        """Spring and critical damper of a stop, from the lighter of the two bodies at the joint."""
        inertias = []
        for i, p, R in ((joint.a, joint.p_AF, joint.R_AF), (joint.b, joint.p_BF, joint.R_BF)):
            body = self.drawing.bodies[i]
            if not body.fixed:
                arm = np.cross(R[:, 2], p - body.p_BC)
                turning = R[:, 2] @ body.inertia @ R[:, 2] + body.mass * arm @ arm
                inertias.append(turning if joint.turns else body.mass)
        inertia = min(inertias, default=1.0)
        return inertia / STOP_TIME_S**2, 2.0 * inertia / STOP_TIME_S

    def _strut(self, strut: Strut) -> None:
        from exudyn.itemInterface import ObjectConnectorSpringDamper

        self.mbs.AddObject(
            ObjectConnectorSpringDamper(
                markerNumbers=[self._marker(strut.a, strut.p_A), self._marker(strut.b, strut.p_B)],
                referenceLength=strut.free_length,
                stiffness=strut.stiffness,
                damping=strut.damping,
            )
        )

    def _push(self, push: Push) -> None:
        """A load on a and its opposite on b; a force's opposite acts at the same point of space."""
        from exudyn import OutputVariableType as Output
        from exudyn.itemInterface import LoadForceVector, LoadTorqueVector

        def along(sign: float):
            return lambda mbs, t, load: sign * push.size(t) * push.direction

        Load = LoadTorqueVector if push.torque else LoadForceVector
        for i, sign, p in ((push.a, 1.0, push.p_A), (push.b, -1.0, np.zeros(3))):
            if not self._still(i):
                marker = self._marker(i, p)
                self.mbs.AddLoad(Load(markerNumber=marker, loadVector=[0, 0, 0], loadVectorUserFunction=along(sign)))
        if push.torque or self._still(push.b):
            return

        def moment(mbs, t, load):
            p_WP = self._point(push.a, push.p_A)
            p_WB = mbs.GetObjectOutputBody(self.bodies[push.b], Output.Position, [0, 0, 0])
            return -push.size(t) * np.cross(p_WP - p_WB, push.direction)

        marker = self._marker(push.b, np.zeros(3))
        self.mbs.AddLoad(
            LoadTorqueVector(markerNumber=marker, loadVector=[0, 0, 0], loadVectorUserFunction=moment)
        )

    def _point(self, i: int, p: np.ndarray) -> np.ndarray:
        from exudyn import OutputVariableType as Output

        if self._still(i):
            return self.poses.p_WB[i] + self.poses.R_WB[i] @ p
        return np.asarray(self.mbs.GetObjectOutputBody(self.bodies[i], Output.Position, list(p)))

    def _drag(self, drag: Drag) -> None:
        from exudyn.itemInterface import ObjectConnectorCartesianSpringDamper

        if self._still(drag.body):
            return

        def force(mbs, t, item, displacement, velocity, stiffness, damping, offset):
            v = np.asarray(velocity)
            return (drag.linear + drag.quadratic * np.linalg.norm(v)) * v

        markers = [self._marker(-1, np.zeros(3)), self._marker(drag.body, self.drawing.bodies[drag.body].p_BC)]
        self.mbs.AddObject(
            ObjectConnectorCartesianSpringDamper(markerNumbers=markers, springForceUserFunction=force)
        )


def _law(joint: DrawnJoint, creep: float, stop: tuple[float, float]):
    """Resistance against growing q, as Exudyn's connectors ask for it; None where the joint is ideal."""
    bounded = joint.lower > -np.inf or joint.upper < np.inf
    if not (joint.stiffness or joint.damping or joint.friction or joint.drives or bounded):
        return None
    stiff, damp = stop

    def resistance(mbs, t, item, q, rate, stiffness, damping, offset):
        effort = joint.stiffness * q - joint.preload - joint.drive(t) + joint.damping * rate
        if joint.friction:
            effort += joint.friction * rate / (rate * rate + creep * creep) ** 0.5
        if bounded:
            over, under = q - joint.upper, joint.lower - q
            if over > 0.0:
                effort += max(0.0, stiff * over + damp * rate)
            elif under > 0.0:
                effort -= max(0.0, stiff * under - damp * rate)
        return effort

    return resistance
