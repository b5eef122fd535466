"""Follow each dot from picture to picture, and know it again after it was hidden."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import linear_sum_assignment

from backend.observe.detect import Detections
from backend.observe.kinematics import PART_M, SEEN_M, Kinematics
from backend.observe.project import AbstractView

FRESH_FRAMES = 2  # a dot missing for longer may only take detections that no other dot claims
SURE = 0.4  # of the gate: a picture whose dots all lie nearer than this needs no second look
LOOKS = 3  # the mechanism's pose after two more looks moves no dot by a pixel
Expected = tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n"]]


class Predictor(Protocol):
    """Where the dots are expected [px], and how far off that may be: three standard deviations [px]."""

    def predict(self, time_s: float) -> Expected:
        """Expected pixels at a time."""
        ...

    def refine(
        self, time_s: float, px: Float[np.ndarray, "n 2"], seen: np.ndarray, whole: np.ndarray
    ) -> Expected | None:
        """The same, helped by the dots found so far in this picture; None where they tell nothing of the others."""
        ...

    def learn(self, time_s: float, px: Float[np.ndarray, "n 2"], seen: np.ndarray, whole: np.ndarray) -> None:
        """Take in the places of the dots that were seen; of those not whole, the place is rough."""
        ...


class ConstantVelocity:
    """Every dot keeps the velocity that it last had [px/s]; acceleration_px_per_s2 bounds how wrong that is."""

    def __init__(self, time_s: float, px: Float[np.ndarray, "n 2"], acceleration_px_per_s2: float):
        self.seen_s = np.full(len(px), time_s)
        self.px = np.array(px, float)
        self.velocity = np.zeros_like(self.px)
        self.met = np.zeros(len(px), bool)
        self.time_s, self.strange_s = time_s, np.zeros(len(px))  # how long each was hidden before it was last found
        self.acceleration = acceleration_px_per_s2

    def predict(self, time_s: float) -> Expected:
        """Where each dot would be by now [px]."""
        late = time_s - self.seen_s
        reach = self.acceleration * (0.5 * late**2 + self.strange_s * late)
        return self.px + self.velocity * late[:, None], reach

    def refine(
        self, time_s: float, px: Float[np.ndarray, "n 2"], seen: np.ndarray, whole: np.ndarray
    ) -> Expected | None:
        """Nothing: each dot goes its own way."""
        return None

    def learn(self, time_s: float, px: Float[np.ndarray, "n 2"], seen: np.ndarray, whole: np.ndarray) -> None:
        """Renew place and velocity; a dot seen in part renews its place alone."""
        sure = seen & whole
        now = (px[sure] - self.px[sure]) / (time_s - self.seen_s[sure])[:, None]
        # Half the old velocity halves the noise; a dot's first step, also after it was hidden, has none to lean on.
        keep = np.where((self.met & (self.strange_s == 0))[sure], 0.5, 0.0)[:, None]
        self.velocity[sure] = keep * self.velocity[sure] + (1 - keep) * now
        self.met |= sure
        # While it was hidden its velocity changed, unseen.
        self.strange_s[sure] = (self.time_s - self.seen_s)[sure]
        self.px[seen], self.seen_s[seen], self.time_s = px[seen], time_s, time_s


class Linked:
    """The drawn dots move with their mechanism; any further ones each on its own."""

    def __init__(
        self,
        each: ConstantVelocity,
        together: Kinematics,
        view: AbstractView,
        heights_m: Float[np.ndarray, "marker"],
    ):
        self.each, self.together, self.view, self.heights_m = each, together, view, heights_m
        own = each.px[: len(heights_m)]
        self.metres_per_px = np.abs(np.linalg.det(view.slope(own, heights_m))) ** 0.5

    def predict(self, time_s: float) -> Expected:
        """Where the bodies' own velocities carry the dots."""
        return self._with_strangers(time_s, *self.together.predict(time_s))

    def refine(
        self, time_s: float, px: Float[np.ndarray, "n 2"], seen: np.ndarray, whole: np.ndarray
    ) -> Expected | None:
        """Where pins and bars put the dots, now that some are found."""
        return self._with_strangers(time_s, *self.together.refine(time_s, *self._metres(px, seen, whole)))

    def learn(self, time_s: float, px: Float[np.ndarray, "n 2"], seen: np.ndarray, whole: np.ndarray) -> None:
        """Renew the bodies' poses and velocities, from the whole dots."""
        self.each.learn(time_s, px, seen, whole)
        self.together.learn(time_s, *self._metres(px, seen, whole))

    def _metres(self, px: np.ndarray, seen: np.ndarray, whole: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The drawn dots' places and how well each is seen [m]."""
        n = len(self.heights_m)
        sd = np.where(whole[:n], SEEN_M, PART_M)
        return self.view.metres(px[:n], self.heights_m), np.where(seen[:n], sd, np.inf)

    def _with_strangers(self, time_s: float, at_m: np.ndarray, sd_m: np.ndarray) -> Expected:
        px, reach = self.each.predict(time_s)
        n = len(at_m)
        px[:n], reach[:n] = self.view.pixels(at_m, self.heights_m), 3 * sd_m / self.metres_per_px
        return px, reach


class Tracker:
    """One-to-one assignment of detections to dots, at the least total distance from where they are expected.

    gate_px: how far from its expected place a dot may turn up, besides what the predictor itself may be wrong by.
    """

    def __init__(self, predictor: Predictor, count: int, gate_px: float):
        self.predictor, self.gate_px = predictor, gate_px
        self.missing = np.zeros(count, int)

    def follow(self, time_s: float, found: Detections) -> tuple[Int[np.ndarray, "n"], Expected]:
        """The detection of each dot (-1: none), and where each was expected [px]."""
        expected = self.predictor.predict(time_s)
        index = self._assign(found, *expected)
        for _ in range(LOOKS - 1):
            px, seen, whole = self._places(found, index, expected[0])
            if seen.all() and np.hypot(*(px - expected[0]).T).max() < SURE * self.gate_px:
                break
            again = self.predictor.refine(time_s, px, seen, whole)
            if again is None:
                break
            expected, before = again, index
            index = self._assign(found, *expected)
            if (index == before).all():
                break
        px, seen, whole = self._places(found, index, expected[0])
        self.predictor.learn(time_s, px, seen, whole)
        self.missing = np.where(seen, 0, self.missing + 1)
        return index, expected

    @staticmethod
    def _places(found: Detections, index: np.ndarray, expected: np.ndarray) -> tuple[np.ndarray, ...]:
        """Where each dot is, or else is expected; whether it was seen, and in whole."""
        px, seen, whole = expected.copy(), index >= 0, np.zeros(len(expected), bool)
        px[seen], whole[seen] = found.px[index[seen]], found.whole[index[seen]]
        return px, seen, whole

    def _assign(self, found: Detections, expected: np.ndarray, reach: np.ndarray) -> Int[np.ndarray, "n"]:
        gate = self.gate_px + reach
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
        return index
