"""A marker that flutters: a shift at one frequency.

A loose sticker swings in every run at the same rate and moves nothing else. Bumps in time fine enough to follow a fast
one would cost thousands of columns, and left out it passes for noise with a memory; bumps that follow a slow one are
many for what a sine and a cosine say, and evidence counts them all.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.stats import chi2

from backend.diagnose.bumps import bumps_at
from backend.diagnose.fitted import Fitted
from backend.diagnose.probe import Probe
from backend.diagnose.seer import Seer
from backend.fit.measured import AXES

SURE = 1e-6  # probability from noise alone, of all markers and frequencies together
SLOWEST = 2.0  # periods in the longest record
FOLLOWED, FASTEST = 0.5, 0.4  # of the bumps' rate: what is slower they follow; of the samples'
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
    slow, fast = _frequencies(fitted)
    tried = max(slow.size + fast.size, 1) * len(markers)
    found: dict[str, tuple[float, float]] = {}
    for hz, noise_of, beside in ((slow, _loudest_other, _bend), (fast, _usual, _bumps)):
        power = {m: p for m in markers if hz.size and (p := _power(fitted, m, hz, beside)).free}
        for marker, own in power.items():
            noise = noise_of(own, [p for m, p in power.items() if m != marker])
            if noise is None:
                continue
            over = own.of / np.maximum(noise, 1.0)
            best = int(np.argmax(over))
            if tried * chi2.sf(over[best], own.free) < SURE:
                found[marker] = max(found.get(marker, (0.0, 0.0)), (float(over[best]), float(hz[best])))
    return {marker: hz for marker, (_, hz) in found.items()}


def _loudest_other(own: Power, others: Sequence[Power]) -> Float[np.ndarray, " frequencies"] | None:
    """Where whatever is missing may be as slow: a sticker's own is what no other marker has at all."""
    return np.max([p.loud for p in others], axis=0) if others else None


def _usual(own: Power, others: Sequence[Power]) -> Float[np.ndarray, " frequencies"] | None:
    """How loud noise is about each frequency; what all markers lack is no sticker's."""
    n = own.of.size
    if n < WINDOW:
        return None
    noise = np.array([np.median(own.loud[max(i - WINDOW, 0) : i + WINDOW + 1]) for i in range(n)])
    return np.maximum(noise, np.median([p.loud for p in others], axis=0)) if others else noise


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


def _frequencies(fitted: Fitted) -> tuple[Float[np.ndarray, " slow"], Float[np.ndarray, " fast"]]:
    """Those that bumps in time follow, and those that they do not."""
    longest = max(p.duration_s for p in fitted.probes) * fitted.fraction
    rate = min(1.0 / float(np.median(np.diff(np.unique(p.data.time_s)))) for p in fitted.probes)
    edge = FOLLOWED * max((p.bumps.shape[1] - 1) / p.duration_s for p in fitted.probes)
    apart = 1.0 / (FINE * longest)
    return np.arange(SLOWEST / longest, edge, apart), np.arange(edge, FASTEST * rate, apart)


def _bumps(time: Float[np.ndarray, " n"], probe: Probe) -> Float[np.ndarray, "n columns"]:
    return bumps_at(time, probe.duration_s, probe.bumps.shape[1])


def _bend(time: Float[np.ndarray, " n"], probe: Probe) -> Float[np.ndarray, "n columns"]:
    """What a drift does over a record."""
    return (time[:, None] / probe.duration_s) ** np.arange(3)


def _power(
    fitted: Fitted,
    marker: str,
    hz: Float[np.ndarray, " frequencies"],
    beside: Callable[[np.ndarray, Probe], Float[np.ndarray, "n columns"]],
) -> Power:
    """What waves take of the whitened rows beyond what slower shifts beside them take."""
    seer = Seer(fitted.subject, fitted.probes, fitted.fraction)
    total, free = np.zeros(hz.size), 0
    for p, white, rows in zip(fitted.probes, seer.white, fitted.rows, strict=True):
        r, channel, time = fitted.r[rows], p.data.channel[white.keep], p.since_release_s[white.keep]
        for c, of in enumerate(p.data.channels):
            at = np.flatnonzero((channel == c) & (time > 0.0)) if of.at == marker else np.zeros(0, int)
            if at.size < 2 * p.bumps.shape[1]:
                continue
            Q = np.linalg.qr(beside(time[at], p))[0]
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
