"""Where a flat mechanism's dots must be, from those that are seen: pins hold its parts together.

Every body has a place and a turn in the bed's plane.  They follow from the dots seen (each with its carried residual: a
sticker is never exactly where it was drawn), from the pins (to within their play) and from how the bodies moved
before; a dot under somebody's hand is where its bar is.  Least squares by Gauss and Newton, three numbers a body.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from backend.observe.bed import Plane
from backend.observe.label import rotation

SEEN_M, PART_M = 1e-4, 1e-3  # how far a dot is from where its body puts it; one that is seen in part
HELD_M, WRONG_M = 3e-4, 1e-3  # a pin's play; beyond this a dot may be another's, and pulls no harder
PUSH_M_PER_S2, TWIST_PER_S2 = 60.0, 1500.0  # beyond what springs and hands do to a linkage on a table
STILL_M = 1e-4  # what a body's pose changes by, besides
START_S = 0.02  # before the first picture nothing says how fast the bodies are: 6 g for so long
ROUNDS, GREATEST_TURN, SETTLED_TURN = 12, 0.5, 0.02  # rad: a bar found again may have turned far
KNOWN = 0.6  # of what its own motion leaves open: a body that is known so much better needs no older memory
FORGET = 0.7  # of a residual, each time that the dot is seen
ODD_M = 4e-3  # a drawing whose dots are farther off than this is not what was filmed
FLAT_TYPES = ("revolute", "fixed", "prismatic")  # of which poses are solved for


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


class Kinematics:
    """Predicts a flat mechanism's dots [m, in the bed's plane], and how far off each prediction may be."""

    def __init__(self, flat: FlatMechanism, time_s: float, seen_m: Float[np.ndarray, "marker 2"]):
        self.flat, self.time_s = flat, time_s
        self.poses = np.zeros((len(flat.ids), 3))
        self.rate = np.zeros_like(self.poses)
        self.age_s = np.zeros(len(flat.ids))  # since each body's pose was last known
        self.strange_s = np.full(len(flat.ids), START_S)  # for which it was not, before it was last found
        self.dot_residual = np.zeros_like(seen_m)
        every = np.full(len(seen_m), SEEN_M)
        for _ in range(5):
            self.poses = self._solve(self.poses, self.poses, np.array([1.0, 1.0, 10.0]), seen_m, every)[0]
        off = seen_m - flat.carried(self.poses, flat.marker_body, flat.marker_at)[0]
        self.fits = bool(flat.flat and np.sqrt((off**2).sum(1).mean()) < ODD_M)
        self.dot_residual = off
        # A body's turn about its only dot is never known, and moves no dot.
        loose = _loose(np.full(len(flat.ids), PUSH_M_PER_S2 * START_S**2))
        self.tells = _deviations(self._solve(self.poses, self.poses, loose, seen_m, every)[1]) < KNOWN * loose

    def predict(self, time_s: float) -> tuple[Float[np.ndarray, "marker 2"], Float[np.ndarray, "marker"]]:
        """Places [m], and the standard deviation of each [m], with every body as fast as it was."""
        late = time_s - self.time_s
        far = PUSH_M_PER_S2 * ((self.age_s + late) ** 2 / 6 + self.strange_s * late)
        place = self.flat.carried(self.poses + self.rate * late, self.flat.marker_body, self.flat.marker_at)[0]
        return place + self.dot_residual, far[self.flat.marker_body] * (self.flat.marker_body >= 0)

    def refine(
        self, time_s: float, at_m: Float[np.ndarray, "marker 2"], sd_m: Float[np.ndarray, "marker"]
    ) -> tuple[Float[np.ndarray, "marker 2"], Float[np.ndarray, "marker"]]:
        """The same, where pins and bars put the dots when some are seen; sd_m is infinite for those that are not."""
        late = time_s - self.time_s
        ahead = self.poses + self.rate * late
        far = PUSH_M_PER_S2 * (0.25 * (self.age_s + late) ** 2 + self.strange_s * late) + STILL_M
        loose = _loose(far)
        self._now = ahead
        for k in range(ROUNDS):
            before, (self._now, cov) = self._now, self._solve(self._now, ahead, loose, at_m, sd_m)
            turn = np.abs(self._now - before)[:, 2].max()
            self._now = before + (self._now - before) * min(1.0, GREATEST_TURN / max(turn, 1e-12))
            if k > 0 and turn < SETTLED_TURN:
                break
        place, slope = self.flat.carried(self._now, self.flat.marker_body, self.flat.marker_at)
        own = np.maximum(self.flat.marker_body, 0)
        spread = np.einsum("nij,njk,nik->n", slope, cov[own, :, own, :], slope) / 2
        self._known = ((_deviations(cov) < KNOWN * loose) | ~self.tells).all(1)
        return place + self.dot_residual, np.sqrt(spread)

    def learn(self, time_s: float, at_m: Float[np.ndarray, "marker 2"], sd_m: Float[np.ndarray, "marker"]) -> None:
        """Take in where the dots of a picture were."""
        self.refine(time_s, at_m, sd_m)
        late = max(time_s - self.time_s, 1e-6)
        # What a body's pose was missed by grew for as long as it was not known; so long its velocity changed unseen.
        unknown_s = self.age_s + late
        missed = self._now - self.poses - self.rate * late
        self.rate = self.rate + 0.8 * missed / unknown_s[:, None]
        self.strange_s = np.where(self._known, self.age_s, self.strange_s)
        self.poses, self.time_s = self._now, time_s
        self.age_s = np.where(self._known, 0.0, self.age_s + late)
        place = self.flat.carried(self.poses, self.flat.marker_body, self.flat.marker_at)[0]
        off = np.where(sd_m[:, None] <= SEEN_M, at_m - place, self.dot_residual)
        self.dot_residual = FORGET * self.dot_residual + (1 - FORGET) * off

    def _solve(
        self, start: np.ndarray, ahead: np.ndarray, loose: np.ndarray, at_m: np.ndarray, sd_m: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """One Gauss-Newton step from `start`; poses, and their covariance (body, 3, body, 3)."""
        flat, count = self.flat, len(self.flat.ids)
        gap, J_pin = flat.held(start)
        place, slope = flat.carried(start, flat.marker_body, flat.marker_at)
        use = np.flatnonzero(np.isfinite(sd_m) & (flat.marker_body >= 0))
        J_dot = np.zeros((len(use), 2, count, 3))
        J_dot[np.arange(len(use)), :, flat.marker_body[use]] = slope[use]
        off = (at_m - place - self.dot_residual)[use]
        weight = np.sqrt(1 / np.maximum(1.0, np.hypot(*off.T) / WRONG_M)) / sd_m[use]  # Huber's
        J = np.concatenate([J_pin / HELD_M, (weight[:, None, None, None] * J_dot).reshape(-1, count, 3)])
        J = J.reshape(-1, 3 * count)
        r = np.r_[-gap / HELD_M, (weight[:, None] * off).ravel()]
        prior = np.broadcast_to(1 / loose**2, (count, 3)).ravel()
        A = J.T @ J + np.diag(prior)
        b = J.T @ r + prior * (ahead - start).ravel()
        cov = np.linalg.inv(A)
        return start + (cov @ b).reshape(count, 3), cov.reshape(count, 3, count, 3)


def _loose(far_m: Float[np.ndarray, "body"]) -> Float[np.ndarray, "body 3"]:
    """What a body's x, y [m] and turn [rad] may be off by where its place may be off by far_m."""
    return far_m[:, None] * np.array([1.0, 1.0, TWIST_PER_S2 / PUSH_M_PER_S2])


def _deviations(cov: Float[np.ndarray, "body 3 body 3"]) -> Float[np.ndarray, "body 3"]:
    return np.sqrt(np.einsum("bibi->bi", cov))


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


def kinematics_of(mechanism: Any, plane: Plane, time_s: float, seen_m: np.ndarray) -> Kinematics | None:
    """A predictor for a mechanism that moves in the bed's plane and stands as drawn; None for any other."""
    flat = FlatMechanism(mechanism, plane)
    if not flat.flat or not flat.ids:
        return None
    made = Kinematics(flat, time_s, np.asarray(seen_m))
    return made if made.fits else None
