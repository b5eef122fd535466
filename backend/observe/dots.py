"""What the dots of a clip look like, learnt from its first picture.

A dot is a coloured disc darker than what surrounds it, best a printed white ring.  Cameras and lamps shift
colours, so hue, saturation and size are measured in the clip itself, never assumed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from backend.observe.between_pixels import light_at
from backend.observe.tracking_error import TrackingError
from backend.observe.video import Frame

Points = Float[np.ndarray, "n 2"]
ANGLES = np.linspace(0, 2 * np.pi, 32, endpoint=False)
MIN_COLOUR = 12.0  # codes away from the bed's own colour; below this, compression paints grey things
MIN_CONTRAST = 15.0  # luma codes between dot and ring
DARKNESS = 40  # codes, of which black is 16
LARGEST = 0.05  # of the picture: a ball that fills more leaves no room to move in
ALL_ROUND = 0.1  # of the contrast: what surrounds a dot varies by less where it is a printed ring
SIZE_GAP = 2.0  # dots of one print differ less than this in area
HUE_GAP_DEG = 25.0  # dots of one print differ less than this in hue, different inks more


@dataclass(frozen=True)
class DotLook:
    """Colour and size shared by the clip's dots.

    neutral: (cb, cr) of the bed.  hue_rad, saturation: polar colour difference from it [rad, codes].
    area_px: coloured area [px^2].  radius_px, ring_px: edge of the dot, and of its ring or what serves as one.
    weight: the luma-weighted area of a whole dot [px^2].  uneven: how unlike its two sides are, by noise.
    ringed: whether a bright ring surrounds them.  dark_below: luma under which dots without a colour lie; None where
    their colour finds them.  patch: areas of any shape, whose centroid is their place.
    """

    neutral: tuple[float, float]
    hue_rad: float
    saturation: float
    area_px: float
    radius_px: float
    ring_px: float
    weight: float = 0.0
    uneven: float = 0.02
    ringed: bool = True
    dark_below: float | None = None
    patch: bool = False

    @property
    def window_px(self) -> float:
        """Radius within which a dot is weighed: the middle of its ring."""
        return (self.radius_px + self.ring_px) / 2


@dataclass(frozen=True)
class Blobs:
    """Connected coloured areas: centre [px], area [px^2], and longest side of the bounding box [px]."""

    px: Points
    area_px: Float[np.ndarray, "n"]
    side_px: Float[np.ndarray, "n"]


def find_blobs(mask: Bool[np.ndarray, "h2 w2"]) -> Blobs:
    """Connected areas of a half-resolution mask, in full-resolution pixels."""
    _, _, stats, centres = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    side = stats[1:, 2:4].max(1) if len(stats) > 1 else np.zeros(0)
    return Blobs(2 * centres[1:] + 0.5, 4.0 * stats[1:, cv2.CC_STAT_AREA], 2.0 * side)


def colour_mask(frame: Frame, look: DotLook) -> Bool[np.ndarray, "h2 w2"]:
    """Where the picture has the dots' hue, and more than half of their saturation; or is as dark as they are."""
    if look.dark_below is not None:
        return _halved(frame) < look.dark_below
    c, s = float(np.cos(look.hue_rad)), float(np.sin(look.hue_rad))
    cb0, cr0 = look.neutral
    along = cv2.addWeighted(frame.cb, c, frame.cr, s, -(c * cb0 + s * cr0))
    across = cv2.addWeighted(frame.cb, -s, frame.cr, c, 128 + s * cb0 - c * cr0)
    return (along > 0.5 * look.saturation) & (np.abs(across.astype(np.int16) - 128) < 0.45 * look.saturation)


def radial_profile(luma: np.ndarray, px: Points, radii: Float[np.ndarray, "r"]) -> Float[np.ndarray, "n angle r"]:
    """Luma along rays from each point, interpolated linearly."""
    u = px[:, 0, None, None] + np.cos(ANGLES)[:, None] * radii
    v = px[:, 1, None, None] + np.sin(ANGLES)[:, None] * radii
    return light_at(luma, u, v)


def _halved(frame: Frame) -> UInt8[np.ndarray, "h2 w2"]:
    """Luma at the resolution of the colours."""
    return np.asarray(cv2.resize(frame.luma, frame.cb.shape[::-1], interpolation=cv2.INTER_AREA), np.uint8)


