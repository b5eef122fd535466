"""Noise that neither tables nor still frames tell, sized by what nothing smooth explains.

Third differences take what lasts several samples for motion: of an error of which seven tenths are left in the next
sample they see less than half, and what they miss looks like a gap. What is left beside all smooth forces and shifts is
taken for noise where it fades as an AR(1) series does; a misfit lasts longer.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from backend.diagnose.fitted import Fitted
from backend.diagnose.latent import Latent, left_over
from backend.diagnose.memory import Memory
from backend.diagnose.noise import ALIKE, kind_of
from backend.diagnose.noise_learnt import CALM, MANY
from backend.diagnose.seer import Seer
from backend.diagnose.subject import Subject

FADES = (0.2, 0.85)  # how much of a tracker's error may be left in the next sample
LAGS = (2, 3)  # samples over which correlation has to be what that over one foretells
AS_ONE = 0.12  # to within this: smooth forces and shifts take the slowest of the noise with them


def size_up(fitted: Fitted, latent: Latent) -> bool:
    """Better the size and memory of such noise, of all experiments; false where all is told, calm, or no noise."""
    left = left_over(fitted, latent)
    if float(np.mean(left**2)) < CALM:
        return False
    channels = [c for p in fitted.probes for c in p.data.channels]
    told = {*fitted.subject.noise.memory, *(kind_of(c) for c in channels if c.noise == "given")}
    changed = False
    for kind in {kind_of(c) for c in channels} - told:
        series = _series(fitted, left, kind)
        every = [s for parts in series.values() for s in parts]
        one, *more = (_correlation(every, lag) for lag in (1, *LAGS))
        fades = FADES[0] < one < FADES[1] and all(abs(a - one**lag) < AS_ONE for lag, a in zip(LAGS, more, strict=True))
        if fades and sum(s.size for s in every) > MANY:
            fitted.subject.noise.memory[kind] = Memory(one)  # the held-out experiments' noise has the same memory
            _resize(fitted.subject, kind, {name: np.concatenate(parts) for name, parts in series.items()})
            changed = True
    return changed


def _series(fitted: Fitted, left: Float[np.ndarray, " n"], kind: str) -> dict[str, list[Float[np.ndarray, " samples"]]]:
    """What is left of each coordinate of a kind, in its unit, as stretches without a gap."""
    seer, found = Seer(fitted.subject, fitted.probes, fitted.fraction), dict[str, list[np.ndarray]]()
    for p, white, rows, sigma in zip(fitted.probes, seer.white, seer.rows, fitted.subject.noise.sigma, strict=True):
        off, channel, time = left[rows] * sigma[white.keep], p.data.channel[white.keep], p.data.time_s[white.keep]
        for c, of in enumerate(p.data.channels):
            at = np.flatnonzero(channel == c)
            if kind_of(of) == kind and at.size > 1:
                gaps = np.diff(time[at])
                parts = np.split(off[at], np.flatnonzero(gaps > 1.5 * np.median(gaps)) + 1)
                found.setdefault(of.at + of.coordinate, []).extend(s for s in parts if s.size > max(LAGS))
    return {name: parts for name, parts in found.items() if parts}


def _correlation(series: Sequence[Float[np.ndarray, " samples"]], lag: int) -> float:
    both = sum(float(s[lag:] @ s[:-lag]) for s in series) / max(sum(s.size - lag for s in series), 1)
    return both / max(sum(float(s @ s) for s in series) / max(sum(s.size for s in series), 1), 1e-300)


def _resize(subject: Subject, kind: str, left: Mapping[str, Float[np.ndarray, " samples"]]) -> None:
    """Sigmas of a kind by what is left of it, one for all where coordinates are alike."""
    own = {name: float(np.sqrt(np.mean(off**2))) for name, off in left.items()}
    shared = float(np.sqrt(np.mean(np.concatenate(list(left.values())) ** 2)))
    alike = max(own.values()) < ALIKE * min(own.values())
    sigmas = (*subject.noise.sigma, *subject.held_noise.sigma)
    for probe, sigma in zip((*subject.fit, *subject.held_out), sigmas, strict=True):
        for c, of in enumerate(probe.data.channels):
            if kind_of(of) == kind:
                sigma[probe.data.channel == c] = shared if alike else own.get(of.at + of.coordinate, shared)
