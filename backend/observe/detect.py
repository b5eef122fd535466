"""Find every dot in one picture, to a few hundredths of a pixel.

Colour finds a dot, luma places it: chroma is coded at half resolution, luma is not.  The place is the
centroid of how far each pixel has gone from ring to dot, within a window that ends in the ring; five times
finer than the coloured area alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from backend.observe.dots import ANGLES, DotLook, colour_mask, find_blobs, radial_profile
from backend.observe.rim import fit_rims
from backend.observe.video import Frame

Patch = Float[np.ndarray, "n k k"]
ALIKE = 0.4  # of the logarithm of its area: what light and blur do to a patch that nothing covers
LEAST_RIM = 0.8  # of a bare dot's rim must be seen
FARTHEST = 1 << 20  # pixels: no picture is larger
PASSES = 3  # the window follows the centroid; it moves less than 0.001 px in a fourth
# A whole dot, still or blurred by its motion, looks alike from both sides.
UNEVEN = 0.06  # of the contrast, over what the clip's dots usually show
QUIET = 0.08  # ring pixels this near to the ring's level carry noise, not the dot


@dataclass(frozen=True)
class Detections:
    """Dots of one picture.

    px: centres.  cov_px2: what the pixels' noise alone does to them.  whole: the full disc and ring are
    seen; a dot that is partly covered is found, but its centre is not where the dot's is.  weight: its area [px^2].
    uneven: how unlike its two sides are, as a part of the contrast.
    """

    px: Float[np.ndarray, "n 2"]
    cov_px2: Float[np.ndarray, "n 2 2"]
    whole: Bool[np.ndarray, "n"]
    weight: Float[np.ndarray, "n"]
    uneven: Float[np.ndarray, "n"] | None = None

    def __len__(self) -> int:
        return len(self.px)


@dataclass(frozen=True)
class Region:
    """Where dots are sought: from one corner [px] to the other, whole pixels of the colour planes."""

    low: tuple[int, int]
    high: tuple[int, int]

    @classmethod
    def around(cls, px: Float[np.ndarray, "n 2"], reach_px: Float[np.ndarray, "n"]) -> Region:
        """All that lies within reach of any of these points."""
        low, high = (px - reach_px[:, None]).min(0) / 2, (px + reach_px[:, None]).max(0) / 2 + 1
        (u, v), (right, below) = (np.clip(c, 0, FARTHEST).astype(int).tolist() for c in (low, high))
        return cls((u, v), (max(right, u + 1), max(below, v + 1)))

    def of(self, frame: Frame) -> tuple[Frame, Float[np.ndarray, "2"]]:
        """This part of a picture, and where it begins [px]."""
        height, width = frame.cb.shape
        u, v = min(self.low[0], width - 1), min(self.low[1], height - 1)
        rows, columns = slice(v, self.high[1]), slice(u, self.high[0])
        luma = frame.luma[2 * v : 2 * self.high[1], 2 * u : 2 * self.high[0]]
        part = replace(frame, luma=luma, cb=frame.cb[rows, columns], cr=frame.cr[rows, columns])
        return part, np.array([2.0 * u, 2.0 * v])


def detect(frame: Frame, look: DotLook, region: Region | None = None) -> Detections:
    """All dots that have the clip's look and lie clear of the picture's edge; of a region alone where one is given."""
    part, begins = region.of(frame) if region else (frame, np.zeros(2))
    blobs = find_blobs(colour_mask(part, look))
    blobs = replace(blobs, px=blobs.px + begins)
    height, width = frame.luma.shape
    margin = look.radius_px if look.patch else look.ring_px + 2
    inside = ((blobs.px > margin) & (blobs.px < np.array([width, height]) - 1 - margin)).all(1)
    sized = (blobs.area_px > 0.35 * look.area_px) & (blobs.area_px < 2.5 * look.area_px)
    if look.patch:
        return _patches(blobs.px[inside & sized], blobs.area_px[inside & sized], look)
    found = weigh(frame.luma, blobs.px[inside & sized], look)
    return found if look.ringed or not len(found) else _bare(frame.luma, found, look)


def _patches(px: Float[np.ndarray, "n 2"], area_px: Float[np.ndarray, "n"], look: DotLook) -> Detections:
    """Areas of the clip's colour; whole where they are as large as at first."""
    rim_px = 2 * np.pi * look.radius_px  # each pixel of which is in or out
    cov = np.tile(np.eye(2) / rim_px, (len(px), 1, 1))
    return Detections(px, cov, np.abs(np.log(area_px / look.area_px)) < ALIKE, area_px)


