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
from backend.diagnose.bumps import bumps_at
from backend.diagnose.finer import WORLD, base_response, displacement, finer_responses, knots
from backend.diagnose.fitted import Fitted
from backend.diagnose.latent import SIZES, Latent, evidence, log_mean, posterior
from backend.diagnose.probe import Probe
from backend.diagnose.subject import Subject
from backend.diagnose.unknown import Unknown
from backend.mechanism.gap_report import JointGap, Location, MarkerGap, Phase

LOUD = 3.0  # sd: what of a missing force is told as a stretch of time
MOST = 8  # stretches
TIMES = 200  # at which a trace is told
FAINTEST = 1e-6  # of the likeliest place: what is less likely is not listed
BEYOND_DOUBT = 0.99
JOINTS = 2  # likeliest ones whose forces are taken as fine as the motion of the base
Series = dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]


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


def beyond_doubt(log_z: Mapping[str, float]) -> str | None:
    """The place where something lies beyond doubt, by log evidence; None where several may be it."""
    found = shares(log_z)
    place = max(found, key=lambda at: found[at], default=None)
    return place if place is not None and found[place] > BEYOND_DOUBT else None


def whereabouts(unknown: Unknown, log_z: Mapping[str, float], scale: float) -> dict[str, float]:
    """How probably what is unknown lies at each place, among them a base that moves, in units of what the place that
    explains most leaves: a named cause far off would blur them all.
    """
    fitted = unknown.fitted
    likeliest = sorted((at for at in log_z if at.startswith("joint:")), key=lambda at: -log_z[at])[:JOINTS]
    joints = [at.partition(":")[2] for at in likeliest]
    finer = unknown.finer(finer_responses(fitted.subject, fitted, joints))
    return shares(finer.log_z(scale / np.sqrt(finer.softness())))


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
    series: Series
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


def trace(
    subject: Subject, drawn: Fitted, latent: Latent, at: str, free: Mapping[str, float], scale: float, unknown: bool
) -> Trace | None:
    """What the drawing misses against time: where a cause is named at a joint, a force there, because in a linkage of
    one freedom a force at any joint does nearly the same; where something unknown lies in the world, a motion of the
    base. at: the likeliest place. free: probabilities of places, whatever lies there.
    """
    if at == WORLD and unknown:
        moved = base_response(subject, drawn)
        if moved.any():
            return missing_motion(subject, drawn, moved, scale)
    if not latent.forces:
        return None
    at = at if at in latent.forces else max(latent.forces, key=lambda place: free.get(place, 0.0))
    return missing_force(subject, drawn, latent, at, scale)


def missing_force(subject: Subject, fitted: Fitted, latent: Latent, place: str, scale: float) -> Trace:
    """Unknown force at `joint:ID` [N m or N]; of a joint that is told how to move, an unknown motion [rad or m]."""
    joint = place.partition(":")[2]
    slide = subject.model.topology.joint_types[subject.model.topology.joint_ids.index(joint)] == "prismatic"
    turning, sliding = ("rad", "m") if joint in subject.told else ("N m", "N")
    counts = _counts(latent.places[place], fitted.rows)
    shapes = [
        [bumps_at(_times(fitted, probe), probe.duration_s, probe.bumps.shape[1])[:, :count] * latent.unit[place]]
        for probe, count in zip(fitted.probes, counts, strict=True)
    ]
    (series,) = _against_time(fitted, latent.scaled(place), shapes, scale)
    return Trace(place, sliding if slide else turning, series)


def missing_motion(subject: Subject, fitted: Fitted, L: Float[np.ndarray, "n bumps"], scale: float) -> Trace:
    """Unknown motion of the base [m], along the axis of W along which it moves most. L: see `base_response`."""
    unit = 1.0 / float(np.median(np.linalg.norm(L, axis=0)))
    shapes = [
        [displacement(_times(fitted, probe), knots(subject, probe)) * unit] * len(subject.axes)
        for probe in fitted.probes
    ]
    found = _against_time(fitted, L * unit, shapes, scale)
    loud = [sum(float(np.sum((mean / sd.max()) ** 2)) for _, mean, sd in series.values()) for series in found]
    along = int(np.argmax(loud))
    return Trace(WORLD, "m", found[along], subject.axes[along])


def _times(fitted: Fitted, probe: Probe) -> Float[np.ndarray, " times"]:
    return np.linspace(0.0, probe.duration_s * fitted.fraction, TIMES)


def _against_time(
    fitted: Fitted, L: Float[np.ndarray, "n bumps"], shapes: Sequence[Sequence[np.ndarray]], scale: float
) -> list[Series]:
    """Of bumps of the likeliest size, in the order of L's columns. shapes: of each experiment those of every trace."""
    mean, C = _likeliest(fitted, L, scale)
    found: list[Series] = [{} for _ in shapes[0]]
    at = 0
    for probe, own in zip(fitted.probes, shapes, strict=True):
        for series, shape in zip(found, own, strict=True):
            part = slice(at, at + shape.shape[1])
            series[probe.experiment.id] = (_times(fitted, probe), shape @ mean[part], _sd(shape, C[part, part]))
            at = part.stop
    return found


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
