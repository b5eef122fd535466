"""Where joints hold a body, and the direction in which it is long."""

import numpy as np

from backend.mechanism.mechanism import Mechanism

Points = list[tuple[np.ndarray, np.ndarray]]
"""Points where a body is held, each with the joint's axis, in body axes."""


def joint_points(mechanism: Mechanism) -> dict[str, Points]:
    """Where joints hold each body, and along which axis, in body axes."""
    points: dict[str, Points] = {b.id: [] for b in mechanism.bodies}
    for joint in mechanism.joints:
        for body, frame in ((joint.body_a, joint.frame_a), (joint.body_b, joint.frame_b)):
            points[body].append((np.array(frame.position_m), frame.rotation()[:, 2]))
    return points


def held_points(mechanism: Mechanism) -> dict[str, Points]:
    """The same, and the centre of mass of a body with a single joint."""
    points = joint_points(mechanism)
    for body in mechanism.bodies:
        if body.inertial and len(points[body.id]) == 1:
            points[body.id].append((np.array(body.inertial.center_of_mass_m), points[body.id][0][1]))
    return points


def length_axis(points: Points) -> np.ndarray:
    """Direction in which a body's joints are spread, across their common axis."""
    if len(points) < 2:
        return np.array([1.0, 0.0, 0.0])
    spread = np.array([p for p, _ in points]) - points[0][0]
    axis = points[0][1]
    across = spread - np.outer(spread @ axis, axis)
    if np.abs(across).max() > 1e-9:
        spread = across
    direction = np.linalg.svd(spread)[2][0]
    return direction if spread[np.abs(spread @ direction).argmax()] @ direction >= 0 else -direction
