"""Do the loops close: how far the drawing is from it, whether a small motion closes it, and why not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from backend.mechanism.constraints import (
    JointGap,
    Placement,
    body_index,
    drawn,
    jacobian,
    joint_gap,
    residual,
)
from backend.mechanism.joint import Joint
from backend.mechanism.loops import Loop
from backend.mechanism.mechanism import Mechanism

CLOSED_M, CLOSED_RAD = 1e-6, 1e-5  # coordinates written with seven digits are off by less
OPEN_SHARE = 0.05  # of the mechanism's size: a drawing this rough is still assembled
OPEN_RAD = np.radians(5.0)
DAMPING = 1e-10  # keeps redundant rows solvable; far below the square of any useful singular value


@dataclass(frozen=True)
class Assembly:
    """The placement nearest to the drawing in which the joints meet; closed is False when none was found.

    moved_m: the furthest that a body's origin had to shift.
    """

    placement: Placement
    closed: bool
    moved_m: float


def gaps(mechanism: Mechanism, placement: Placement) -> dict[str, JointGap]:
    """Joint id -> its gap at a placement."""
    index = body_index(mechanism)
    return {joint.id: joint_gap(mechanism, joint, placement, index) for joint in mechanism.joints}


def assemble(mechanism: Mechanism, joints: list[Joint], length: float) -> Assembly:
    """Move the bodies as little as needed to close the joints, by damped Gauss-Newton steps."""
    moving = np.array([at for at, body in enumerate(mechanism.bodies) if not body.fixed], int)
    start = placement = drawn(mechanism)
    error = residual(mechanism, joints, placement, length)
    for _ in range(40):
        if not error.size or np.max(np.abs(error)) < 1e-12 or not moving.size:
            break
        matrix = jacobian(mechanism, joints, placement, length)
        normal = matrix.T @ matrix
        normal[np.diag_indices_from(normal)] += DAMPING
        step = -np.linalg.solve(normal, matrix.T @ error).reshape(-1, 6)
        step *= min(1.0, 0.5 / max(np.max(np.abs(step)), 1e-300))  # beyond half a radian the linear picture is off
        step[:, :3] *= length
        for _ in range(12):
            trial = placement.moved(moving, step)
            trial_error = residual(mechanism, joints, trial, length)
            if np.linalg.norm(trial_error) < np.linalg.norm(error):
                break
            step = step / 2
        else:
            break
        placement, error = trial, trial_error
    closed = not error.size or bool(np.max(np.abs(error)) < 1e-9)
    moved = placement.positions - start.positions
    return Assembly(placement, closed, float(np.max(np.linalg.norm(moved, axis=1), initial=0.0)))


def too_long(mechanism: Mechanism, loop: Loop, normal: np.ndarray | None) -> str | None:
    """The sentence about a planar loop of pins in which one body is longer than all others together."""
    joints = [mechanism.joint(id) for id in loop.joints]
    if normal is None or any(joint.type != "revolute" for joint in joints):
        return None
    lengths = {
        body: _spacing(mechanism, joints[at - 1], joints[at], body, normal) for at, body in enumerate(loop.bodies)
    }
    longest = max(lengths, key=lambda body: lengths[body])
    rest = [body for body in loop.bodies if body != longest]
    excess = lengths[longest] - sum(lengths[body] for body in rest)
    if excess <= CLOSED_M:
        return None
    a, b = (joints[loop.bodies.index(longest) - 1].id, joints[loop.bodies.index(longest)].id)
    others = " + ".join(f"{body} {_mm(lengths[body])}" for body in rest)
    return (
        f"Loop {'-'.join(loop.joints)} cannot close: {longest} {_mm(lengths[longest])} mm is longer than "
        f'{others} mm. Shorten "{longest}" by at least {_mm(excess)} mm, or check its pin spacing '
        f'(joint frames "{a}" and "{b}").'
    )


def _mm(metres: float) -> str:
    return f"{metres * 1e3:.6g}"


def _spacing(mechanism: Mechanism, one: Joint, other: Joint, body: str, normal: np.ndarray) -> float:
    """Distance of two pins of a body, in the plane of motion [m]."""
    points = [_pin(mechanism, joint, body) for joint in (one, other)]
    arm = points[0] - points[1]
    return float(np.linalg.norm(arm - normal * (normal @ arm)))


def _pin(mechanism: Mechanism, joint: Joint, body: str) -> np.ndarray:
    """The joint's origin in W as `body` has it drawn; any fixed body stands for the ground."""
    is_a = joint.body_a == body or (joint.body_b != body and mechanism.body(joint.body_a).fixed)
    owner, frame = (joint.body_a, joint.frame_a) if is_a else (joint.body_b, joint.frame_b)
    return mechanism.body(owner).pose.place(frame.position_m)
