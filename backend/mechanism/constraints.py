"""The rows that a joint takes away: its gaps at a pose, and their derivative.

A joint compares frame_b with frame_a, in the axes of frame_a. The gap is the position of frame_b's origin,
the turn is the rotation vector from frame_a to frame_b; each type holds some of their components at zero.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from backend.mechanism.joint import Joint
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.pose import Frame

# type -> components of the gap, and of the turn, that are held (0, 1, 2 are x, y, z of frame_a)
HELD: dict[str, tuple[tuple[int, ...], tuple[int, ...]]] = {
    "revolute": ((0, 1, 2), (0, 1)),
    "fixed": ((0, 1, 2), (0, 1, 2)),
    "prismatic": ((0, 1), (0, 1, 2)),
    "cylindrical": ((0, 1), (0, 1)),
    "spherical": ((0, 1, 2), ()),
    "planar": ((2,), (0, 1)),
    "universal": ((0, 1, 2), (2,)),  # the third turn is how far y of frame_a and x of frame_b are from square
}


def rows(joint: Joint) -> int:
    """How many of the six relative freedoms the joint takes away."""
    gap, turn = HELD[joint.type]
    return len(gap) + len(turn)


@dataclass(frozen=True)
class Placement:
    """Poses X_WB of all bodies, in drawn order: positions (n, 3) [m] and rotations (n, 3, 3)."""

    positions: np.ndarray
    rotations: np.ndarray

    def moved(self, moving: np.ndarray, step: np.ndarray) -> Placement:
        """Shift and turn (world axes) the bodies at index `moving` by the rows of `step` (m, 6) [m, rad]."""
        positions, rotations = self.positions.copy(), self.rotations.copy()
        positions[moving] += step[:, :3]
        for body, turn in zip(moving, step[:, 3:], strict=True):
            # Orthonormal again: rounding would otherwise pile up over the steps.
            u, _, vt = np.linalg.svd(rotation(turn) @ rotations[body])
            rotations[body] = u @ vt
        return Placement(positions, rotations)


def drawn(mechanism: Mechanism) -> Placement:
    """The poses as drawn."""
    return Placement(
        np.array([body.pose.position_m for body in mechanism.bodies], float),
        np.array([body.pose.rotation() for body in mechanism.bodies]),
    )


def rotation(vector: np.ndarray) -> np.ndarray:
    """Rotation matrix of a rotation vector [rad] (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    x, y, z = vector
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    half = np.sinc(angle / (2 * np.pi))
    return np.eye(3) + np.sinc(angle / np.pi) * cross + 0.5 * half * half * cross @ cross


def rotation_vector(matrix: np.ndarray) -> np.ndarray:
    """Rotation vector [rad] of a rotation matrix; half a turn has two, and gets one of them."""
    twice_sine = np.array([matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1]])
    sine, cosine = 0.5 * float(np.linalg.norm(twice_sine)), 0.5 * (float(np.trace(matrix)) - 1.0)
    angle = float(np.arctan2(sine, cosine))
    if cosine > 0.0 or sine > 1e-6:
        return twice_sine * (0.5 / np.sinc(angle / np.pi))
    axes = 0.5 * (matrix + np.eye(3))  # n nᵀ at half a turn
    axis = axes[:, int(np.argmax(np.diag(axes)))]
    return angle * axis / np.linalg.norm(axis)


def _tilt(matrix: np.ndarray) -> np.ndarray:
    """The smallest rotation vector that turns frame_a's z into frame_b's."""
    x, y, z = matrix[:, 2]
    sine = float(np.hypot(x, y))
    if sine == 0.0:
        return np.array([0.0 if z > 0 else np.pi, 0.0, 0.0])
    return float(np.arctan2(sine, z)) / sine * np.array([-y, x, 0.0])


@dataclass(frozen=True)
class JointGap:
    """How far a joint is from being met: gap [m] and turn [rad] in axes of frame_a, free components zeroed.

    q: its position, rotation about z [rad] or, for `prismatic`, translation along z [m]; it means nothing for
    types without a coordinate.
    """

    gap: np.ndarray
    turn: np.ndarray
    q: float


