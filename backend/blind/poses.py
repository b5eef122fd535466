"""Rotations in plain numpy, and the motion that a peer engine hands back."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from backend.blind.drawing import Drawing, DrawnJoint


@dataclass(frozen=True)
class PeerMotion:
    """What an engine nobody here wrote says the mechanism does; T samples, SI, names as in run.h5.

    position_m, quaternion_wxyz, velocity_m_per_s: body -> (T, 3), (T, 4), (T, 3), of the body's frame in W.
    angular_velocity_rad_per_s: body -> (T, 3), body axes.
    joint_positions, joint_velocities: joint -> (T,), frame_b against frame_a about or along z; unwrapped.
    marker_position_m: marker -> (T, 3) in W.
    kinetic_j, potential_j: (T,), from the poses and velocities; potential of gravity and of springs.
    constraint_error_m: (T,), the largest row of any joint that is not met; angles times the mechanism's size.  A
    loose pin's play is no error.
    joint_force_n: joint -> (T, 3), what its constraints put on body_b, in W; empty where the engine does not tell.
    """

    engine: str
    version: str
    step_s: float
    time_s: np.ndarray
    position_m: dict[str, np.ndarray]
    quaternion_wxyz: dict[str, np.ndarray]
    velocity_m_per_s: dict[str, np.ndarray]
    angular_velocity_rad_per_s: dict[str, np.ndarray]
    joint_positions: dict[str, np.ndarray]
    joint_velocities: dict[str, np.ndarray]
    marker_position_m: dict[str, np.ndarray]
    kinetic_j: np.ndarray
    potential_j: np.ndarray
    constraint_error_m: np.ndarray
    joint_force_n: dict[str, np.ndarray] = field(default_factory=dict)


@dataclass
class Poses:
    """Where all bodies are and how they move, indexed as in the drawing; any leading axes (T or none).

    p_WB, v_WB (..., n, 3) in W; R_WB (..., n, 3, 3); w_WB_B (..., n, 3) in body axes.
    """

    p_WB: np.ndarray
    R_WB: np.ndarray
    v_WB: np.ndarray
    w_WB_B: np.ndarray

    def held(self, samples: int) -> Poses:
        """These poses `samples` times over, at rest, to be written into."""
        p, R = (np.broadcast_to(a, (samples, *a.shape)).copy() for a in (self.p_WB, self.R_WB))
        return Poses(p, R, np.zeros_like(p), np.zeros_like(p))


def rotation_matrix(quaternion_wxyz: np.ndarray) -> np.ndarray:
    """(..., 3, 3) from (..., 4); the quaternion is normalised first."""
    q = np.asarray(quaternion_wxyz, float)
    w, x, y, z = np.moveaxis(q / np.linalg.norm(q, axis=-1, keepdims=True), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a x b of two vectors of three; numpy's own, made for whole arrays, takes ten times as long in a step."""
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def quaternion(R: np.ndarray) -> np.ndarray:
    """(T, 4) from (T, 3, 3), sign continuous in T (Shepperd 1978: divide by the largest component)."""
    diagonal = np.einsum("tii->ti", R)
    squares = np.concatenate([[R.trace(axis1=1, axis2=2)], 2 * diagonal.T - diagonal.sum(1)]).T + 1  # 4 q_i²
    off = {(2, 1): 1, (0, 2): 2, (1, 0): 3}
    table = np.zeros((len(R), 4, 4))
    table[:, range(4), range(4)] = squares
    for (i, j), k in off.items():
        table[:, 0, k] = table[:, k, 0] = R[:, i, j] - R[:, j, i]
        m, n = {3: (1, 2), 1: (2, 3), 2: (3, 1)}[k]
        table[:, m, n] = table[:, n, m] = R[:, i, j] + R[:, j, i]
    q = table[np.arange(len(R)), squares.argmax(1)]
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    if q[0, 0] < 0:
        q[0] = -q[0]
    turned = np.cumprod(np.sign(np.einsum("ti,ti->t", q[1:], q[:-1])))
    q[1:] *= turned[:, None]
    return q


