"""What a camera and its clock make of a motion, and the noise on top.

The camera looks along +y at the world's origin with x to its right and z up: scale, turn, keystone and lens distortion
are about that point.  Its clock counts from the release: true time = stated time / (1 + frame_rate) + time_offset.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from backend.blind.withheld.laws import Laws

DISTANCE = 4.0  # of the camera from the plane, over the rig's size
PICTURE = 1.3  # its height, over twice the rig's size


@dataclass(frozen=True)
class Noise:
    """sigma_m: of a coordinate; rho: correlation of frames; outliers, missing: shares; told: in the file."""

    sigma_m: float
    rho: float
    outliers: float
    missing: float
    told: bool


class Path(Protocol):
    """Where markers truly are, whoever moved them."""

    def markers(self, time_s: np.ndarray) -> np.ndarray:
        """(rows, times, markers), complex [m], at times since the release (rows, times)."""
        ...


def seen(path: Path, laws: Laws, size: float, since_release_s: np.ndarray, elapsed_s: np.ndarray) -> np.ndarray:
    """Marker places as reported (rows, times, markers), complex [m], without noise.

    since_release_s, elapsed_s: stated times since the release and since the record began (rows, times).
    """
    true = true_time(laws, since_release_s)
    p = path.markers(np.maximum(true, 0.0))
    if laws.has("readout"):
        p = _rolled(path, laws, true, p, size)
    return reported(laws, p, since_release_s, elapsed_s, size)


def true_time(laws: Laws, since_release_s: np.ndarray) -> np.ndarray:
    """Time since the motion truly began (rows, times); negative while it is held."""
    return since_release_s / (1 + laws.frame_rate[:, None]) + (laws.time_offset - laws.delay)[:, None]


def reported(laws: Laws, p: np.ndarray, since_release_s: np.ndarray, elapsed_s: np.ndarray, size: float) -> np.ndarray:
    """The picture of true places p (rows, times, markers) [m]."""
    flutter = 2 * np.pi * laws.wobble_hz[:, None] * np.maximum(since_release_s, 0.0)[:, :, None]
    moving = (since_release_s > 0)[:, :, None]
    p = p + laws.wobble[:, None] * np.sin(flutter + laws.wobble_phase[:, None]) * (1 + 0.5j) * moving
    one = [name[:, None, None] for name in (laws.scale, laws.turn, laws.pitch, laws.yaw, laws.k1)]
    scale, turn, pitch, yaw, k1 = one
    p = p / (1 + (yaw * np.real(p) + pitch * np.imag(p)) / (DISTANCE * size))
    p = p * (1 + k1 * np.abs(p) ** 2) * (1 + scale) * np.exp(1j * turn)
    return p + laws.drift[:, None] * elapsed_s[:, :, None]


def _rolled(path: Path, laws: Laws, true: np.ndarray, p: np.ndarray, size: float) -> np.ndarray:
    """The same points, each at the time its own row of the picture is read, top row first."""
    row = np.clip(0.5 - np.imag(p) / (2 * PICTURE * size), 0.0, 1.0)
    half, whole = (path.markers(np.maximum(true + share * laws.readout[:, None], 0.0)) for share in (0.5, 1.0))
    return p * (2 * row - 1) * (row - 1) + half * 4 * row * (1 - row) + whole * row * (2 * row - 1)


def noisy(clean: np.ndarray, noise: Noise, rng: np.random.Generator) -> np.ndarray:
    """Clean places (times, markers) with correlated noise and outliers; nan where a marker was not found."""
    times, markers = clean.shape
    fresh = rng.standard_normal((times, markers, 2)) @ np.array([1, 1j])
    errors = np.empty((times, markers), complex)
    errors[0] = fresh[0]
    for t in range(1, times):
        errors[t] = noise.rho * errors[t - 1] + np.sqrt(1 - noise.rho**2) * fresh[t]
    places = clean + noise.sigma_m * errors
    wild = rng.random((times, markers)) < noise.outliers
    throw = rng.uniform(6, 25, (times, markers)) * np.exp(2j * np.pi * rng.random((times, markers)))
    places = places + np.where(wild, noise.sigma_m * throw, 0.0)
    lost = rng.random((times, markers)) < noise.missing
    # A marker is also hidden for a while now and then: a hand, a cable, a link in front.
    for m in range(markers):
        if rng.random() < 0.15:
            start, span = int(rng.integers(20, max(times - 12, 21))), int(rng.integers(3, 12))
            lost[start : start + span, m] = True
    return np.where(lost, complex(np.nan, np.nan), places)
