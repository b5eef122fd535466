"""Where the gap lies, whatever causes it: unknown forces at one joint, shifts of one marker or of the whole picture, a
base that moves.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from backend.diagnose.adequacy import scaled
from backend.diagnose.belief import Belief
from backend.diagnose.finer import WORLD, displacement, knots
from backend.diagnose.fitted import Fitted
from backend.diagnose.latent import SIZES, Latent, evidence, log_mean, posterior
from backend.diagnose.subject import Subject, bumps_at
from backend.mechanism.gap_report import JointGap, Location, MarkerGap, Phase

LOUD = 3.0  # sd: what of a missing force is told as a stretch of time
MOST = 8  # stretches
TIMES = 200  # at which a trace is told
FAINTEST = 1e-6  # of the likeliest place: what is less likely is not listed


def place_evidence(fitted: Fitted, latent: Latent, scale: float) -> dict[str, float]:
    """Log evidence of unknown forces or shifts at each place alone."""
    own = scaled(fitted, scale)
    return {p: log_mean(evidence(own, latent.scaled(p) / scale)) for p in latent.places}


def shares(log_z: Mapping[str, float]) -> dict[str, float]:
    """Probabilities of places, equally believed before."""
    if not log_z:
        return {}
    z = np.array(list(log_z.values()))
    p = np.exp(z - z.max())
    return dict(zip(log_z, (p / p.sum()).tolist(), strict=True))


def locations(belief: Belief, model_free: Mapping[str, float]) -> list[Location]:
    """Places of the causes by their probabilities; what is unknown goes where the model-free map says."""
    found: dict[str, float] = {}
    known = float(belief.probability.sum())
    for cause, p in zip(belief.causes, belief.probability, strict=True):
        places = [at for c in cause.candidates for at in c.places]
        for at in places:
            found[at] = found.get(at, 0.0) + float(p) / len(places)
    rest = 1.0 - known if model_free else 0.0
    for at, p in model_free.items():
        found[at] = found.get(at, 0.0) + rest * p
    ranked = sorted(found.items(), key=lambda pair: -pair[1])
    ranked = [(at, p) for at, p in ranked if p > FAINTEST * ranked[0][1]]
    total = sum(p for _, p in ranked)
    return [Location(at=at, probability=p / total) for at, p in ranked]


@dataclass(frozen=True)
class Trace:
    """What is missing at a place against time, if it is missing there: of each experiment the times since its release,
    the mean and its sd, in `unit`. along: the axis of W, where it has one.
    """

    at: str
    unit: str
    series: Mapping[str, tuple[np.ndarray, np.ndarray, np.ndarray]]
    along: str = ""

    def phases(self) -> list[Phase]:
        """Stretches in which it stands out of its band: the largest, in the order of time."""
        found = []
        for experiment, (time, mean, sd) in self.series.items():
            loud = np.abs(mean) > LOUD * np.maximum(sd, 1e-300)
            edges = np.flatnonzero(np.diff(np.concatenate([[0], loud.astype(int), [0]])))
            for a, b in zip(edges[::2], edges[1::2], strict=True):
                found.append(
                    Phase(
                        experiment=experiment, at=self.at, start_s=float(time[a]), end_s=float(time[b - 1]),
                        missing=float(np.mean(mean[a:b])), sd=float(np.mean(sd[a:b])), unit=self.unit,
                    )
                )  # fmt: skip
        largest = sorted(range(len(found)), key=lambda i: -abs(found[i].missing) * (found[i].end_s - found[i].start_s))
        return [found[i] for i in sorted(largest[:MOST])]


def missing_force(subject: Subject, fitted: Fitted, latent: Latent, place: str, scale: float) -> Trace:
    """Unknown force at `joint:ID` [N m or N]; of a joint that is told how to move, an unknown motion [rad or m]."""
    joint = place.partition(":")[2]
    mean, C = _likeliest(fitted, latent.scaled(place), scale)
    slide = subject.model.topology.joint_types[subject.model.topology.joint_ids.index(joint)] == "prismatic"
    turning, sliding = ("rad", "m") if joint in subject.told else ("N m", "N")
    series: dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
    at = 0
    for probe, count in zip(fitted.probes, _counts(latent.places[place], fitted.rows), strict=True):
        time = np.linspace(0.0, probe.duration_s * fitted.fraction, TIMES)
        shape = bumps_at(time, probe.duration_s, probe.bumps.shape[1])[:, :count] * latent.unit[place]
        part = slice(at, at + count)
        series[probe.experiment.id] = (time, shape @ mean[part], _sd(shape, C[part, part]))
        at += count
    return Trace(place, sliding if slide else turning, series)


def missing_motion(subject: Subject, fitted: Fitted, L: Float[np.ndarray, "n bumps"], scale: float) -> Trace:
    """Unknown motion of the base [m], along the axis of W along which it moves most. L: see `base_response`."""
    unit = 1.0 / float(np.median(np.linalg.norm(L, axis=0)))
    mean, C = _likeliest(fitted, L * unit, scale)
    found: dict[str, dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]] = {axis: {} for axis in subject.axes}
    at = 0
    for probe in fitted.probes:
        time = np.linspace(0.0, probe.duration_s * fitted.fraction, TIMES)
        shape = displacement(time, knots(subject, probe)) * unit
        for axis in subject.axes:
            part = slice(at, at + shape.shape[1])
            found[axis][probe.experiment.id] = (time, shape @ mean[part], _sd(shape, C[part, part]))
            at += shape.shape[1]
    along = max(found, key=lambda axis: sum(float(np.sum((m / s.max()) ** 2)) for _, m, s in found[axis].values()))
    return Trace(WORLD, "m", found[along], along)


def _likeliest(fitted: Fitted, L: Float[np.ndarray, "n bumps"], scale: float) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of bumps of the size that has most evidence."""
    own, L = scaled(fitted, scale), L / scale
    return posterior(own, L, float(SIZES[int(np.argmax(evidence(own, L)))]))


