"""Whether the camera stood still: the bed's marks followed through the clip.

Each mark's surroundings in the first picture are laid over every later one (Lucas and Kanade, with a gain and an offset
for the light).  A still camera's marks are then known from all pictures instead of one; a shaken one gets a pose for
every picture, at one time within it although a rolling shutter reads the marks one after another.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from backend.observe.bed import Bed, spans_a_plane
from backend.observe.project import AbstractView, calibrate
from backend.observe.rows import Rows
from backend.observe.texture import GRAIN_PX, HOLD_PX, NOISE_CODES
from backend.observe.tracking_error import TrackingError

REACH_PX = 24  # half the side of what is laid over: the middle of a tag of 80 px
STEPS = 6  # of Lucas and Kanade; a mark moves a few pixels from picture to picture
ALIKE = 0.8  # of a mark's contrast is explained where nothing covers it
SHAKEN_PX = 0.3  # marks of a still camera seem to move by less, light and compression included
FEWEST = 4  # marks that fix a pose


class BedWatch:
    """Follows the marks, picture by picture."""

    def __init__(self, px: Float[np.ndarray, "mark 2"], luma: UInt8[np.ndarray, "h w"], frames: int):
        self.first_px, self.px, self.step = px, px.copy(), np.zeros(2)
        k = np.arange(-REACH_PX, REACH_PX + 1, dtype=np.float32)
        self.dv, self.du = np.repeat(k, len(k)), np.tile(k, len(k))
        seen = self._patches(luma, px)
        square = seen.reshape(len(px), len(k), len(k))
        slope_v, slope_u = (np.asarray(np.gradient(square, axis=axis)) for axis in (1, 2))
        flat = np.ones_like(seen)
        basis = np.stack([slope_u.reshape(seen.shape), slope_v.reshape(seen.shape), seen, flat], -1)
        self.basis, self.solve = basis, np.linalg.pinv(basis)
        self.followable = self._followable(luma, px)
        self.moved = np.full((frames, len(px), 2), np.nan, np.float32)
        self.count = 0

    def _followable(self, luma: UInt8[np.ndarray, "h w"], px: Float[np.ndarray, "mark 2"]) -> Bool[np.ndarray, "mark"]:
        """Which marks lie clear of the picture's edge, with something round them that tells where they are.

        Noise looks like texture; blurred, it does not.
        """
        margin = REACH_PX / 2
        inside = ((px >= margin) & (px <= np.array(luma.shape)[::-1] - 1 - margin)).all(1)
        side = 2 * REACH_PX + 1
        blurred = np.asarray(cv2.GaussianBlur(luma, (0, 0), GRAIN_PX), np.uint8)
        square = self._patches(blurred, px).reshape(-1, side, side)
        v, u = (np.asarray(np.gradient(square, axis=axis)).reshape(-1, side**2) for axis in (1, 2))
        steepness = np.linalg.eigvalsh(np.stack([u, v], 1) @ np.stack([u, v], 2))[:, 0]
        return inside & (steepness > (NOISE_CODES / HOLD_PX) ** 2)

    def _patches(self, luma: np.ndarray, px: np.ndarray) -> Float[np.ndarray, "mark k"]:
        u, v = (px[:, j, None].astype(np.float32) + d for j, d in ((0, self.du), (1, self.dv)))
        if not u.size:  # a bed without marks
            return u
        return cv2.remap(luma, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(np.float32)

    def look(self, luma: UInt8[np.ndarray, "h w"]) -> None:
        """Note where the marks are in the next picture; NaN for those that are covered."""
        at = self.px + self.step
        for _ in range(STEPS):
            seen = self._patches(luma, at)
            fit = np.einsum("mik,mk->mi", self.solve, seen)
            at = at - np.clip(fit[:, :2] / np.where(np.abs(fit[:, 2:3]) > 0.2, fit[:, 2:3], np.inf), -3, 3)
        rest = seen - np.einsum("mki,mi->mk", self.basis, fit)
        sound = self.followable & (rest.var(1) < (1 - ALIKE) * seen.var(1)) & (fit[:, 2] > 0.2)
        if sound.any():
            step = np.median((at - self.px)[sound], axis=0)
            self.step = step if self.count else np.zeros(2)
            self.px = np.where(sound[:, None], at, self.px + step)
        self.moved[self.count] = np.where(sound[:, None], at - self.first_px, np.nan)
        self.count += 1

    def result(self) -> Float[np.ndarray, "frame mark 2"]:
        """How far each mark was from its first place [px]."""
        return self.moved[: self.count].astype(float)


@dataclass(frozen=True)
class ShakenView:
    """The camera's view in every picture, as at `times_s` [s]."""

    times_s: Float[np.ndarray, "frame"]
    views: tuple[AbstractView, ...]

    def metres(
        self,
        px: Float[np.ndarray, "n 2"],
        height_m: Float[np.ndarray, "n"],
        frame: Int[np.ndarray, "n"],
        time_s: np.ndarray,
    ) -> Float[np.ndarray, "n 2"]:
        """Bed coordinates [m] of points seen in a frame at times of their own, between two of the poses."""
        late = time_s - self.times_s[frame]
        other = np.clip(frame + np.where(late > 0, 1, -1), 0, len(self.views) - 1)
        apart = self.times_s[other] - self.times_s[frame]
        share = np.where(apart != 0, late / np.where(apart != 0, apart, 1), 0)[:, None]
        here, there = np.zeros((len(px), 2)), np.zeros((len(px), 2))
        for out, which in ((here, frame), (there, other)):
            for n in np.unique(which):
                own = which == n
                out[own] = self.views[n].metres(px[own], height_m[own])
        return here + share * (there - here)


