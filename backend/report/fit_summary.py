"""A fit in a screenful, and as evidence for its page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from backend.mechanism.fit_report import FitReport, Residual
from backend.mechanism.study import Study
from backend.report.evidence import Channel, FitEvidence, Overlay
from backend.report.fit_page import cautions, headline, pooled
from backend.report.quantity import at_the_bench, measured, shown

if TYPE_CHECKING:
    from backend.fit.result import FitResult
    from backend.fit.run import Run

MOST_OVERLAYS = 2
MOST_HELD_OUT = 1
MOST_JOINTS = 12  # of which the summary tells one by one; the page and fit.json tell all


def fit_evidence(study: Study, result: FitResult, truth: Mapping[str, float] | None = None) -> FitEvidence:
    """A finished fit as its page wants it; the first experiments, fitted and held out, can be played back."""
    return FitEvidence(
        title=study.mechanism.name,
        mechanism=study.mechanism,
        report=result.report,
        channels=channels(result),
        overlays=overlays(study, result),
        truth=truth or {},
    )


def channels(result: FitResult) -> tuple[Channel, ...]:
    """Every measured coordinate of a fit; one that was never measured (a planar marker's height) is left out."""
    made = []
    for overlay in result.overlays:
        for k, name in enumerate(overlay.coordinates):
            seen = np.isfinite(overlay.measured[:, k])
            if not seen.any():
                continue
            sigma = float(np.sqrt(np.nanmean(overlay.sigma[seen, k] ** 2)))
            made.append(
                Channel(
                    experiment=overlay.experiment,
                    use="held_out" if overlay.use == "held_out" else "fit",
                    at=overlay.at,
                    component=name.removesuffix("_m"),
                    unit=overlay.unit,
                    time_s=overlay.time_s[seen],
                    measured=overlay.measured[seen, k],
                    before=overlay.before[seen, k],
                    after=overlay.after[seen, k],
                    sigma=sigma if np.isfinite(sigma) else None,
                    release_s=overlay.release_s,
                )
            )
    return tuple(made)


def overlays(study: Study, result: FitResult) -> tuple[Overlay, ...]:
    """Motions of the first fitted experiments and of the first held-out one, with the markers that were seen."""
    from backend.report.fit_motion import motion_under

    moving = [body.id for body in study.mechanism.moving_bodies()]
    residuals, x = result.residuals, result.solution.x
    fitted, drawn = x[: len(residuals.parameters)], np.array([p.start for p in residuals.parameters])

    def overlay(run: Run, own: np.ndarray) -> Overlay:
        after = motion_under(run, run.every(fitted), own, moving)
        before = motion_under(run, run.every(drawn), run.settle(drawn), moving)
        times, seen = seen_markers(study, run.experiment.id)
        held_out = run.experiment.use == "held_out"
        return Overlay(run.experiment.id, after, before, seen_time_s=times, seen_m=seen, held_out=held_out)

    made = [overlay(run, residuals.own(x, i)) for i, run in enumerate(residuals.runs[:MOST_OVERLAYS])]
    return (*made, *(overlay(run, run.settle(fitted)) for run in result.held_out[:MOST_HELD_OUT]))


def fit_text(report: FitReport) -> str:
    """What was fitted, how surely, and how well it predicts."""
    lines = [headline(report)]
    width = max((len(p.name) for p in report.parameters), default=0)
    for p in report.parameters:
        interval = f"95% {shown(p.ci95[0], 4)} … {shown(p.ci95[1], 4)}" if p.ci95 else "not bounded by the data"
        bound = "  AT ITS BOUND" if p.at_bound else ""
        lines.append(f"  {p.name:<{width}}  {measured(p.value, p.sd):>10} {p.unit:<10} {interval}{bound}")
    values = {p.name: p.value for p in report.parameters}
    for d in report.deviations:
        times = f" ({shown(values[d.name] / values[d.others], 3)} times)" if values[d.others] else ""
        instead = f"; it could as well be {' or '.join(d.could_be)}" if d.could_be else ""
        lines.append(
            f"deviates  {d.name}: {measured(d.difference, d.sd)} {d.unit} more than the others{times}{instead}"
        )
    for name, rows in (("fitted", report.residuals), ("held out", report.held_out)):
        for si in sorted({row.unit for row in rows}):
            unit, factor = at_the_bench(si)
            chosen = [row for row in rows if row.unit == si]
            lines.append(f"{name:<9} rms {_missed(chosen, factor, unit)}")
            lines += _of_each_joint(chosen, factor, unit)
    lines += [f"warning: {sentence}" for sentence in cautions(report)]
    return "\n".join(lines)


def _missed(rows: Sequence[Residual], factor: float, unit: str) -> str:
    known = all(row.before is not None for row in rows)
    before = f", {shown(factor * pooled(rows, 'before'))} as drawn" if known else ""
    return f"{shown(factor * pooled(rows))} {unit}{before}"


def _of_each_joint(rows: Sequence[Residual], factor: float, unit: str) -> list[str]:
    """Joints that share a unit are unlike each other: one may swing, another hardly move."""
    joints = [row.at for row in rows if row.at.startswith("joint:")]
    each = list(dict.fromkeys(joints))
    if not 1 < len(each) <= MOST_JOINTS:
        return []
    wide = max(map(len, each))
    return [f"  {at:<{wide}}  {_missed([row for row in rows if row.at == at], factor, unit)}" for at in each]


def seen_markers(study: Study, experiment: str) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Markers on one clock [s], as seen [m]; NaN where a marker was not."""
    tracks = study.experiment(experiment).tracks
    if tracks is None:
        return np.zeros(0), {}
    times = np.unique(tracks["time_s"].to_numpy(float))
    seen = {}
    for marker, rows in tracks.groupby("marker", sort=False):
        table = np.full((len(times), 3), np.nan)
        table[np.searchsorted(times, rows["time_s"].to_numpy(float))] = rows[["x_m", "y_m", "z_m"]].to_numpy(float)
        # A planar rig's tracks leave the third coordinate empty: it stays what was drawn.
        unmeasured = np.isnan(table).all(axis=0)
        table[:, unmeasured] = _as_drawn(study, str(marker))[unmeasured]
        seen[str(marker)] = table
    return times, seen


def _as_drawn(study: Study, marker: str) -> np.ndarray:
    """Where a marker is as drawn, in W [m]."""
    drawn = study.mechanism.marker(marker)
    return study.mechanism.body(drawn.body).pose.place(drawn.position_m)
