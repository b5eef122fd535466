"""Markers without a sticker: what is printed or scratched round a point, followed by itself.

A point's surroundings are carried from picture to picture by pyramidal Lucas-Kanade, and back again: what does not
return to where it came from is not believed (Kalal, Mikolajczyk and Matas 2010).  The surroundings as the first picture
showed them are then laid over the present one under an affine map, a gain and an offset (Baker and Matthews 2004,
inverse compositional), so that errors do not add up along the clip.
"""

from __future__ import annotations

from collections.abc import Mapping

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from backend.observe.between_pixels import light_at
from backend.observe.carried import REACH_PX
from backend.observe.detect import Detections
from backend.observe.track import Expected, Predictor
from backend.observe.tracking_error import TrackingError
from backend.observe.video import Frame

STEPS = 12
ALIKE = 0.7  # of the contrast is explained where nothing covers the point
RETURN_PX = 1.0  # from picture to picture and back
HOLD_PX = 0.1  # what noise may do to a place on a surface that can be followed
GRAIN_PX = 1.5  # of what counts as texture: finer grain is noise
WIDEST_PX = 20  # reach of the window from picture to picture; its pyramid looks farther
EMPTY = 1e-6  # codes^2, far below what any texture tells: nothing to see is known to a kilopixel
NOISE_CODES = 2.0  # of a sharp picture, at least
Warp = Float[np.ndarray, "n 2 3"]