def _bare(luma: np.ndarray, found: Detections, look: DotLook) -> Detections:
    """Dots without a ring: the mean of centroid and rim, which the surroundings mislead each in its own way."""
    rim, cov, share = fit_rims(luma, found.px, look)
    apart = rim - found.px
    near = np.hypot(*apart.T) < 0.3 * look.radius_px
    px = np.where(near[:, None], found.px + 0.5 * apart, found.px)
    spread = 0.25 * np.einsum("ni,nj->nij", apart, apart)
    return replace(found, px=px, cov_px2=cov + spread, whole=near & (share > LEAST_RIM))


def learn_whole(look: DotLook, found: Detections, which: list[int]) -> DotLook:
    """The look with what whole dots of the first picture weigh, and how uneven noise makes them."""
    if found.uneven is None or not which:
        return look
    weight, uneven = float(np.median(found.weight[which])), float(np.median(found.uneven[which]))
    return replace(look, weight=weight, uneven=uneven)


class Weighing(NamedTuple):
    """Dots as weighed about given points: a (k, k) patch each.

    dx, dy, r: pixels from the point.  core, ring: luma of the dot and of its ring.  total: weighted area
    [px^2].  shift: from the point to the weighted centroid [px].
    """

    patch: Patch
    dx: Patch
    dy: Patch
    r: Patch
    core: Float[np.ndarray, "n"]
    ring: Float[np.ndarray, "n"]
    total: Float[np.ndarray, "n"]
    shift: Float[np.ndarray, "n 2"]


def weigh_about(luma: np.ndarray, px: Float[np.ndarray, "n 2"], look: DotLook, reach: int) -> Weighing:
    """Weigh every pixel near each point by how far it has gone from ring to dot."""
    k = np.arange(-reach, reach + 1)
    corner = np.round(px).astype(int)
    patch = luma[corner[:, 1, None, None] + k[:, None], corner[:, 0, None, None] + k].astype(float)
    dx = k[None, None, :] - (px - corner)[:, 0, None, None]
    dy = k[None, :, None] - (px - corner)[:, 1, None, None]
    r = np.hypot(dx, dy)
    core = masked_median(patch, r < 0.6 * look.radius_px)
    ring = masked_median(patch, np.abs(r - look.window_px) < 0.75)
    share = np.clip((ring[:, None, None] - patch) / np.maximum(ring - core, 5.0)[:, None, None], 0, 1)
    weight = np.where(share < QUIET, 0, share) * np.clip(look.window_px + 0.5 - r, 0, 1)
    total = np.maximum(weight.sum((1, 2)), 1e-9)
    shift = np.stack([(weight * dx).sum((1, 2)), (weight * dy).sum((1, 2))], 1) / total[:, None]
    return Weighing(patch, dx, dy, r, core, ring, total, np.clip(shift, -2, 2))


def weigh(luma: np.ndarray, start_px: Float[np.ndarray, "n 2"], look: DotLook) -> Detections:
    """Luma-weighted centroids near the given points [px]."""
    n, reach = len(start_px), int(np.ceil(look.ring_px)) + 2
    if n == 0:
        return Detections(np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros(0, bool), np.zeros(0))
    limit = np.array(luma.shape)[::-1] - 1 - reach
    px = np.clip(start_px, reach, limit).astype(float)
    for _ in range(PASSES - 1):
        px = np.clip(px + weigh_about(luma, px, look, reach).shift, reach, limit)
    last = weigh_about(luma, px, look, reach)
    px = px + last.shift
    contrast = np.maximum(last.ring - last.core, 5.0)
    off = np.abs(last.patch - last.core[:, None, None])
    grain = np.maximum(1.4826 * masked_median(off, last.r < 0.6 * look.radius_px), 0.5)
    active = last.r < look.window_px
    arm = np.stack(np.broadcast_arrays(last.dx, last.dy), -1) * active[..., None]
    spread = np.einsum("nijp,nijq->npq", arm, arm)
    noise = (grain / contrast / last.total) ** 2
    share = last.total / look.weight if look.weight else np.ones(n)
    rays = radial_profile(luma, px, look.window_px * np.array([0.25, 0.5, 0.75, 1.0]))
    uneven = np.abs(rays - np.roll(rays, len(ANGLES) // 2, 1)).mean((1, 2)) / contrast
    whole = (uneven < UNEVEN + look.uneven) & (share > 0.5) & (share < 1.3)
    return Detections(px, spread * noise[:, None, None], whole, last.total, uneven)


def masked_median(patch: Float[np.ndarray, "n k k"], mask: Bool[np.ndarray, "n k k"]) -> Float[np.ndarray, "n"]:
    """Median of each patch where its mask holds; zero where it holds nowhere."""
    ranked = np.sort(np.where(mask, patch, np.inf).reshape(len(patch), -1), axis=1)
    count = mask.reshape(len(patch), -1).sum(1)
    middle = np.take_along_axis(ranked, np.maximum((count - 1) // 2, 0)[:, None], 1)[:, 0]
    return np.where(count > 0, middle, 0.0)
