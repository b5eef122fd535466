"""The report of a study: what each experiment holds, and what stands out, for people and for programs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from backend.mechanism.check import check_json, check_text, few, many
from backend.mechanism.graph import GraphReport
from backend.mechanism.part import Part
from backend.mechanism.study import Experiment, Study, Use
from backend.mechanism.study_findings import study_findings
from backend.mechanism.tracks import PIXELS, PLACES


class ExperimentReport(Part):
    """What an experiment holds.

    duration_s: from the release to the last sample; null without a table of measurements. samples: different times at
    which anything was measured; still: how many of them before the release. driven, overridden: `effect.parameter`.
    """

    id: str
    use: Use
    release_s: float
    at_rest: bool
    duration_s: float | None
    samples: int
    still: int
    markers: tuple[str, ...]
    encoders: tuple[str, ...]
    efforts: tuple[str, ...]
    driven: tuple[str, ...]
    overridden: tuple[str, ...]


class StudyReport(Part):
    """What `linktwin check` tells about a study that could be read."""

    mechanism: GraphReport
    experiments: tuple[ExperimentReport, ...]
    tolerances: int
    errors: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    @property
    def ok(self) -> bool:
        """Whether the study can be fitted and diagnosed."""
        return self.mechanism.ok and not self.errors


def describe_study(
    study: Study, mechanism: GraphReport, errors: Sequence[str] = (), warnings: Sequence[str] = ()
) -> StudyReport:
    """What a study holds. mechanism: the report of its drawing; errors, warnings: what else is known of it."""
    nothing = study.nothing_to_fit()
    return StudyReport(
        mechanism=mechanism,
        experiments=tuple(_of(experiment) for experiment in study.experiments),
        tolerances=len(study.tolerances),
        errors=(*([nothing] if nothing else []), *(e for e in errors if e not in mechanism.errors)),
        warnings=tuple(said for said in (*study_findings(study), *warnings) if said not in mechanism.warnings),
    )


def _of(experiment: Experiment) -> ExperimentReport:
    tracks, positions, efforts, inputs = (
        experiment.tracks, experiment.joint_positions, experiment.joint_efforts, experiment.inputs,
    )  # fmt: skip
    tables = [table for table in (tracks, positions, efforts) if table is not None]
    times = np.unique(np.concatenate([table["time_s"].to_numpy(float) for table in tables])) if tables else np.zeros(0)
    release = experiment.release
    driven = [] if inputs is None else list(zip(inputs["effect"], inputs["parameter"], strict=True))
    return ExperimentReport(
        id=experiment.id,
        use=experiment.use,
        release_s=release.time_s,
        at_rest=release.at_rest,
        duration_s=float(times[-1]) - release.time_s if times.size else None,
        samples=times.size,
        still=int(np.sum(times < release.time_s)),
        markers=_names(_seen(tracks), "marker"),
        encoders=_names(positions, "joint"),
        efforts=_names(efforts, "joint"),
        driven=tuple(f"{effect}.{name}" for effect, name in dict.fromkeys(driven)),
        overridden=tuple(f"{id}.{name}" for id, given in experiment.overrides.items() for name in given),
    )


def _seen(tracks: Any) -> Any:
    """Rows of the tracks in which anything was measured."""
    if tracks is None:
        return None
    return tracks[tracks[[name for name in (*PLACES, *PIXELS) if name in tracks]].notna().any(axis=1)]


def _names(table: Any, column: str) -> tuple[str, ...]:
    return () if table is None else tuple(dict.fromkeys(map(str, table[column])))


def study_json(report: StudyReport) -> dict[str, Any]:
    """The report as plain data, ready for JSON."""
    told = report.model_dump(mode="json", exclude={"mechanism"})
    return {"ok": report.ok, "mechanism": check_json(report.mechanism), **told}


def study_text(report: StudyReport) -> str:
    """The drawing, then a line for each experiment, then what stands out in the study."""
    uses = [experiment.use for experiment in report.experiments]
    lines = [
        check_text(report.mechanism),
        f"study     {many(len(uses), 'experiment')}: {uses.count('fit')} to fit, {uses.count('held_out')} held out; "
        f"{many(report.tolerances, 'tolerance')}",
        *(f"  {line}" for line in _table(report.experiments)),
    ]
    lines += [f"error: {text}" for text in report.errors]
    lines += [f"warning: {text}" for text in report.warnings]
    return "\n".join(lines)


def _table(experiments: Sequence[ExperimentReport]) -> list[str]:
    wide = max(len(experiment.id) for experiment in experiments)
    return [f"{e.id:<{wide}}  {e.use:<8}  {_held(e)}" for e in experiments]


def _held(experiment: ExperimentReport) -> str:
    if experiment.duration_s is None:
        return "no table: track its video first"
    counted = (("marker", experiment.markers), ("encoder", experiment.encoders), ("load cell", experiment.efforts))
    begins = "let go" if experiment.at_rest else "already moving"
    said = [
        f"{experiment.duration_s:.4g} s, {begins} at {experiment.release_s:.4g} s",
        f"{many(experiment.samples, 'sample')} ({experiment.still} before)",
        *(many(len(names), what) for what, names in counted if names),
    ]
    if experiment.driven:
        said.append(f"driven by {few(experiment.driven)}")
    if experiment.overridden:
        said.append(f"overrides {few(experiment.overridden)}")
    return ", ".join(said)
