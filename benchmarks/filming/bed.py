"""The bed's print, as a map of what it reflects: grain, a grid, tags, stickers."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float

from benchmarks.filming.scene import BED_TAGS, TAG_SIDE_M, Scene

Array = np.ndarray
TEXEL_M = 2.5e-4
HALF_M = (0.42, 0.26)
PAPER, INK = 0.82, 0.025


def tag_cells(tag: int) -> Float[Array, "10 10"]:
    """What a tag of AprilTag 36h11 reflects, cell by cell, with its white margin."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36H11)
    white = cv2.aruco.generateImageMarker(dictionary, tag, 8, borderBits=1) > 0
    return np.pad(np.where(white, PAPER, INK), 1, constant_values=PAPER).astype(np.float32)


def printed(scene: Scene) -> Float[Array, "h w 3"]:
    """Reflectance on a grid of TEXEL_M, row 0 at y = +HALF_M[1], column 0 at x = -HALF_M[0]."""
    rng = np.random.default_rng(1000 + scene.seed)
    w, h = (round(2 * half / TEXEL_M) for half in HALF_M)
    x = (np.arange(w, dtype=np.float32) + 0.5) * TEXEL_M - HALF_M[0]
    y = HALF_M[1] - (np.arange(h, dtype=np.float32) + 0.5) * TEXEL_M
    grain = cv2.GaussianBlur(rng.normal(0, 1, (h, w)).astype(np.float32), (0, 0), 40, sigmaY=3)
    fine = cv2.GaussianBlur(rng.normal(0, 1, (h, w)).astype(np.float32), (0, 0), 3)
    level = 0.50 * (1 + 0.10 * grain / grain.std() + 0.05 * fine / fine.std())
    for lines, axis in ((x, 0), (y, 1)):
        away = np.abs((lines + 0.01) % 0.02 - 0.01) - 0.0002
        cover = np.clip(0.5 - away / TEXEL_M, 0, 1)
        level *= 1 - 0.2 * (cover[None] if axis == 0 else cover[:, None])
    picture = level[..., None] * np.array([1.0, 0.93, 0.82], np.float32)  # pale wood
    for sticker in scene.stickers:
        r = np.hypot(x[None] - sticker.at_m[0], y[:, None] - sticker.at_m[1])
        ring = (1.5 * sticker.radius_m, (PAPER,) * 3)
        for radius, colour in (
            (ring, (sticker.radius_m, sticker.colour)) if sticker.ringed else ((sticker.radius_m, sticker.colour),)
        ):
            cover = np.clip(0.5 - (r - radius) / TEXEL_M, 0, 1)[..., None]
            picture = picture * (1 - cover) + np.array(colour, np.float32) * cover
    for tag, (cx, cy) in BED_TAGS.items():
        cells, cell = tag_cells(tag), TAG_SIDE_M / 8
        fine_side = round(cell / TEXEL_M) * len(cells)
        column = round((cx + HALF_M[0]) / TEXEL_M) - fine_side // 2
        row = round((HALF_M[1] - cy) / TEXEL_M) - fine_side // 2
        block = np.kron(cells, np.ones((fine_side // len(cells),) * 2))
        picture[row : row + fine_side, column : column + fine_side] = block[..., None]
    return picture


def lookup(atlas: Float[Array, "h w 3"], xy_m: Float[Array, "h w 2"]) -> Float[Array, "h w 3"]:
    """What the bed reflects at points on it."""
    u = ((xy_m[..., 0] + HALF_M[0]) / TEXEL_M - 0.5).astype(np.float32)
    v = ((HALF_M[1] - xy_m[..., 1]) / TEXEL_M - 0.5).astype(np.float32)
    return cv2.remap(atlas, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