def joint_gap(mechanism: Mechanism, joint: Joint, placement: Placement, index: dict[str, int]) -> JointGap:
    """The gap of one joint at a placement of the bodies."""
    p_Wa, R_Wa = _frame(joint.body_a, joint.frame_a, placement, index)
    p_Wb, R_Wb = _frame(joint.body_b, joint.frame_b, placement, index)
    gap = R_Wa.T @ (p_Wb - p_Wa)
    relative = R_Wa.T @ R_Wb
    held_gap, held_turn = HELD[joint.type]
    q = gap[2] if joint.type == "prismatic" else np.arctan2(relative[1, 0], relative[0, 0])
    if joint.type == "universal":
        turn = np.array([0.0, 0.0, np.arcsin(np.clip(relative[1, 0], -1.0, 1.0))])
    else:
        turn = rotation_vector(relative) if len(held_turn) == 3 else _tilt(relative)
    masked_gap, masked_turn = np.zeros(3), np.zeros(3)
    masked_gap[list(held_gap)] = gap[list(held_gap)]
    masked_turn[list(held_turn)] = turn[list(held_turn)]
    return JointGap(masked_gap, masked_turn, float(q))


def _frame(body: str, frame: Frame, placement: Placement, index: dict[str, int]) -> tuple[np.ndarray, np.ndarray]:
    R_WB = placement.rotations[index[body]]
    return placement.positions[index[body]] + R_WB @ np.array(frame.position_m), R_WB @ frame.rotation()


def residual(mechanism: Mechanism, joints: list[Joint], placement: Placement, length: float) -> np.ndarray:
    """All held components of all joints, (rows,): gaps divided by `length`, turns in rad."""
    index = body_index(mechanism)
    parts = []
    for joint in joints:
        found = joint_gap(mechanism, joint, placement, index)
        held_gap, held_turn = HELD[joint.type]
        parts += [found.gap[list(held_gap)] / length, found.turn[list(held_turn)]]
    return np.concatenate(parts) if parts else np.zeros(0)


def jacobian(mechanism: Mechanism, joints: list[Joint], placement: Placement, length: float) -> np.ndarray:
    """Derivative of `residual`, (rows, 6 x moving bodies), by shifts [length] and turns [rad] in world axes.

    Exact where the turns are zero. Shifts and gaps are measured in `length`, so that the singular values of
    a small and of a large copy of a mechanism agree.
    """
    index = body_index(mechanism)
    column = {index[body.id]: 6 * at for at, body in enumerate(mechanism.moving_bodies())}
    matrix = np.zeros((sum(rows(joint) for joint in joints), 6 * len(column)))
    row = 0
    for joint in joints:
        a, b = index[joint.body_a], index[joint.body_b]
        _, R_Wa = _frame(joint.body_a, joint.frame_a, placement, index)
        p_Wb, R_Wb = _frame(joint.body_b, joint.frame_b, placement, index)
        held_gap, held_turn = HELD[joint.type]
        for body, sign in ((a, -1.0), (b, 1.0)):
            if body not in column:
                continue
            arm = (p_Wb - placement.positions[body]) / length
            block = np.zeros((6, 6))
            block[:3, :3] = R_Wa.T
            block[:3, 3:] = R_Wa.T @ np.array([[0, arm[2], -arm[1]], [-arm[2], 0, arm[0]], [arm[1], -arm[0], 0]])
            block[3:, 3:] = R_Wa.T
            if joint.type == "universal":
                block[5, 3:] = np.cross(
                    R_Wb[:, 0], R_Wa[:, 1]
                )  # square axes part by the turn about their common normal
            held = [*held_gap, *(3 + axis for axis in held_turn)]
            at = column[body]
            matrix[row : row + len(held), at : at + 6] = sign * block[held]
        row += rows(joint)
    return matrix


def body_index(mechanism: Mechanism) -> dict[str, int]:
    """Body id -> its place in the drawing."""
    return {body.id: at for at, body in enumerate(mechanism.bodies)}


def size_m(mechanism: Mechanism) -> float:
    """Diagonal of the box around all joints and centres of mass as drawn; 1 where that is a point [m]."""
    placement, index = drawn(mechanism), body_index(mechanism)
    points = [
        _frame(body, frame, placement, index)[0]
        for joint in mechanism.joints
        for body, frame in ((joint.body_a, joint.frame_a), (joint.body_b, joint.frame_b))
    ]
    points += [
        placement.positions[index[body.id]]
        + placement.rotations[index[body.id]] @ np.array(body.inertial.center_of_mass_m)
        for body in mechanism.moving_bodies()
        if body.inertial is not None
    ]
    if not points:
        return 1.0
    return float(np.linalg.norm(np.ptp(np.array(points), axis=0))) or 1.0
