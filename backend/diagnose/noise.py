"""What of a record is noise: its size, its memory from one sample to the next, and samples that are plainly wrong.

All of it from the records themselves, before any model: static frames where there are enough of them, otherwise the
sigma in the tables or third differences. Wrong samples are those that a cubic through their four neighbours misses, or
at the ends of a record a parabola along the last six; and stretches of them (`bursts.py`).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.linalg import solve_banded
from scipy.stats import chi2

from backend.diagnose.bursts import bursts
from backend.diagnose.memory import Memory, remembered
from backend.fit.measured import Channel, Measured
from backend.fit.noise import MAD_TO_SIGMA, ROUNDING, calm, quantum

ENOUGH = 60  # static samples of one kind of channel: its sd is then known to a tenth, its memory to 0.13
ALIKE = 1.7  # channels whose noise differs by less share one estimate
RARE = 3e-5  # probability of a good sample to be missed so far by a cubic through its neighbours
ROUNDS = 8
DRIFTS = 5.0  # sd of a rate that still frames of one channel share
STRAY = 4.3  # sd: a sample of a smooth record that nothing smooth explains
BETWEEN, BEFORE = np.array([-2, -1, 1, 2]), -np.arange(1, 7)  # neighbours of a sample; of one at an end


@dataclass(frozen=True)
class Whitening:
    """Linear map from the samples of one experiment to independent rows of unit noise.

    keep: samples that count, by channel and time. gain, pull, believed: row = gain (y_i - foretold_i), where foretold_i
    = pull (believed y + (1 - believed) foretold) of the sample before. off: directions in the rows that vary by more
    than the noise, and what is taken off them.
    """

    keep: Int[np.ndarray, " n"]
    gain: Float[np.ndarray, " n"]
    pull: Float[np.ndarray, " n"]
    believed: Float[np.ndarray, " n"]
    off: tuple[Float[np.ndarray, "n ways"], Float[np.ndarray, " ways"]] | None = None

    def __call__(self, rows: Float[np.ndarray, "samples ..."]) -> Float[np.ndarray, "n ..."]:
        """Rows of unit noise, of samples or of their slopes."""
        kept = rows[self.keep]
        flat = kept.reshape(len(kept), -1)
        before = np.concatenate([np.zeros_like(flat[:1]), (self.believed[:, None] * flat)[:-1]])
        foretold = self.pull[:, None] * before
        if np.any(self.believed < 1.0) and foretold.size:
            chain = np.ones((2, len(kept)))
            chain[1, :-1] = -self.pull[1:] * (1.0 - self.believed[:-1])
            foretold = solve_banded((1, 0), chain, foretold, check_finite=False)
        rows = (self.gain[:, None] * (flat - foretold)).reshape(kept.shape)
        if self.off is None:
            return rows
        ways, shares = self.off
        return rows - np.tensordot(ways * shares, np.tensordot(ways, rows, (0, 0)), 1)

    def beside(self, ways: Float[np.ndarray, "samples ways"]) -> Whitening:
        """The same where samples also vary along these ways, each with a deviation of one."""
        if not np.any(ways):
            return self
        along, size, _ = np.linalg.svd(self(ways), full_matrices=False)
        return replace(self, off=(along, 1.0 - 1.0 / np.sqrt(1.0 + size**2)))

    @property
    def log_width(self) -> float:
        """By how much those ways lower the log density of what is least surprising."""
        return 0.0 if self.off is None else -float(np.sum(np.log1p(-self.off[1])))


@dataclass(frozen=True)
class Noise:
    """Sd of every sample of every experiment, memory of each kind of channel and which samples count."""

    sigma: tuple[Float[np.ndarray, " samples"], ...]
    memory: dict[str, Memory]
    keep: tuple[np.ndarray, ...]

    def whitening(self, data: Measured, run: int, fraction: float = 1.0, scale: float = 1.0) -> Whitening:
        """Of one experiment, over the first fraction of its record; scale: of all sigmas."""
        since = data.time_s - data.release_s
        keep = np.flatnonzero(self.keep[run] & (since <= fraction * since.max()))
        sigma, time, channel = scale * self.sigma[run][keep], data.time_s[keep], data.channel[keep]
        gain, pull, believed = 1.0 / sigma, np.zeros(keep.size), np.ones(keep.size)
        for c, of in enumerate(data.channels):
            rows = np.flatnonzero(channel == c)
            memory = self.memory.get(kind_of(of))
            if rows.size < 2 or not memory:
                continue
            gaps = np.diff(time[rows])
            lasts, believed[rows], width = memory.foretelling(np.maximum(gaps / np.median(gaps), 0.5))
            pull[rows[1:]] = lasts[1:] * sigma[rows[1:]] / sigma[rows[:-1]]
            gain[rows] /= width
        return Whitening(keep, gain, pull, believed)


def kind_of(channel: Channel) -> str:
    """Channels of one kind share what is known of their noise: all markers, and joints' sensors of one unit."""
    return "marker" if channel.at.startswith("marker:") else f"joint, {channel.unit}"


