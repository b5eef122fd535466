"""A mechanism as a line drawing: what a body holds on to (joints, markers), seen along one direction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from backend.mechanism.mechanism import Mechanism
from backend.report.evidence import Motion

MOST_SPREAD = 1e-9  # m: below it a mechanism is a point and any view will do


@dataclass(frozen=True)
class View:
    """Where the reader stands: `right` and `up` are unit vectors in W."""

    right: Float[np.ndarray, "3"]
    up: Float[np.ndarray, "3"]
    name: str

    def seen(self, p_W: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 2"]:
        """World points as the reader sees them [m]."""
        return np.stack([p_W @ self.right, p_W @ self.up], axis=-1)


VIEWS = (
    View(np.array([1.0, 0, 0]), np.array([0, 0, 1.0]), "x–z plane"),
    View(np.array([1.0, 0, 0]), np.array([0, 1.0, 0]), "x–y plane"),
    View(np.array([0, 1.0, 0]), np.array([0, 0, 1.0]), "y–z plane"),
)


@dataclass(frozen=True)
class Skeleton:
    """Points of each moving body in its own axes [m]; `held` are the joints that stand on fixed bodies, in W."""

    points: dict[str, Float[np.ndarray, "n 3"]]
    held: Float[np.ndarray, "m 3"]

    def placed(self, motion: Motion) -> dict[str, Float[np.ndarray, "t n 3"]]:
        """Where each body's points are over time, in W [m]."""
        placed = {}
        for body, p_B in self.points.items():
            if body in motion.position_m:
                turned = rotated(np.asarray(motion.quaternion_wxyz[body]), p_B)
                placed[body] = np.asarray(motion.position_m[body])[:, None, :] + turned
        return placed


def skeleton_of(mechanism: Mechanism) -> Skeleton:
    """The joints and markers each moving body carries; a body with one alone gets its centre of mass too."""
    points: dict[str, list[tuple[float, ...]]] = {body.id: [] for body in mechanism.bodies}
    for joint in mechanism.joints:
        points[joint.body_a].append(tuple(joint.frame_a.position_m))
        points[joint.body_b].append(tuple(joint.frame_b.position_m))
    for marker in mechanism.markers:
        points[marker.body].append(tuple(marker.position_m))
    held = [np.zeros((0, 3))]
    for body in mechanism.bodies:
        if body.fixed:
            p_B = np.array(points.pop(body.id), float).reshape(-1, 3)
            held.append(np.array(body.pose.position_m) + rotated(np.array([body.pose.quaternion_wxyz]), p_B)[0])
        elif len(points[body.id]) < 2 and body.inertial is not None:
            points[body.id].append(tuple(body.inertial.center_of_mass_m))
    return Skeleton({id: np.array(p, float) for id, p in points.items() if p}, np.concatenate(held))


def best_view(placed: dict[str, Float[np.ndarray, "t n 3"]]) -> View:
    """The principal plane in which most of the motion is seen."""
    if not placed:
        return VIEWS[0]
    cloud = np.concatenate([p.reshape(-1, 3) for p in placed.values()])
    spread = cloud.std(axis=0)
    along = [float(np.hypot(spread @ np.abs(v.right), spread @ np.abs(v.up))) for v in VIEWS]
    return VIEWS[int(np.argmax(np.array(along) > max(along) - MOST_SPREAD))]


def rotated(q_WB: Float[np.ndarray, "t 4"], p_B: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "t n 3"]:
    """Points turned by unit quaternions: p + 2 u x (u x p + w p)."""
    w, u = q_WB[:, None, :1], q_WB[:, None, 1:]
    once = np.cross(u, p_B[None]) + w * p_B[None]
    return p_B[None] + 2.0 * np.cross(u, once)