class Surroundings:
    """Discs of one picture about some points, and how they change when they move, stretch or turn."""

    def __init__(self, luma: UInt8[np.ndarray, "h w"], px: Float[np.ndarray, "n 2"], reach_px: int):
        k = np.arange(-reach_px, reach_px + 1)
        dv, du = (d.astype(np.float32) for d in np.meshgrid(k, k, indexing="ij"))
        inside = np.hypot(du, dv) <= reach_px + 0.5
        self.at = np.stack([du[inside], dv[inside], np.ones(inside.sum())])
        still = np.concatenate([np.tile(np.eye(2), (len(px), 1, 1)), px[:, :, None]], 2)
        seen, half = self._sample(luma, still), 0.5 * np.eye(2)[:, :, None] * [0, 0, 1]  # half a pixel along u, along v
        slope = [self._sample(luma, still + h) - self._sample(luma, still - h) for h in half]
        u, v = self.at[:2]
        columns = [s * w for s in slope for w in (u, v, np.ones_like(u))]
        self.basis = np.stack([*columns, seen, np.ones_like(seen)], -1)
        self.solve = np.linalg.pinv(self.basis)

    def _sample(self, luma: np.ndarray, warp: Warp) -> Float[np.ndarray, "n k"]:
        at = warp @ self.at
        return light_at(luma, at[:, 0], at[:, 1], cv2.INTER_CUBIC)

    def noise_px2(self, codes: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n 2 2"]:
        """What so much noise in every pixel does to a place."""
        information = np.swapaxes(self.basis, 1, 2) @ self.basis + EMPTY * np.eye(self.basis.shape[2])
        return np.linalg.inv(information)[:, [[2], [5]], [2, 5]] * (codes**2)[:, None, None]

    def lay(
        self, luma: UInt8[np.ndarray, "h w"], warp: Warp
    ) -> tuple[Warp, Bool[np.ndarray, "n"], Float[np.ndarray, "n 2 2"]]:
        """The warps that lay the discs over another picture, whether they look alike there, covariance [px^2]."""
        for _ in range(STEPS):
            seen = self._sample(luma, warp)
            fit = np.einsum("nck,nk->nc", self.solve, seen)
            gain = np.where(np.abs(fit[:, 6]) > 0.2, fit[:, 6], np.inf)
            change = (fit[:, :6] / gain[:, None]).reshape(-1, 2, 3)
            change = np.clip(change, -np.array([0.05, 0.05, 2.0]), np.array([0.05, 0.05, 2.0]))
            warp = _after(warp, change)
        rest = seen - np.einsum("nkc,nc->nk", self.basis, fit)
        alike = (rest.var(1) < (1 - ALIKE) * seen.var(1)) & (fit[:, 6] > 0.2)
        return warp, alike, self.noise_px2(np.maximum(rest.std(1), NOISE_CODES))


def _after(warp: Warp, change: Warp) -> Warp:
    """The warp that brings back what, under the one before, looks changed by so much."""
    whole = np.tile(np.eye(3), (2, len(warp), 1, 1))
    whole[0, :, :2] = warp
    whole[1, :, :2] += change
    return (whole[0] @ np.linalg.inv(whole[1]))[:, :2]


def _refuse(start_px: Mapping[str, Float[np.ndarray, "2"]], wrong: Bool[np.ndarray, "n"], why: str) -> None:
    if wrong.any():
        listed = ", ".join(name for name, bad in zip(start_px, wrong, strict=True) if bad)
        raise TrackingError(f"Where {listed} should be in the first picture is {why}.")


class TextureTargets:
    """Points of a mechanism's own surface, each begun where its marker is in the first picture.

    reach_px: how far round it the surface counts.  paths_px: where to look for each, from elsewhere. Raises
    TrackingError where a surface cannot be followed.
    """

    look, strangers = None, 0

    def __init__(
        self,
        first: Frame,
        start_px: Mapping[str, Float[np.ndarray, "2"]],
        reach_px: int = REACH_PX,
        paths_px: Float[np.ndarray, "frame marker 2"] | None = None,
    ):
        at = np.array(list(start_px.values()), float)
        size = np.array(first.luma.shape)[::-1]
        self.radius_px, window = float(reach_px), 2 * min(reach_px, WIDEST_PX) + 1
        self.flow = {"winSize": (window, window), "maxLevel": 2, "flags": cv2.OPTFLOW_USE_INITIAL_FLOW}
        _refuse(
            start_px,
            np.any((at < reach_px) | (at > size - 1 - reach_px), axis=1),
            f"within {reach_px} px of the picture's edge; let less round it count, or begin where it is farther inside",
        )
        self.own = Surroundings(first.luma, at, reach_px)
        codes = np.full(len(at), NOISE_CODES)
        noise = self.own.noise_px2(codes)
        # Noise looks like texture; blurred, it does not.
        blurred = Surroundings(np.asarray(cv2.GaussianBlur(first.luma, (0, 0), GRAIN_PX), np.uint8), at, reach_px)
        _refuse(
            start_px,
            np.asarray(np.linalg.eigvalsh(blurred.noise_px2(codes))[:, -1] > HOLD_PX**2),
            "on a surface too smooth to be followed; stick a ringed dot or a tag there, or let more of it count: "
            f'"texture:{2 * reach_px}"',
        )
        self.warp = np.concatenate([np.tile(np.eye(2), (len(at), 1, 1)), at[:, :, None]], 2)
        self.found = Detections(at, noise, np.ones(len(at), bool), np.ones(len(at)))
        self.order = np.arange(len(at))
        self.before, self.before_px, self.paths_px, self.begun = first.luma, at, paths_px, first.index

    def start(self, predictor: Predictor) -> None:
        """Follow with this predictor from now on."""
        self.predictor = predictor

    def step(self, frame: Frame) -> tuple[Detections, np.ndarray, Expected]:
        """The points in the next picture."""
        expected = self.predictor.predict(frame.time_s)
        guess = expected[0]
        later = frame.index - self.begun
        if self.paths_px is not None and later < len(self.paths_px):
            guess = self.paths_px[later]
        carried, returns = self._there_and_back(frame.luma, guess)
        begin = self.warp.copy()
        begin[:, :, 2] = np.where(returns[:, None], carried, guess)
        warp, alike, cov = self.own.lay(frame.luma, begin)
        near = np.hypot(*(warp[:, :, 2] - begin[:, :, 2]).T) < self.radius_px / 2
        whole = alike & near
        seen = whole | returns
        px = np.where(whole[:, None], warp[:, :, 2], np.where(returns[:, None], carried, guess))
        self.predictor.learn(frame.time_s, px, seen, whole)
        self.warp[whole] = warp[whole]
        self.warp[~whole, :, 2] = px[~whole]
        self.before, self.before_px = frame.luma, px
        return Detections(px, cov, whole, np.ones(len(px))), np.where(seen, self.order, -1), expected

    def _there_and_back(self, luma: np.ndarray, guess: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where each point went since the picture before, and whether it comes back from there."""
        ago = self.before_px.astype(np.float32)[:, None]
        ahead = guess.astype(np.float32)[:, None]
        there, found, _ = cv2.calcOpticalFlowPyrLK(self.before, luma, ago, ahead.copy(), **self.flow)
        back, again, _ = cv2.calcOpticalFlowPyrLK(luma, self.before, there, there - (ahead - ago), **self.flow)
        away = np.hypot(*(back - ago)[:, 0].T)
        return there[:, 0].astype(float), (away < RETURN_PX) & (found[:, 0] > 0) & (again[:, 0] > 0)