def estimate(data: Sequence[Measured]) -> Noise:
    """From all experiments of a study together."""
    good = [good_samples(d) for d in data]
    keep = tuple(g & ~bursts(d, g) for d, g in zip(data, good, strict=True))
    sigma = [d.sigma.copy() for d in data]
    memory: dict[str, Memory] = {}
    for kind in {kind_of(c) for d in data for c in d.channels}:
        still = [
            (i, c, rows)
            for i, d in enumerate(data)
            for c, channel in enumerate(d.channels)
            if kind_of(channel) == kind and (rows := np.flatnonzero((d.channel == c) & d.still & keep[i])).size >= 5
        ]
        if sum(rows.size for *_, rows in still) < ENOUGH:
            continue
        still = _calm(data, keep, still)
        series = [data[i].value[rows] - data[i].value[rows].mean() for i, _, rows in still]
        when = [data[i].time_s[rows] for i, _, rows in still]
        series = _without_drift(series, when, [_name(data[i], c) for i, c, _ in still])
        when = [t / np.median(np.diff(t)) for t in when]
        a = memory[kind] = remembered(series, when, _coefficient(series))
        names = {data[i].channels[c].at + data[i].channels[c].coordinate for i, c, _ in still}
        own = {
            name: _sd([s for s, (i, c, _) in zip(series, still, strict=True) if _name(data[i], c) == name], a)
            for name in names
        }
        alike = max(own.values()) < ALIKE * min(own.values())
        shared = _sd(series, a)
        for i, d in enumerate(data):
            for c, channel in enumerate(d.channels):
                if kind_of(channel) != kind or channel.noise == "given":
                    continue
                rows = d.channel == c
                size = max(shared if alike else own.get(_name(d, c), shared), quantum(d.value[rows]) / np.sqrt(12.0))
                # Still frames that repeat to the last digit tell nothing: the sigma of the record itself stays.
                if size > ROUNDING * np.max(np.abs(d.value[rows])):
                    sigma[i][rows] = size
    return Noise(tuple(sigma), memory, keep)


def _calm(data: Sequence[Measured], keep: Sequence[np.ndarray], still: list) -> list:
    """Still frames of each channel without those that stand far from the rest, which no longer count: at the ends of a
    record no neighbours tell a wrong sample.
    """
    away = [np.abs(data[i].value[rows] - np.median(data[i].value[rows])) for i, _, rows in still]
    made = []
    for (i, c, rows), mine in zip(still, away, strict=True):
        alike = [a for a, (j, d, _) in zip(away, still, strict=True) if _name(data[j], d) == _name(data[i], c)]
        good = calm(mine, np.concatenate(alike), quantum(data[i].value[data[i].channel == c]))
        if good.sum() >= 5:
            at = [d for d, channel in enumerate(data[i].channels) if channel.at == data[i].channels[c].at]
            wrong = np.isin(data[i].time_s, data[i].time_s[rows[~good]]) & np.isin(data[i].channel, at)
            keep[i][wrong & data[i].still] = False
    for i, c, rows in still:
        made.append((i, c, rows[keep[i][rows]]))
    return [m for m in made if m[2].size >= 5]


Place = tuple[int, str, float]
"""Experiment, part and time: a marker's coordinates stand or fall together."""


def places(data: Sequence[Measured], keep: Sequence[np.ndarray]) -> list[Place]:
    """Of the samples `keep` (indices, by experiment), in their order."""
    return [
        (i, d.channels[c].at, float(t))
        for i, (d, rows) in enumerate(zip(data, keep, strict=True))
        for c, t in zip(d.channel[rows], d.time_s[rows], strict=True)
    ]


def drop(data: Sequence[Measured], keep: Sequence[np.ndarray], these: Iterable[Place]) -> None:
    """Samples at these places count no more in the masks `keep`."""
    for i, part, time_s in these:
        at = np.array([c.at == part for c in data[i].channels])[data[i].channel]
        keep[i][at & (data[i].time_s == time_s)] = False


def numbered(of: Sequence[Place]) -> Int[np.ndarray, " n"]:
    """One number for each place, in the order of their first appearance."""
    number = {place: k for k, place in enumerate(dict.fromkeys(of))}
    return np.array([number[place] for place in of])


def strays(left: Float[np.ndarray, " n"], together: Int[np.ndarray, " n"] | None = None) -> Bool[np.ndarray, " n"]:
    """Rows of unit noise, or of a misfit somewhat wider, that nothing smooth explains. together: rows of one number
    stand or fall together, as likely to be taken for strays by chance as one alone.
    """
    square = (left / max(1.0, MAD_TO_SIGMA * float(np.median(np.abs(left))))) ** 2
    if together is None:
        return square > STRAY**2
    count, far = np.bincount(together), np.bincount(together, square)
    return (far > chi2.isf(chi2.sf(STRAY**2, 1), np.maximum(count, 1)))[together]