def _darker(frame: Frame) -> Bool[np.ndarray, "h2 w2"]:
    """Where the picture is darker than round about."""
    luma = _halved(frame)
    side = 2 * (min(luma.shape) // 16) + 1
    return luma + MIN_CONTRAST < cv2.blur(luma, (side, side))


def learn_look(frame: Frame, expected: int, hint_px: Points | None = None, dark: bool = False) -> DotLook:
    """Measure the dots of a clip in one picture.

    expected: dots in the drawing; where several colours are seen, the one whose number is nearest counts.
    hint_px: points known to lie on dots (clicks), which settle the colour.  dark: they have none, and are found as dark
    spots on lighter ground.
    Raises TrackingError when nothing looks like a dot.
    """
    if frame.luma.max() < DARKNESS:
        raise TrackingError("The first picture is dark. Start where the mechanism is seen: --from SECONDS.")
    cb, cr = frame.cb.astype(np.float32), frame.cr.astype(np.float32)
    neutral = float(np.median(cb)), float(np.median(cr))
    colour = np.hypot(cb - neutral[0], cr - neutral[1])
    blobs = find_blobs(_darker(frame) if dark else colour > MIN_COLOUR)
    round_ = blobs.area_px > 0.5 * np.pi / 4 * blobs.side_px**2
    sized = (blobs.area_px >= 16) & (blobs.area_px < LARGEST * frame.luma.size)
    px, area = blobs.px[round_ & sized], blobs.area_px[round_ & sized]
    ringed = np.array([_has_ring(frame.luma, p, a) for p, a in zip(px, area, strict=True)], bool)
    px, area = px[ringed], area[ringed]
    if len(px) == 0:
        raise TrackingError(
            f"No marker found in the first picture: {len(blobs.px)} {'dark' if dark else 'coloured'} areas, none a "
            "round dot darker than its surroundings. Put saturated dots on white rings (dot at least 8 pixels across), "
            'light them evenly and keep the exposure short. Of a clip as it is: {"marker": "dark"} in --targets '
            'follows black dots, {"marker": "texture"} what is printed there, and --from starts it later.'
        )
    at = np.clip(np.round(px / 2).astype(int), 0, np.array(cb.shape)[::-1] - 1)
    hue = np.arctan2(cr[at[:, 1], at[:, 0]] - neutral[1], cb[at[:, 1], at[:, 0]] - neutral[0])
    saturation = colour[at[:, 1], at[:, 0]]
    groups = _size_groups(area) if dark else _hue_groups(hue)
    if hint_px is not None and len(hint_px):
        near = np.hypot(*(px[:, None] - hint_px[None]).transpose(2, 0, 1)).argmin(0)
        group = max(groups, key=lambda g: len(np.intersect1d(g, near)))
    else:
        group = min(groups, key=lambda g: (abs(len(g) - expected), -saturation[g].mean()))
    mean_hue = float(np.angle(np.exp(1j * hue[group]).mean()))
    size = float(np.sqrt(np.median(area[group]) / np.pi))
    rough = DotLook(neutral, mean_hue, float(np.median(saturation[group])), 0.0, size, 1.5 * size)
    radius, ring = _edges(frame.luma, px[group], size)
    rays = radial_profile(frame.luma, px[group], np.array([0.5 * radius, (radius + ring) / 2]))
    if dark:
        rough = replace(rough, dark_below=float(np.median(rays)))
    final = find_blobs(colour_mask(frame, rough))
    near = np.hypot(*(final.px[:, None] - px[group][None]).transpose(2, 0, 1)) < size
    own = np.where(near, final.area_px[:, None], 0).max(0, initial=0)  # a glossy ball's crumbs are not its area
    area_px = float(np.median(own[own > 0])) if own.any() else float(np.median(area[group]))
    contrast = np.maximum(np.median(rays[..., 1] - rays[..., 0], axis=1), MIN_CONTRAST)
    ringed = bool(np.median(rays[..., 1].std(1) / contrast) < ALL_ROUND)
    return replace(rough, area_px=area_px, radius_px=radius, ring_px=ring, ringed=ringed)


def learn_patch(frame: Frame, hint_px: Points) -> DotLook:
    """The colour and size of the areas that were clicked, of whatever shape.

    Raises TrackingError where nothing was clicked, or what was has no colour of its own, or not one.
    """
    if not len(hint_px):
        raise TrackingError("A patch of colour is known by a click: give --clicks, for one marker at least.")
    neutral = float(np.median(frame.cb)), float(np.median(frame.cr))
    size = np.array(frame.cb.shape)[::-1]
    at = np.clip(np.round(hint_px / 2).astype(int), 2, size - 3)
    seen = [[np.median(c[v - 2 : v + 3, u - 2 : u + 3]) for c in (frame.cb, frame.cr)] for u, v in at]
    each = np.array(seen) - neutral
    off, faint = np.median(each, axis=0), np.hypot(*each.T) < MIN_COLOUR
    if np.hypot(*off) < MIN_COLOUR and faint.any():
        u, v = hint_px[faint][0]
        raise TrackingError(
            f"The click at ({u:.0f}, {v:.0f}) is on no colour that stands out from the "
            'picture\'s own; click a coloured patch, or follow what is printed there ("texture").'
        )
    look = DotLook(neutral, float(np.arctan2(off[1], off[0])), float(np.hypot(*off)), 0.0, 0.0, 0.0, patch=True)
    _, areas, stats, _ = cv2.connectedComponentsWithStats(colour_mask(frame, look).astype(np.uint8), connectivity=8)
    own = np.asarray(areas, int)[at[:, 1], at[:, 0]]
    if not own.any():
        clicked = ", ".join(f"({u:.0f}, {v:.0f})" for u, v in hint_px)
        raise TrackingError(
            f"No area that was clicked has the colour that is half-way between those at {clicked}. Click patches of "
            "one colour, each in its middle; a clip is measured by one colour alone."
        )
    area_px = 4.0 * float(np.median(stats[own[own > 0], cv2.CC_STAT_AREA]))
    radius = float(np.sqrt(area_px / np.pi))
    return replace(look, area_px=area_px, radius_px=radius, ring_px=1.5 * radius)


def _has_ring(luma: np.ndarray, px: np.ndarray, area: float) -> bool:
    """Whether the surroundings are brighter than the disc on at least three quarters of the way round."""
    size = np.sqrt(area / np.pi)
    rays = radial_profile(luma, px[None], np.linspace(0, 2 * size, 25))[0]
    core = np.median(rays[:, :8])
    return bool((rays[:, 10:].max(1) > core + MIN_CONTRAST).mean() >= 0.75)


def _hue_groups(hue: Float[np.ndarray, "n"]) -> list[np.ndarray]:
    """Indices of dots whose hues follow each other without a gap, round the colour circle."""
    order = np.argsort(hue)
    step = np.diff(np.r_[hue[order], hue[order[0]] + 2 * np.pi])
    cuts = np.flatnonzero(step > np.deg2rad(HUE_GAP_DEG))
    if len(cuts) == 0:
        return [order]
    return np.split(np.roll(order, -(cuts[0] + 1)), np.diff(cuts).cumsum())


def _size_groups(area_px: Float[np.ndarray, "n"]) -> list[np.ndarray]:
    """Indices of dots whose areas follow each other without a gap."""
    order = np.argsort(area_px)
    return np.split(order, np.flatnonzero(np.diff(np.log(area_px[order])) > np.log(SIZE_GAP)) + 1)


def _edges(luma: np.ndarray, px: Points, size: float) -> tuple[float, float]:
    """Radius of the dot and of the ring's outer edge [px], from the mean profile of all dots."""
    radii = np.arange(0, 2.4 * size + 2, 0.25)
    mean = np.median(radial_profile(luma, px, radii), axis=1).mean(0)
    core = mean[radii < 0.5 * size].mean()
    near = (radii > 0.8 * size) & (radii < 1.8 * size + 1)
    peak = int(np.flatnonzero(near)[np.argmax(mean[near])])
    contrast = mean[peak] - core
    radius = float(radii[:peak][mean[:peak] < core + contrast / 2].max(initial=0.5 * size))
    fallen = np.flatnonzero(mean[peak:] < mean[peak] - 0.12 * contrast)
    ring = float(radii[peak + fallen[0]]) if len(fallen) else 1.5 * radius
    return radius, float(np.clip(ring, radius + 2, 1.8 * radius + 2))
