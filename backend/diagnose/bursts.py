"""Stretches of a few frames in which a marker was taken for something else: it jumps away, stays there and jumps back.

A single wild sample is missed by its neighbours; of several in a row each has wild neighbours, so all stretches are
tried. No model is asked: what counts of held-out experiments, and how large noise is, must not depend on one.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from backend.fit.measured import Measured
from backend.fit.noise import MAD_TO_SIGMA

LONGEST = 10  # frames: a longer stretch is a motion that no cubic bridges
SIDE = 4  # frames on each side of a stretch that foretell it
AWAY = 10.0  # widths of what a good stretch is missed by: each sample of a wild one is farther off
EVEN = 0.3  # of its farthest sample: none of a wild stretch is nearer; where a motion turns, its ends are
SMOOTH = 0.15  # of its nearest sample: what the frames beside a wild stretch miss the cubic by; a turn bends them
FEW = 0.5  # of the other markers: where as many jump, the mechanism did


def bursts(data: Measured, good: Bool[np.ndarray, " samples"]) -> Bool[np.ndarray, " samples"]:
    """Samples (mask) of markers that jumped away and back while most others did not. good: samples to go by."""
    wild = {}
    for at in dict.fromkeys(c.at for c in data.channels if c.at.startswith("marker:")):
        channels = [i for i, c in enumerate(data.channels) if c.at == at]
        of = [np.flatnonzero((data.channel == c) & good) for c in channels]
        times = data.time_s[of[0]]
        if all(np.array_equal(data.time_s[rows], times) for rows in of[1:]):
            wild[at] = set(times[jumps(times, np.stack([data.value[rows] for rows in of], 1))].tolist())
    found = np.zeros(good.size, bool)
    for at, times in wild.items():
        others = [t for other, t in wild.items() if other != at]
        mine = [t for t in times if not others or sum(t in o for o in others) < FEW * len(others)]
        rows = np.array([c.at == at for c in data.channels])[data.channel]
        found |= rows & np.isin(data.time_s, mine)
    return found


def jumps(time_s: Float[np.ndarray, " n"], place: Float[np.ndarray, "n axes"]) -> Bool[np.ndarray, " n"]:
    """Which samples of one path belong to stretches that stand away from the cubic through the frames beside them."""
    wild = np.zeros(time_s.size, bool)
    for size in range(2, LONGEST + 1):
        count = time_s.size - size - 2 * SIDE + 1
        if count < 1:
            break
        first = np.arange(count)[:, None]
        beside = first + np.r_[:SIDE, SIDE + size : 2 * SIDE + size]
        within = first + SIDE + np.arange(size)
        middle = time_s[beside].mean(1, keepdims=True)
        reach = np.abs(time_s[beside] - middle).max(1, keepdims=True)
        here, there = (((time_s[rows] - middle) / reach)[:, :, None] ** np.arange(4) for rows in (within, beside))
        cubic = np.linalg.pinv(there) @ place[beside]
        off = np.linalg.norm(place[within] - here @ cubic, axis=2)
        rest = np.linalg.norm(place[beside] - there @ cubic, axis=2)
        width = MAD_TO_SIGMA * float(np.median(off))
        nearest, farthest = off.min(1), off.max(1)
        jumped = (nearest > AWAY * width) & (nearest > EVEN * farthest) & (rest.max(1) < SMOOTH * nearest)
        wild[within[jumped].ravel()] = True
    return wild
