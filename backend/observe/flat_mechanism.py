"""A mechanism that moves in the bed's plane: its parts, dots and joints as the plane sees them."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from backend.observe.label import rotation
from backend.observe.plane import Plane

FLAT_TYPES = ("revolute", "fixed", "prismatic")  # of which poses are solved for
ODD_M = 4e-3  # a drawing whose dots are farther off than this is not what was filmed


class FlatMechanism:
    """The bodies, pins and dots of a mechanism that moves in the bed's plane; `flat` says whether it does.

    Poses are (body, 3): x, y [m] and turn [rad], zero as drawn.
    """

    def __init__(self, mechanism: Any, plane: Plane):
        self.ids = [b.id for b in mechanism.bodies if not b.fixed]
        index = {id: k for k, id in enumerate(self.ids)}
        poses = {b.id: b.pose for b in mechanism.bodies}

        def place(body: str, point: Any) -> np.ndarray:
            pose = poses[body]
            world = np.asarray(pose.position_m) + rotation(pose.quaternion_wxyz) @ np.asarray(point)
            return plane.from_world(world)[:2]

        self.origin = np.array([plane.from_world(poses[id].position_m)[:2] for id in self.ids]).reshape(-1, 2)
        self.marker_body = np.array([index.get(m.body, -1) for m in mechanism.markers])
        self.marker_at = np.array([place(m.body, m.position_m) for m in mechanism.markers]).reshape(-1, 2)
        self.flat, pins = True, []
        for joint in mechanism.joints:
            axis, kind = _axis(joint, poses), joint.type
            if kind not in FLAT_TYPES or not _keeps(kind, axis, plane):
                self.flat = False
                return
            a, b = index.get(joint.body_a, -1), index.get(joint.body_b, -1)
            across = np.array([-plane.axes()[1] @ axis, plane.axes()[0] @ axis])  # of a guide, in the plane
            pins.append((a, b, place(joint.body_a, joint.frame_a.position_m), kind, across))
        self.pin_bodies = np.array([p[:2] for p in pins], int).reshape(-1, 2)
        self.pin_at = np.array([p[2] for p in pins]).reshape(-1, 2)
        self.guide_across = np.array([p[4] for p in pins]).reshape(-1, 2)
        self.turns = np.array([p[3] == "revolute" for p in pins], bool)
        self.slides = np.array([p[3] == "prismatic" for p in pins], bool)

    def afloat(self) -> FlatMechanism:
        """The same with its ground a part like the others, which may stand anywhere."""
        made, ground = copy(self), len(self.ids)
        made.ids = [*self.ids, "ground"]
        made.origin = np.concatenate([self.origin, np.zeros((1, 2))])
        made.marker_body = np.where(self.marker_body < 0, ground, self.marker_body)
        made.pin_bodies = np.where(self.pin_bodies < 0, ground, self.pin_bodies)
        return made

    def carried(
        self, poses: Float[np.ndarray, "body 3"], body: Int[np.ndarray, "n"], at: Float[np.ndarray, "n 2"]
    ) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2 3"]]:
        """Where points drawn at `at` on bodies (-1: the ground) are now, and the slopes in their body's pose."""
        moving = (body >= 0)[:, None]
        pose, origin = poses[body] * moving, self.origin[body]
        arm = at - origin
        c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
        turned = np.stack([c * arm[:, 0] - s * arm[:, 1], s * arm[:, 0] + c * arm[:, 1]], 1)
        now = np.where(moving, origin + pose[:, :2] + turned, at)
        slope = np.zeros((len(at), 2, 3))
        slope[:, 0, 0] = slope[:, 1, 1] = 1
        slope[:, 0, 2], slope[:, 1, 2] = -turned[:, 1], turned[:, 0]
        return now, slope * moving[..., None]

    def held(self, poses: Float[np.ndarray, "body 3"]) -> tuple[np.ndarray, np.ndarray]:
        """How far each joint is open, (row,) [m], and the slopes in all poses, (row, body, 3)."""
        a, b = self.pin_bodies.T
        at_a, slope_a = self.carried(poses, a, self.pin_at)
        at_b, slope_b = self.carried(poses, b, self.pin_at)
        n, count = len(a), len(self.ids)
        J = np.zeros((n, 3, count + 1, 3))  # the last body is the ground, whose slopes fall away
        rows = np.arange(n)
        gap = np.zeros((n, 3))
        gap[:, :2] = at_a - at_b
        J[rows, :2, a] += slope_a
        J[rows, :2, b] -= slope_b
        padded = np.r_[poses, np.zeros((1, 3))]
        gap[:, 2] = 0.1 * (padded[a, 2] - padded[b, 2])  # a tenth of a metre per radian
        J[rows, 2, a, 2] += 0.1
        J[rows, 2, b, 2] -= 0.1
        gap[self.turns, 2], J[self.turns, 2] = 0, 0
        k = np.flatnonzero(self.slides)
        across, turning = self._across(padded[a[k], 2], k)
        apart = gap[k, :2]
        gap[k, 0], gap[k, 1] = (apart * across).sum(1), 0
        J[k, 0], J[k, 1] = np.einsum("nk,nkbc->nbc", across, J[k, :2]), 0
        J[k, 0, a[k], 2] += (apart * turning).sum(1)
        return gap.ravel(), J[:, :, :count].reshape(3 * n, count, 3)

    def _across(
        self, turn: Float[np.ndarray, "n"], which: Int[np.ndarray, "n"]
    ) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2"]]:
        """Square to guides that turned with their bodies, and its slope in their turn."""
        c, s, (x, y) = np.cos(turn), np.sin(turn), self.guide_across[which].T
        across = np.stack([c * x - s * y, s * x + c * y], 1)
        return across, np.stack([-across[:, 1], across[:, 0]], 1)


def _axis(joint: Any, poses: Mapping[str, Any]) -> Float[np.ndarray, "3"]:
    """A joint's axis as drawn, in W."""
    return rotation(poses[joint.body_a].quaternion_wxyz) @ rotation(joint.frame_a.quaternion_wxyz)[:, 2]


def _keeps(kind: str, axis: Float[np.ndarray, "3"], plane: Plane) -> bool:
    """Whether a joint keeps its bodies in the bed's plane, or level with it."""
    along = abs(float(axis @ plane.axes()[2]))
    return {"fixed": True, "prismatic": along < 1e-3}.get(kind, kind in ("revolute", "planar") and along > 0.999)


def out_of_plane(mechanism: Any, plane: Plane) -> str:
    """The first joint that lets parts leave the bed's plane, or lean, with its type; "" where none does."""
    poses = {body.id: body.pose for body in mechanism.bodies}
    loose = (f"{j.id} ({j.type})" for j in mechanism.joints if not _keeps(j.type, _axis(j, poses), plane))
    return next(loose, "")