def settle(
    bed: Bed, moved: Float[np.ndarray, "frame mark 2"], times_s: Float[np.ndarray, "frame"], rows: Rows
) -> tuple[Bed, ShakenView | None]:
    """The bed with marks from all pictures, and the views of a camera that was shaken (None where it stood still)."""
    width, height = rows.size_px
    seen = np.isfinite(moved[..., 0])
    counted = seen.sum(1) >= FEWEST
    typical = np.nanmedian(moved[counted], axis=1) if counted.any() else np.zeros((0, 2))
    if not len(typical) or np.quantile(np.hypot(*typical.T), 0.9) < SHAKEN_PX:
        often = seen.sum(0) > 0.5 * len(moved)
        shift = np.where(often[:, None], np.nanmean(np.where(seen[..., None] & often[:, None], moved, 0), axis=0), 0)
        return _with_marks(bed, bed.pixels() + shift), None
    px = bed.pixels()[None] + moved
    at = times_s + 0.5 * bed.readout_s
    own_s = times_s[:, None] + bed.readout_s * np.clip(rows.share(bed.pixels()), 0, 1)
    level = np.full_like(px, np.nan)
    for m in range(px.shape[1]):
        known = seen[:, m]
        if known.sum() > 1:
            for j in (0, 1):
                level[:, m, j] = np.where(known, np.interp(at, own_s[known, m], px[known, m, j]), np.nan)
    views = [calibrate(bed, width, height)]
    for n in range(len(px)):
        views.append(_view_by(bed, level[n], rows.size_px) or views[-1])
    return bed, ShakenView(at, tuple(views[1:]))


def _view_by(bed: Bed, px: Float[np.ndarray, "mark 2"], size_px: tuple[int, int]) -> AbstractView | None:
    """The view by the marks that are seen (NaN: not), None where they fix none: too few, or all but one on a line."""
    use = np.isfinite(px[:, 0])
    if use.sum() < FEWEST or not (spans_a_plane(bed.metres()[use]) and spans_a_plane(px[use])):
        return None
    marks = tuple(m for m, u in zip(bed.marks, use, strict=True) if u)
    try:
        return calibrate(_with_marks(bed.model_copy(update={"marks": marks}), px[use]), *size_px)
    except TrackingError:  # one of them was taken for something else
        return None


def _with_marks(bed: Bed, px: Float[np.ndarray, "mark 2"]) -> Bed:
    marks = (m.model_copy(update={"x_px": float(u), "y_px": float(v)}) for m, (u, v) in zip(bed.marks, px, strict=True))
    return bed.model_copy(update={"marks": tuple(marks)})
