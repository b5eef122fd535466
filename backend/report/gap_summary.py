"""A diagnosis in a screenful, and as evidence for its page."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float

from backend.mechanism.gap_names import place_name
from backend.mechanism.gap_report import GapReport
from backend.mechanism.study import Study
from backend.report.evidence import Channel, GapEvidence, Missing, Motion, Overlay
from backend.report.gap_words import alike, amounts, cause_name, percent, worst_first
from backend.report.quantity import at_the_bench, shown

MOST_ALIKE = 4

if TYPE_CHECKING:
    from backend.diagnose.cause import Cause
    from backend.diagnose.diagnosis import Diagnosis
    from backend.diagnose.probe import Probe


def gap_evidence(study: Study, found: Diagnosis) -> GapEvidence:
    """A finished diagnosis as its page wants it: the missing force, and the experiment that is explained worst."""
    missing = found.missing
    channels = worst_first(_held_out(found) or _fitted(found))
    return GapEvidence(
        mechanism=study.mechanism,
        report=found.report,
        pose=_release(found.subject.fit[0]),
        missing=() if missing is None else tuple(Missing(e, *series) for e, series in missing.series.items()),
        missing_at="" if missing is None else missing.at,
        missing_unit="N m" if missing is None else missing.unit,
        missing_along="" if missing is None else missing.along,
        channels=channels,
        set_aside=sum(int(np.isnan(c.measured).sum()) for c in channels),
        overlays=_overlays(study, found, channels[0].experiment if channels else ""),
    )


def gap_text(report: GapReport) -> str:
    """Verdict, causes, places, how far the gap shrinks, and what to do next."""
    lines = [f"{report.verdict.upper()}: {report.sentence}"]
    for cause in report.causes[:4]:
        if cause.probability < 0.005:
            continue
        values = "; ".join(amounts(e) for e in cause.effects)
        lines.append(f"cause     {percent(cause.probability):>6} {cause_name(cause)}: {values}")
        if others := alike(cause):
            more = f"; and {len(others) - MOST_ALIKE} other kinds" if len(others) > MOST_ALIKE else ""
            lines.append(f"{'':<16} these data cannot tell it from {'; '.join(others[:MOST_ALIKE])}{more}")
    for p, words in ((report.probability_none, "nothing"), (report.probability_unknown, "something unknown")):
        if p >= 0.005:
            lines.append(f"cause     {percent(p):>6} {words}")
    lines += [
        f"place     {percent(where.probability):>6} {place_name(where.at)}"
        for where in report.suspected[:4]
        if where.probability >= 0.005
    ]
    unit, factor = at_the_bench(report.shrink.unit)
    for name, rest in (("fitted", report.shrink.fit), ("held out", report.shrink.held_out)):
        if rest is not None:
            before, after, noise = (
                shown(factor * value) for value in (rest.before_rms_m, rest.after_rms_m, rest.noise_rms_m)
            )
            corrected = "" if report.verdict == "none" else f", {after} with the best cause"
            lines.append(f"{name:<9} rms {before} {unit} as drawn{corrected}, noise {noise}")
    if report.next_experiment is not None:
        lines.append(f"next      {report.next_experiment.do}")
    lines += [f"warning: {sentence}" for sentence in report.warnings]
    return "\n".join(lines)


def _overlays(study: Study, found: Diagnosis, worst: str) -> tuple[Overlay, ...]:
    """The experiment that is charted, played back as drawn and with the best cause, and the first fitted one."""
    from backend.report.fit_motion import motion_under
    from backend.report.fit_summary import seen_markers

    moving = [body.id for body in study.mechanism.moving_bodies()]

    def played(cause: Cause, probe: Probe, own: Float[np.ndarray, " own"]) -> Motion:
        return motion_under(probe, probe.every(cause.fitted.values), own, moving)

    made: dict[str, Overlay] = {}
    for drawn, best in zip(found.before, found.after, strict=True):
        if best.probe.experiment.id == worst:
            motions = [
                played(cause, test.probe, test.probe.settle(cause.fitted.values))
                for cause, test in ((found.best, best), (found.baseline, drawn))
            ]
            made[worst] = Overlay(worst, motions[0], motions[1])
    for i, probe in enumerate(found.subject.fit):
        if probe.experiment.id == worst or i == 0:
            motions = [played(c, c.fitted.whole[i], c.fitted.own(i)) for c in (found.best, found.baseline)]
            made[probe.experiment.id] = Overlay(probe.experiment.id, motions[0], motions[1])
    if found.report.verdict == "none":
        made = {name: replace(overlay, before=None) for name, overlay in made.items()}
    seen = {name: seen_markers(study, name) for name in made}
    return tuple(replace(made[name], seen_time_s=seen[name][0], seen_m=seen[name][1]) for name in made)


def _held_out(found: Diagnosis) -> list[list[Channel]]:
    """Channels of every held-out experiment, under both models as they were tested."""
    noise, pairs = found.subject.held_noise, zip(found.before, found.after, strict=True)
    return [
        _channels(b.probe, b.predicted, a.predicted, found.scale * noise.sigma[i], noise.keep[i])
        for i, (b, a) in enumerate(pairs)
    ]


def _fitted(found: Diagnosis) -> list[list[Channel]]:
    """The same of the fitted ones."""
    noise, made = found.subject.noise, []
    for i, probe in enumerate(found.subject.fit):
        before, after = (
            c.fitted.whole[i].predict(c.fitted.values, c.fitted.own(i))[0] for c in (found.baseline, found.best)
        )
        made.append(_channels(probe, before, after, found.scale * noise.sigma[i], noise.keep[i]))
    return made


def _channels(
    probe: Probe,
    before: Float[np.ndarray, " samples"],
    after: Float[np.ndarray, " samples"],
    sigma: Float[np.ndarray, " samples"],
    keep: Bool[np.ndarray, " samples"],
) -> list[Channel]:
    """Measured coordinates of one experiment; efforts are no motion and are left out."""
    data, made = probe.data, []
    for i, c in enumerate(data.channels):
        if c.coordinate == "effort":
            continue
        rows = data.of(i)
        made.append(
            Channel(
                experiment=probe.experiment.id, use=probe.experiment.use, at=c.at,
                component=c.coordinate.removesuffix("_m"), unit=c.unit, time_s=data.time_s[rows],
                measured=np.where(keep[rows], data.value[rows], np.nan), before=before[rows], after=after[rows],
                sigma=float(np.sqrt(np.mean(sigma[rows] ** 2))), release_s=data.release_s,
            )
        )  # fmt: skip
    return made


def _release(probe: Probe) -> Motion:
    """The pose in which an experiment was let go."""
    import jax

    from backend.model.system import system
    from backend.simulate import points

    model, pose = probe.model, probe.found.reference
    origin = np.asarray(jax.jit(lambda: points.origins(system(model), pose))())
    attitude = np.asarray(pose.quaternion)
    bodies = [(i, body) for i, body in enumerate(model.topology.body_ids[: attitude.shape[0]]) if body is not None]
    return Motion(
        np.array([probe.data.release_s]),
        {body: origin[None, i] for i, body in bodies},
        {body: attitude[None, i] for i, body in bodies},
    )
