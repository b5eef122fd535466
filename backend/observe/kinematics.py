"""Where a flat mechanism's dots must be, from those that are seen: pins hold its parts together.

Every body has a place and a turn in the bed's plane.  They follow from the dots seen (each with its carried residual: a
sticker is never exactly where it was drawn), from the pins (to within their play) and from how the bodies moved
before; a dot under somebody's hand is where its bar is.  Least squares by Gauss and Newton, three numbers a body.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float

from backend.observe.assembly import put_together
from backend.observe.bed import Plane
from backend.observe.flat_mechanism import ODD_M, FlatMechanism

SEEN_M, PART_M = 1e-4, 1e-3  # how far a dot is from where its body puts it; one that is seen in part
HELD_M, WRONG_M = 3e-4, 1e-3  # a pin's play; beyond this a dot may be another's, and pulls no harder
PUSH_M_PER_S2, TWIST_PER_S2 = 60.0, 1500.0  # beyond what springs and hands do to a linkage on a table
STILL_M = 1e-4  # what a body's pose changes by, besides
START_S = 0.02  # before the first picture nothing says how fast the bodies are: 6 g for so long
ROUNDS, GREATEST_TURN, SETTLED_TURN = 12, 0.5, 0.02  # rad: a bar found again may have turned far
KNOWN = 0.6  # of what its own motion leaves open: a body that is known so much better needs no older memory
FORGET = 0.7  # of a residual, each time that the dot is seen


class Kinematics:
    """Predicts a flat mechanism's dots [m, in the bed's plane], and how far off each prediction may be."""

    def __init__(self, flat: FlatMechanism, time_s: float, seen_m: Float[np.ndarray, "marker 2"]):
        self.flat, self.time_s = flat, time_s
        self.poses = put_together(flat, seen_m)
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


def kinematics_of(mechanism: Any, plane: Plane, time_s: float, seen_m: np.ndarray) -> Kinematics | None:
    """A predictor for a mechanism that moves in the bed's plane and stands as drawn; None for any other."""
    flat = FlatMechanism(mechanism, plane)
    if not flat.flat or not flat.ids:
        return None
    made = Kinematics(flat, time_s, np.asarray(seen_m))
    return made if made.fits else None