def cross_matrix(v: np.ndarray) -> np.ndarray:
    """[v]× with [v]× u = v x u."""
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rotation_by(vector: np.ndarray) -> np.ndarray:
    """The rotation by |vector| about it (Rodrigues)."""
    angle = np.linalg.norm(vector)
    K = cross_matrix(vector)
    return np.eye(3) + np.sinc(angle / np.pi) * K + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * (K @ K)


def joint_frame(poses: Poses, body: int, p_BF: np.ndarray, R_BF: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """p_WF (..., 3) and R_WF (..., 3, 3) of a frame drawn in a body."""
    R_WB = poses.R_WB[..., body, :, :]
    return poses.p_WB[..., body, :] + R_WB @ p_BF, R_WB @ R_BF


def joint_rows(joint: DrawnJoint, poses: Poses) -> np.ndarray:
    """(..., 6): offset of frame_b in frame_a [m], its two tilts, and its turn about z in (-π, π] [rad].

    A universal joint's last row is the cosine of the angle between y of frame_a and x of frame_b.
    """
    p_WA, R_WA = joint_frame(poses, joint.a, joint.p_AF, joint.R_AF)
    p_WB, R_WB = joint_frame(poses, joint.b, joint.p_BF, joint.R_BF)
    R_AB = np.swapaxes(R_WA, -1, -2) @ R_WB
    offset = np.einsum("...ji,...j->...i", R_WA, p_WB - p_WA)
    turn = np.arctan2(R_AB[..., 1, 0] - R_AB[..., 0, 1], R_AB[..., 0, 0] + R_AB[..., 1, 1])
    if joint.type == "universal":
        turn = R_AB[..., 1, 0]
    return np.concatenate([offset, np.stack([-R_AB[..., 1, 2], R_AB[..., 0, 2], turn], -1)], -1)


def joint_rates(joint: DrawnJoint, poses: Poses) -> np.ndarray:
    """(..., 6): velocity of frame_b's origin along frame_a [m/s], and relative angular velocity [rad/s]."""
    _, R_WA = joint_frame(poses, joint.a, joint.p_AF, joint.R_AF)
    p_WB, _ = joint_frame(poses, joint.b, joint.p_BF, joint.R_BF)
    spin = (poses.R_WB @ poses.w_WB_B[..., None])[..., 0]
    w_a, w_b = spin[..., joint.a, :], spin[..., joint.b, :]
    v_a = poses.v_WB[..., joint.a, :] + np.cross(w_a, p_WB - poses.p_WB[..., joint.a, :])
    v_b = poses.v_WB[..., joint.b, :] + np.cross(w_b, p_WB - poses.p_WB[..., joint.b, :])
    both = np.concatenate([v_b - v_a, w_b - w_a], -1)
    return np.concatenate([np.einsum("...ji,...j->...i", R_WA, part) for part in np.split(both, 2, -1)], -1)


MET = {
    "revolute": (0, 1, 2, 3, 4),
    "prismatic": (0, 1, 3, 4, 5),
    "fixed": (0, 1, 2, 3, 4, 5),
    "spherical": (0, 1, 2),
    "cylindrical": (0, 1, 3, 4),
    "planar": (2, 3, 4),
    "universal": (0, 1, 2, 5),
}
COORDINATE = {"revolute": 5, "prismatic": 2, "cylindrical": 5, "planar": 5}
LOOSE = (2, 3, 4)  # what a pin in a wider hole still holds: the offset along the axis, and both tilts


def size_m(drawing: Drawing) -> float:
    """A length of the mechanism, to weigh radians against metres: the widest spread of joints and masses."""
    points = [body.p_WB + body.R_WB @ body.p_BC for body in drawing.bodies if not body.fixed]
    points += [drawing.bodies[j.a].p_WB + drawing.bodies[j.a].R_WB @ j.p_AF for j in drawing.joints]
    span = np.ptp(np.array(points), axis=0).max() if points else 0.0
    return float(span) or 1.0


def _unwrapped(turn: np.ndarray, rate: np.ndarray, time_s: np.ndarray) -> np.ndarray:
    """Whole turns added, with the rate deciding, so that even half a turn per sample is followed."""
    expected = np.diff(time_s) * 0.5 * (rate[1:] + rate[:-1])
    jumps = np.round((expected - np.diff(turn)) / (2 * np.pi))
    return turn + 2 * np.pi * np.concatenate([[0.0], np.cumsum(jumps)])


def peer_motion(
    engine: str, version: str, step_s: float, drawing: Drawing, time_s: np.ndarray, poses: Poses
) -> PeerMotion:
    """Everything that follows from the poses, computed alike for each engine."""
    q, qd, error, scale = {}, {}, np.zeros(len(time_s)), size_m(drawing)
    for joint in drawing.joints:
        rows, rates = joint_rows(joint, poses), joint_rates(joint, poses)
        met = rows[:, joint.held] * np.where(np.array(joint.held) > 2, scale, 1.0)
        error = np.maximum(error, np.abs(met).max(1))
        if joint.moves:
            k = COORDINATE[joint.type]
            q[joint.id] = _unwrapped(rows[:, k], rates[:, k], time_s) if joint.turns else rows[:, k]
            qd[joint.id] = rates[:, k]
    kinetic, potential = energies(drawing, poses, q)
    per_body = {body.id: i for i, body in enumerate(drawing.bodies)}
    return PeerMotion(
        engine=engine,
        version=version,
        step_s=step_s,
        time_s=time_s,
        position_m={id: poses.p_WB[:, i] for id, i in per_body.items()},
        quaternion_wxyz={id: quaternion(poses.R_WB[:, i]) for id, i in per_body.items()},
        velocity_m_per_s={id: poses.v_WB[:, i] for id, i in per_body.items()},
        angular_velocity_rad_per_s={id: poses.w_WB_B[:, i] for id, i in per_body.items()},
        joint_positions=q,
        joint_velocities=qd,
        marker_position_m={id: poses.p_WB[:, i] + poses.R_WB[:, i] @ p_BM for id, i, p_BM in drawing.markers},
        kinetic_j=kinetic,
        potential_j=potential,
        constraint_error_m=error,
    )


def energies(drawing: Drawing, poses: Poses, q: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Kinetic and potential energy (T,) [J]; the latter of gravity, struts and torsion springs."""
    kinetic, potential = np.zeros(len(poses.p_WB)), np.zeros(len(poses.p_WB))
    for i in drawing.moving:
        body, R, w = drawing.bodies[i], poses.R_WB[:, i], poses.w_WB_B[:, i]
        v_WC = poses.v_WB[:, i] + (R @ np.cross(w, body.p_BC)[..., None])[..., 0]
        kinetic += 0.5 * body.mass * (v_WC**2).sum(1) + 0.5 * np.einsum("ti,ij,tj->t", w, body.inertia, w)
        potential -= body.mass * (poses.p_WB[:, i] + R @ body.p_BC) @ drawing.gravity
    for strut in drawing.struts:
        ends = [poses.p_WB[:, i] + poses.R_WB[:, i] @ p for i, p in ((strut.a, strut.p_A), (strut.b, strut.p_B))]
        length = np.linalg.norm(ends[1] - ends[0], axis=1)
        potential += 0.5 * strut.stiffness * (length - strut.free_length) ** 2
    for joint in drawing.joints:
        if joint.stiffness:
            potential += 0.5 * joint.stiffness * (q[joint.id] - joint.preload / joint.stiffness) ** 2
        if joint.inertia:
            kinetic += 0.5 * joint.inertia * joint_rates(joint, poses)[:, COORDINATE[joint.type]] ** 2
    return kinetic, potential
