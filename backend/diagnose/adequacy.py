"""Whether a cause leaves nothing smooth behind: the omnibus tests, and how large what it leaves is."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from backend.diagnose.fitted import Fitted
from backend.diagnose.latent import Latent, basis, omnibus


@dataclass(frozen=True)
class Adequacy:
    """p: of the smallest omnibus test, Bonferroni over places. excess: power of what unknown forces and shifts still
    explain [noise variances per sample], with its upper 97.5% limit. noise: rms of what nothing explains [sigmas].
    """

    p: float
    excess: float
    upper: float
    noise: float

    @property
    def power(self) -> float:
        """The excess in variances of the noise as it was believed: between two causes only this compares, because
        what a lost motion leaves passes for noise.
        """
        return max(self.excess, 0.0) * max(self.noise, 1.0) ** 2


def scaled(fitted: Fitted, scale: float) -> Fitted:
    """The same fit, had all sigmas been larger by `scale`."""
    return replace(fitted, r=fitted.r / scale, J=fitted.J / scale)


def adequacy(fitted: Fitted, latent: Latent, rng: np.random.Generator) -> Adequacy:
    """Of a fit, with the responses about it or about one that moves alike."""
    explained, rank = _explained(fitted, latent)
    noise = np.sqrt(max(fitted.chi2 - explained, 0.0) / max(fitted.r.size - rank, 1))
    scale = max(noise, 1.0)
    own = scaled(fitted, scale)
    places = [latent.scaled(p) / scale for p in latent.places]
    tests = [omnibus(own.r, own.free, own.precision, L, rng) for L in places]
    free = max(rank - fitted.x.size, 1)
    through = explained / scale**2
    tests.append(float(chi2.sf(through, free)))
    # Noise alone would be explained to `free`; a signal adds its power, and a wider spread.
    n = fitted.r.size
    excess = (through - free) / n
    upper = excess + 2.0 * np.sqrt(2.0 * free + 4.0 * max(through - free, 0.0)) / n
    return Adequacy(min(1.0, len(tests) * min(tests)), float(excess), float(upper), float(noise))


def _explained(fitted: Fitted, latent: Latent) -> tuple[float, int]:
    """Sum of squares that fit, forces and shifts together take away, and how many directions they span."""
    A, R = basis(fitted, latent)
    score = R.T @ (A.T @ fitted.r)
    return float(score @ score), R.shape[1]
