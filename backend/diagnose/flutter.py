"""A marker that flutters: a shift at one frequency, faster than bumps in time can follow.

A loose sticker swings in every run at the same rate and moves nothing else. Bumps fine enough to follow it would cost
thousands of columns, and left out it passes for noise with a memory.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.stats import chi2

from backend.diagnose.fitted import Fitted, Seer
from backend.diagnose.subject import bumps_at
from backend.fit.measured import AXES

SURE = 1e-6  # probability from noise alone, of all markers and frequencies together
SLOWEST, FASTEST = 0.5, 0.4  # of the bumps' rate; of the samples'
FINE = 2.0  # frequencies tried for each that the longest record tells apart
WINDOW = 12  # frequencies to either side that say how loud noise is


@dataclass(frozen=True)
class Power:
    """Of what is left at one marker, at each frequency [noise variances], and how many numbers it is a sum of."""

    of: Float[np.ndarray, " frequencies"]
    free: int

    @property
    def loud(self) -> Float[np.ndarray, " frequencies"]:
        """A number's share of it."""
        return self.of / self.free


def flutters(fitted: Fitted, markers: Sequence[str]) -> dict[str, float]:
    """Frequency [Hz] of every one of these (`marker:ID`) that flutters."""
    hz = _frequencies(fitted)
    if hz.size < WINDOW:
        return {}
    power = {m: p for m in markers if (p := _power(fitted, m, hz)).free}
    found = {}
    for marker, own in power.items():
        near = [own.loud[max(i - WINDOW, 0) : i + WINDOW + 1] for i in range(hz.size)]
        noise = np.array([np.median(n) for n in near])
        if others := [p.loud for m, p in power.items() if m != marker]:
            noise = np.maximum(noise, np.median(others, axis=0))  # what all of them lack is no sticker's
        chance = chi2.sf(own.of / np.maximum(noise, 1.0), own.free)
        best = int(np.argmin(chance))
        if chance[best] * hz.size * len(power) < SURE:
            found[marker] = float(hz[best])
    return found


def waves(fitted: Fitted, marker: str, hz: float) -> list[Float[np.ndarray, "rows columns"]]:
    """Whitened columns of each run: sine and cosine along each axis, from the release on."""
    seer = Seer(fitted.subject, fitted.probes, fitted.fraction)
    made = []
    for p, white in zip(fitted.probes, seer.white, strict=True):
        both = _turning(p.since_release_s, np.array([hz]))
        both[p.data.still] = 0.0
        own = [np.array([c.at == marker and c.coordinate == a for c in p.data.channels])[p.data.channel] for a in AXES]
        made.append(np.concatenate([white(both * of[:, None]) for of in own if of.any()] or [white(both * 0.0)], 1))
    return made


def _frequencies(fitted: Fitted) -> Float[np.ndarray, " frequencies"]:
    longest = max(p.duration_s for p in fitted.probes) * fitted.fraction
    rate = min(1.0 / float(np.median(np.diff(np.unique(p.data.time_s)))) for p in fitted.probes)
    bumps = max((p.bumps.shape[1] - 1) / p.duration_s for p in fitted.probes)
    return np.arange(SLOWEST * bumps, FASTEST * rate, 1.0 / (FINE * longest))


def _power(fitted: Fitted, marker: str, hz: Float[np.ndarray, " frequencies"]) -> Power:
    """What waves take of the whitened rows beyond what bumps in time take."""
    seer = Seer(fitted.subject, fitted.probes, fitted.fraction)
    total, free = np.zeros(hz.size), 0
    for p, white, rows in zip(fitted.probes, seer.white, fitted.rows, strict=True):
        r, channel, time = fitted.r[rows], p.data.channel[white.keep], p.since_release_s[white.keep]
        for c, of in enumerate(p.data.channels):
            at = np.flatnonzero((channel == c) & (time > 0.0)) if of.at == marker else np.zeros(0, int)
            if at.size < 2 * p.bumps.shape[1]:
                continue
            Q = np.linalg.qr(bumps_at(time[at], p.duration_s, p.bumps.shape[1]))[0]
            W = _turning(time[at], hz)
            W, left = W - Q @ (Q.T @ W), r[at] - Q @ (Q.T @ r[at])
            s, k = W[:, : hz.size], W[:, hz.size :]
            ss, kk, sk = np.sum(s * s, 0), np.sum(k * k, 0), np.sum(s * k, 0)
            a, b = s.T @ left, k.T @ left
            total += (kk * a * a - 2.0 * sk * a * b + ss * b * b) / np.maximum(ss * kk - sk * sk, 1e-9 * ss * kk)
            free += 2
    return Power(total, free)


def _turning(time: Float[np.ndarray, " n"], hz: Float[np.ndarray, " f"]) -> Float[np.ndarray, "n waves"]:
    """Sines, then cosines."""
    angle = 2.0 * np.pi * time[:, None] * hz
    return np.concatenate([np.sin(angle), np.cos(angle)], 1)
