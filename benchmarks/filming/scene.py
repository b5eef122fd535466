"""What stands before the camera: targets, bed, light, what gets in the way."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from jaxtyping import Float

from benchmarks.filming.optics import Optics

Array = np.ndarray
Colour = tuple[float, float, float]
RED: Colour = (0.57, 0.02, 0.03)  # linear light of the kit's red ink on white paper
SKIN: Colour = (0.52, 0.30, 0.20)
GREY_CARD: Colour = (0.20, 0.20, 0.21)
TAG_SIDE_M = 0.040
STEADY = Optics()
BED_TAGS = {k: (0.27 * (k % 3 - 1), 0.148 * (1 - 2 * (k // 3))) for k in range(6)}


@dataclass(frozen=True)
class Sticker:
    """A disc lying still on the bed, ringed like the kit's dots or bare."""

    at_m: tuple[float, float]
    colour: Colour = RED
    radius_m: float = 0.004
    ringed: bool = True


@dataclass(frozen=True)
class Cover:
    """Something that comes between: capsules (x, y, x, y, radius) [m] about a point that moves, `height_m` up.

    path: time [s] -> (x, y) [m].
    """

    capsules: tuple[tuple[float, float, float, float, float], ...]
    path: Callable[[float], tuple[float, float]]
    colour: Colour = SKIN
    height_m: float = 0.045


def card(width_m: float, x0_m: float, speed_m_per_s: float) -> Cover:
    """A long card, `width_m` wide, its middle at x0 at time 0, that sweeps along x."""
    half = 0.4
    strips = np.linspace(-width_m / 2 + 0.01, width_m / 2 - 0.01, max(2, round(width_m / 0.015)))
    capsules = tuple((float(x), -half, float(x), half, 0.01) for x in strips)
    return Cover(capsules, lambda t: (x0_m + speed_m_per_s * t, 0.0), GREY_CARD)


def hand(x0_m: float, y0_m: float, vx: float, vy: float) -> Cover:
    """Four fingers, a palm and a forearm that reach in from below the picture; one nail is painted red."""
    fingers = tuple(
        (-0.03 + 0.02 * k, -0.02, -0.034 + 0.023 * k, 0.055 + 0.01 * (k in (1, 2)), 0.008) for k in range(4)
    )
    return Cover(
        (*fingers, (-0.012, -0.05, 0.012, -0.05, 0.034), (0.0, -0.1, 0.03, -0.5, 0.03)),
        lambda t: (x0_m + vx * t, y0_m + vy * t),
    )


def nail(of: Cover) -> Cover:
    """The painted nail of a hand's second finger."""
    x, y = of.capsules[1][2:4]
    return Cover(((x, y - 0.002, x, y + 0.002, 0.0045),), of.path, RED, of.height_m + 0.001)


@dataclass(frozen=True)
class Scene:
    """Everything of a clip but its motion.

    target: what is stuck on the pins.  drift: the light's change over a second.  flicker: at 100 Hz, relative.  cast:
    gains of red, green and blue.  read_noise and shot_noise: of linear light; 0.002 and 2.5e-4 give 2 codes.
    sharpening: what a camera adds at edges.  crf: of x264.
    """

    optics: Optics = STEADY
    rate: float = 240.0
    shutter_s: float = 1e-3
    target: Literal["ringed", "plain", "tag"] = "ringed"
    stickers: tuple[Sticker, ...] = ()
    covers: tuple[Cover, ...] = field(default=())
    drift: float = 0.0
    flicker: float = 0.01
    cast: Colour = (1.0, 1.0, 1.0)
    read_noise: float = 0.002
    shot_noise: float = 2.5e-4
    sharpening: float = 0.25
    crf: int = 18
    seed: int = 0

    def gain(self, time_s: float) -> Float[Array, "3"]:
        """The light's colour and strength at a time."""
        swing = 1 + self.drift * time_s + self.flicker * np.sin(2 * np.pi * 100 * time_s)
        return np.asarray(self.cast, np.float32) * np.float32(swing)