def _sd(shape: Float[np.ndarray, "t bumps"], C: Float[np.ndarray, "bumps bumps"]) -> Float[np.ndarray, " t"]:
    return np.sqrt(np.maximum(np.sum((shape @ C) * shape, 1), 0.0))


def _counts(L: Float[np.ndarray, "n bumps"], rows: Sequence[slice]) -> list[int]:
    """Bumps of each experiment: columns that touch its rows."""
    return [int(np.any(L[r] != 0.0, axis=0).sum()) for r in rows]


def marker_gaps(subject: Subject, fitted: Fitted, scale: float) -> list[MarkerGap]:
    """How far each marker is from its prediction."""
    return [
        MarkerGap(marker=at.partition(":")[2], rms_m=rms, noise_m=noise)
        for at, rms, noise, _ in _channel_gaps(subject, fitted, "marker", scale)
    ]


def joint_gaps(subject: Subject, fitted: Fitted, scale: float) -> list[JointGap]:
    """The same for encoders."""
    return [
        JointGap(joint=at.partition(":")[2], rms=rms, noise=noise, unit=unit)
        for at, rms, noise, unit in _channel_gaps(subject, fitted, "joint", scale)
    ]


def _channel_gaps(subject: Subject, fitted: Fitted, kind: str, scale: float):
    sums: dict[str, list] = {}
    for i, probe in enumerate(fitted.whole):
        seen, _ = probe.predict(fitted.values, fitted.own(i))
        keep = subject.noise.keep[i] & ~probe.data.still & np.isfinite(seen)
        for c, channel in enumerate(probe.data.channels):
            rows = keep & (probe.data.channel == c)
            if channel.at.startswith(kind + ":") and channel.coordinate != "effort" and rows.any():
                total = sums.setdefault(channel.at, [0.0, 0.0, 0, channel.unit, set()])
                total[0] += float(np.sum((probe.data.value - seen)[rows] ** 2))
                total[1] += float(np.sum((scale * subject.noise.sigma[i][rows]) ** 2))
                total[2] += int(rows.sum())
                total[4].add(channel.coordinate)
    for at, (miss, noise, count, unit, axes) in sums.items():
        # Distances: both coordinates of a marker together.
        yield at, float(np.sqrt(miss / count * len(axes))), float(np.sqrt(noise / count * len(axes))), unit
