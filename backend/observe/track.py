"""Follow each dot from picture to picture, and know it again after it was hidden."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import linear_sum_assignment

from backend.observe.detect import Detections

FRESH_FRAMES = 2  # a dot missing for longer may only take detections that no other dot claims


class Predictor(Protocol):
    """Where the dots are expected; a kinematic model of the mechanism can stand in for constant velocity."""

    def predict(self, time_s: float) -> Float[np.ndarray, "n 2"]:
        """Expected pixels at a time."""
        ...

    def learn(self, time_s: float, px: Float[np.ndarray, "n 2"], seen: np.ndarray, whole: np.ndarray) -> None:
        """Take in the places of the dots that were seen; of those not whole, the place is rough."""
        ...


class ConstantVelocity:
    """Every dot keeps the velocity that it last had [px/s]."""

    def __init__(self, time_s: float, px: Float[np.ndarray, "n 2"]):
        self.seen_s = np.full(len(px), time_s)
        self.px = np.array(px, float)
        self.velocity = np.zeros_like(self.px)
        self.met = np.zeros(len(px), bool)

    def predict(self, time_s: float) -> Float[np.ndarray, "n 2"]:
        """Where each dot would be by now [px]."""
        return self.px + self.velocity * (time_s - self.seen_s)[:, None]

    def learn(self, time_s: float, px: Float[np.ndarray, "n 2"], seen: np.ndarray, whole: np.ndarray) -> None:
        """Renew place and velocity; a dot seen in part renews its place alone."""
        sure = seen & whole
        now = (px[sure] - self.px[sure]) / (time_s - self.seen_s[sure])[:, None]
        # Half the old velocity halves the noise; a dot's first step has no old velocity to lean on.
        keep = np.where(self.met[sure], 0.5, 0.0)[:, None]
        self.velocity[sure] = keep * self.velocity[sure] + (1 - keep) * now
        self.met |= sure
        self.px[seen], self.seen_s[seen] = px[seen], time_s


class Tracker:
    """One-to-one assignment of detections to dots, at the least total distance from where they are expected.

    gate_px: how far from its expected place a dot may turn up.  The gate widens with the time since a dot
    was seen, as 1/2 a t^2 with the greatest acceleration that the scene is expected to hold.
    """

    def __init__(self, predictor: Predictor, time_s: float, count: int, gate_px: float, acceleration_px_per_s2: float):
        self.predictor, self.gate_px, self.acceleration = predictor, gate_px, acceleration_px_per_s2
        self.seen_s = np.full(count, time_s)
        self.missing = np.zeros(count, int)

    def follow(self, time_s: float, found: Detections) -> tuple[Int[np.ndarray, "n"], Float[np.ndarray, "n 2"]]:
        """The detection of each dot (-1: none), and where each was expected [px]."""
        expected = self.predictor.predict(time_s)
        gate = self.gate_px + 0.5 * self.acceleration * (time_s - self.seen_s) ** 2
        index = np.full(len(expected), -1)
        fresh = self.missing <= FRESH_FRAMES
        for group in (np.flatnonzero(fresh), np.flatnonzero(~fresh)):
            free = np.setdiff1d(np.arange(len(found)), index)
            if len(group) == 0 or len(free) == 0:
                continue
            away = np.hypot(*(expected[group][:, None] - found.px[free][None]).transpose(2, 0, 1))
            # Out of reach costs far more than any distance, so as many dots as possible find their own.
            rows, columns = linear_sum_assignment(np.where(away < gate[group][:, None], away, 1e6))
            near = away[rows, columns] < gate[group][rows]
            index[group[rows[near]]] = free[columns[near]]
        seen = index >= 0
        px, whole = expected.copy(), np.zeros(len(expected), bool)
        px[seen], whole[seen] = found.px[index[seen]], found.whole[index[seen]]
        self.predictor.learn(time_s, px, seen, whole)
        self.seen_s[seen] = time_s
        self.missing = np.where(seen, 0, self.missing + 1)
        return index, expected
