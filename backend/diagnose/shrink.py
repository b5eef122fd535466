"""How much of the gap a cause takes away where it was not fitted: on held-out experiments, started from their own first
frames alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from backend.diagnose.fitted import Fitted
from backend.diagnose.noise import Noise
from backend.diagnose.probe import Probe

BLOCKS = 6  # of a run: longer than the memory of any residual that a bootstrap should keep
RESAMPLES = 2000


@dataclass(frozen=True)
class Test:
    """One experiment under frozen values. miss: measured - predicted, samples that count. allowed: variance that noise
    and the uncertain start give each sample; values that are uncertain excuse nothing, or a vague cause would seem to
    foretell what it only does not rule out.
    """

    probe: Probe
    keep: np.ndarray
    miss: Float[np.ndarray, " n"]
    allowed: Float[np.ndarray, " n"]
    sigma: Float[np.ndarray, " n"]
    predicted: Float[np.ndarray, " samples"]

    @property
    def moving(self) -> np.ndarray:
        """Samples in motion; a motion that was lost counts by what was lost."""
        return ~self.probe.data.still[self.keep]


def held_out_tests(fitted: Fitted, scale: float) -> list[Test]:
    """All held-out experiments."""
    subject = fitted.subject

    def one(i: int) -> Test:
        probe = subject.chosen(subject.held_out[i], fitted.choice)
        return _test(probe, subject.held_noise, i, fitted.values, scale)

    return subject.over(one, range(len(subject.held_out)))


def _test(probe: Probe, noise: Noise, i: int, values: np.ndarray, scale: float) -> Test:
    keep = np.flatnonzero(noise.keep[i])
    own = probe.settle(values)
    seen, slope = probe.predict(values, own)
    sigma = scale * noise.sigma[i][keep]
    since = probe.since_release_s[keep]
    early = since <= probe.experiment.release.window_s if probe.moving else probe.data.still[keep]
    early = early if np.any(early) else since <= since.min()
    J = slope[keep]
    A = J[early][:, values.size :] / sigma[early][:, None]
    start = np.linalg.pinv(A.T @ A, hermitian=True) if A.shape[1] else np.zeros((0, 0))
    allowed = sigma**2
    if start.size:
        allowed = allowed + np.sum((J[:, values.size :] @ start) * J[:, values.size :], 1)
    return Test(probe, keep, probe.data.value[keep] - seen[keep], allowed, sigma, seen)


def gap_power(
    made: Sequence[Test], weights: Sequence[Float[np.ndarray, " n"]] | None = None
) -> Float[np.ndarray, "blocks 3"]:
    """Per block of time of every experiment: sum of squared misses, of noise variances [m² or rad²], and samples.

    weights: of the samples' squares in both sums. In metres of markers and slides, or angles where no experiment has
    any of those: squares of both have no sum.
    """
    units = [np.array([c.unit for c in t.probe.data.channels])[t.probe.data.channel[t.keep]] for t in made]
    unit = gap_unit(t.probe for t in made)
    blocks = []
    for t, mine, weight in zip(made, units, weights or [np.ones(len(t.keep)) for t in made], strict=True):
        since = t.probe.since_release_s[t.keep]
        end = max(float(since.max()), 1e-12)
        at = np.clip((BLOCKS * since / end).astype(int), 0, BLOCKS - 1)
        miss, allowed = weight * _missed(t) ** 2, weight * _floor(t)
        for b in range(BLOCKS):
            rows = t.moving & (at == b) & (mine == unit)
            if rows.any():
                blocks.append([np.sum(miss[rows]), np.sum(allowed[rows]), rows.sum()])
    return np.array(blocks).reshape(-1, 3)


def gap_unit(probes: Iterable[Probe]) -> str:
    """In which a gap is told: metres where anything was measured in them."""
    return "m" if any(c.unit == "m" for p in probes for c in p.data.channels) else "rad"


def _missed(t: Test) -> np.ndarray:
    """Misses; of a motion that was lost, how far the measured one has come from where it began."""
    channel, value = t.probe.data.channel[t.keep], t.probe.data.value[t.keep]
    begun = np.zeros(channel.max(initial=0) + 1)
    for c in np.unique(channel):
        begun[c] = value[channel == c][0]
    return np.where(np.isfinite(t.miss), t.miss, value - begun[channel])


def _floor(t: Test) -> np.ndarray:
    # A start that a chaotic motion blows up must not excuse everything: ten times the noise at most.
    return np.fmin(t.allowed, 100.0 * t.sigma**2)


@dataclass(frozen=True)
class Shrinkage:
    """Rms before, after and of noise [m, or rad], and the explained fraction of the gap's power with its 95% interval;
    null where there was no gap to explain.
    """

    before: float
    after: float
    noise: float
    explained: float | None
    ci95: tuple[float, float] | None
    excess_upper: float
    """Upper 97.5% limit of what remains beyond the noise, rms [m or rad]."""


def shrinkage(before: Sequence[Test], after: Sequence[Test], rng: np.random.Generator) -> Shrinkage | None:
    """Of two models on the same held-out experiments, by a bootstrap over blocks of time; None where nothing moves.

    Of the explained fraction a sample counts the less, the more noise and an uncertain start leave open of it under
    either model: late in a motion that enlarges its start nobody could foretell where it is.
    """
    a, b = gap_power(before), gap_power(after)
    if not len(a):
        return None
    pick = rng.integers(0, len(a), (RESAMPLES, len(a)))
    count = a[:, 2].sum()
    upper = float(np.sqrt(max(np.quantile(_beyond(b)[pick].sum(1), 0.975), 0.0) / count))
    was, now, noise = (float(np.sqrt(x / count)) for x in (a[:, 0].sum(), b[:, 0].sum(), a[:, 1].sum()))
    weights = [x.sigma**2 / np.fmax(_floor(x), _floor(y)) for x, y in zip(before, after, strict=True)]
    first, later = (_beyond(gap_power(made, weights)) for made in (before, after))
    gaps, rests = first[pick].sum(1), later[pick].sum(1)
    if first.sum() <= 0.0 or np.quantile(gaps, 0.025) <= 0.0:
        return Shrinkage(was, now, noise, None, None, upper)
    low, high = np.nanquantile(1.0 - rests / np.where(gaps > 0, gaps, np.nan), [0.025, 0.975])
    explained = min(1.0 - later.sum() / first.sum(), 1.0)
    return Shrinkage(was, now, noise, float(explained), (float(min(low, 1.0)), float(min(high, 1.0))), upper)


def _beyond(power: Float[np.ndarray, "blocks 3"]) -> Float[np.ndarray, " blocks"]:
    """Squared misses beyond the noise."""
    return power[:, 0] - power[:, 1]
