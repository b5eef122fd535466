"""What the baseline's fit tells of the noise: its memory from all frames, and samples that nothing smooth explains."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from backend.diagnose.fitted import Fitted
from backend.diagnose.latent import Latent, left_over, neighbour_correlation, studentised
from backend.diagnose.memory import Memory, Series, bettered
from backend.diagnose.noise import ENOUGH, drop, kind_of, numbered, places, strays
from backend.diagnose.seer import Seer

CALM = 1.7  # mean square of what is left: beyond it a misfit, not noise, is left
MANY = 500  # neighbouring samples from which memory is bettered
LITTLE = 1.2  # noise variances a sample: what the drawing leaves where nearly all of it is noise
OPEN = 2.5  # sd of the memory that still frames tell (Bartlett 1946), by which it may be bettered


def remember(fitted: Fitted, latent: Latent) -> bool:
    """Better the noise's memory from all frames: still ones are few, and a little memory looks like slow forces. As far
    as still ones leave it open: what the drawing misses has a memory, too.
    """
    left = left_over(fitted, latent)
    if not 0.5 < float(np.mean(left**2)) < CALM:
        return False
    seer = Seer(fitted.subject, fitted.probes, fitted.fraction)
    kinds = {kind_of(c) for p in fitted.probes for c in p.data.channels}
    changed = False
    memory = fitted.subject.noise.memory
    for kind in kinds:
        known = memory.get(kind, Memory())
        if known.share < 1.0:  # neighbours tell less than series do
            changed = (fitted.chi2 < LITTLE * fitted.r.size and _bettered(fitted, kind, known)) or changed
            continue
        follows, still = np.zeros(fitted.r.size, bool), 0
        for p, white, rows in zip(fitted.probes, seer.white, seer.rows, strict=True):
            channel, time = p.data.channel[white.keep], p.data.time_s[white.keep]
            of = np.array([kind_of(c) == kind for c in p.data.channels])[channel]
            still += int(np.sum(of & p.data.still[white.keep]))
            gap = np.diff(time)
            next_to = (np.diff(channel) == 0) & of[1:] & (gap < 1.5 * np.median(gap[gap > 0]))
            follows[rows.start + 1 : rows.stop] = next_to
        if follows.sum() < MANY:
            continue
        more = neighbour_correlation(fitted, latent, follows)
        if abs(more) > 2.0 / np.sqrt(follows.sum()):
            open_ = OPEN * np.sqrt((1.0 - known.coefficient**2) / still) if still >= ENOUGH else np.inf
            memory[kind] = Memory(float(np.clip(known.coefficient + np.clip(more, -open_, open_), 0.0, 0.97)))
            changed = True
    return changed


def _bettered(fitted: Fitted, kind: str, known: Memory) -> bool:
    """Better a memory beside a white part, and the sd that still frames have by it: a few frames about a mean of their
    own tell nothing slow, in which every gap lies.
    """
    subject, still, every = fitted.subject, _Off([], []), _Off([], [])
    for i, p in enumerate(fitted.probes):
        off = p.data.value - p.predict(fitted.values, fitted.own(i))[0]
        good = subject.noise.keep[i] & np.isfinite(off)
        for c in (c for c, channel in enumerate(p.data.channels) if kind_of(channel) == kind):
            for which, rows in ((every, good), (still, good & p.data.still)):
                which.add(off, p.data.time_s, np.flatnonzero(rows & (p.data.channel == c)))
    if still.size < ENOUGH:
        return False
    short, long = Series.of(*still), Series.of(*every)
    found = bettered(known, short, long, 0.5 * OPEN**2)
    if found == known:
        return False
    subject.noise.memory[kind] = found
    wider = short.sd(found) / short.sd(known)
    for p, sigma in zip(
        (*subject.fit, *subject.held_out), (*subject.noise.sigma, *subject.held_noise.sigma), strict=True
    ):
        own = np.array([kind_of(c) == kind and c.noise != "given" for c in p.data.channels])[p.data.channel]
        sigma[own] *= wider
    return True


class _Off(NamedTuple):
    """What is missed of each channel in each experiment, and when, in its sampling intervals."""

    series: list[np.ndarray]
    intervals: list[np.ndarray]

    def add(self, off: np.ndarray, time_s: np.ndarray, rows: np.ndarray) -> None:
        """Of one channel, where it has three samples."""
        if rows.size > 2:
            self.series.append(off[rows])
            self.intervals.append(time_s[rows] / np.median(np.diff(time_s[rows])))

    @property
    def size(self) -> int:
        """Number of samples."""
        return sum(s.size for s in self.series)


def set_aside(fitted: Fitted, latent: Latent) -> bool:
    """Drop samples that no smooth cause could bring near, a marker's coordinates together; false where there are none,
    or too many to be chance.
    """
    data = [p.data for p in fitted.probes]
    at = places(data, [w.keep for w in Seer(fitted.subject, fitted.probes, fitted.fraction).white])
    wrong = strays(studentised(fitted, latent), numbered(at))
    if not wrong.any() or wrong.mean() > 0.05:
        return False
    drop(data, fitted.subject.noise.keep, {at[k] for k in np.flatnonzero(wrong)})
    return True