def _name(data: Measured, channel: int) -> str:
    return data.channels[channel].at + data.channels[channel].coordinate


def _coefficient(series: Sequence[np.ndarray]) -> float:
    """AR(1) coefficient of short series; each is too small by (1 + 3 a) / n (Marriott and Pope 1954)."""
    power = sum(float(s @ s) for s in series)
    if power == 0.0:
        return 0.0
    a = sum(float(s[1:] @ s[:-1]) * s.size / (s.size - 1) for s in series) / power
    n = float(np.mean([s.size for s in series]))
    a = (a + 1.0 / n) / (1.0 - 3.0 / n)
    sd = 1.0 / np.sqrt(sum(s.size for s in series))
    return float(np.clip(a, 0.0, 0.97)) if abs(a) > 2.0 * sd else 0.0


def _without_drift(
    series: Sequence[np.ndarray], time_s: Sequence[np.ndarray], names: Sequence[str]
) -> list[Float[np.ndarray, " samples"]]:
    """Series about zero without the rate that a channel keeps in all of its own, where it is beyond what their noise
    lets them have: a mark that slips is no noise of all the others.
    """
    made = list(series)
    for name in dict.fromkeys(names):
        mine = [k for k, of in enumerate(names) if of == name]
        since = [time_s[k] - time_s[k].mean() for k in mine]
        lever = sum(float(t @ t) for t in since)
        rate = sum(float(t @ series[k]) for t, k in zip(since, mine, strict=True)) / lever
        rest = [series[k] - rate * t for t, k in zip(since, mine, strict=True)]
        a, power = _coefficient(rest), sum(float(s @ s) for s in rest) / sum(s.size for s in rest)
        if rate**2 * lever > DRIFTS**2 * power * (1.0 + a) / (1.0 - a):
            for k, s in zip(mine, rest, strict=True):
                made[k] = s
    return made


def _sd(series: Sequence[np.ndarray], memory: Memory) -> float:
    """Sd of series about an unknown mean each: of what is remembered the mean takes more than one sample's worth."""
    power = sum(float(s @ s) for s in series)
    free = sum(s.size - memory.mean_takes(s.size) for s in series)
    return float(np.sqrt(power / max(free, 1.0)))


def good_samples(data: Measured) -> np.ndarray:
    """Samples (mask) that fit between their neighbours; coordinates of one marker stand or fall together."""
    good = np.isfinite(data.value)
    for at in dict.fromkeys(c.at for c in data.channels):
        channels = [i for i, c in enumerate(data.channels) if c.at == at and c.coordinate != "effort"]
        if not channels:
            continue
        for _ in range(ROUNDS):
            far: dict[float, float] = {}
            for c in channels:
                rows = np.flatnonzero((data.channel == c) & good)
                if rows.size < 9:
                    continue
                time, value = data.time_s[rows], data.value[rows]
                # A counter that repeats one value has no scatter of its own.
                told = data.channels[c].noise == "given" or quantum(value) > 0
                floor = 0.7 * np.median(data.sigma[rows]) if told else 0.0
                inside = np.arange(2, rows.size - 2)
                between = _missed(time, value, inside, BETWEEN), inside
                last = np.arange(len(BEFORE), rows.size)
                after = _missed(time, value, last, BEFORE), last
                first = np.arange(rows.size - len(BEFORE))
                ahead = _missed(time, value, first, -BEFORE), first
                for (miss, index), ends in ((between, inside), (after, last[-2:]), (ahead, first[:2])):
                    width = max(MAD_TO_SIGMA * np.median(np.abs(miss)), floor, 1e-300)
                    at = np.isin(index, ends)
                    for t, size in zip(time[index[at]], miss[at] / width, strict=True):
                        far[t] = far.get(t, 0.0) + size**2
            if not far:
                break
            times = np.array(sorted(far))
            square = np.array([far[t] for t in times])
            worst = np.array([square[max(i - 2, 0) : i + 3].max() for i in range(square.size)])
            out = (square > chi2.isf(RARE, len(channels))) & (square >= worst)
            if not out.any() or out.mean() > 0.1:
                break
            good &= ~(np.isin(data.channel, channels) & np.isin(data.time_s, times[out]))
    return good


def _missed(
    time: Float[np.ndarray, " n"],
    value: Float[np.ndarray, " n"],
    at: Int[np.ndarray, " k"],
    near: Int[np.ndarray, " m"],
) -> Float[np.ndarray, " k"]:
    """Value minus what the samples `near` foretell, by a cubic through four or the closest parabola to more, in units
    of its own noise gain.
    """
    t = time[at[:, None] + near] - time[at][:, None]
    t = t / np.maximum(np.abs(t).max(1, keepdims=True), 1e-300)
    powers = t[:, :, None] ** np.arange(4 if near.size == 4 else 3)
    weights = np.linalg.pinv(powers)[:, 0]
    miss = value[at] - np.sum(weights * value[at[:, None] + near], 1)
    return miss / np.sqrt(1.0 + np.sum(weights**2, 1))
