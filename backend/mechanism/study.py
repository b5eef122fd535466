"""A mechanism and its experiments: the study file, and the study with its tables loaded."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from backend.mechanism.apart import joints_of
from backend.mechanism.drawing_error import DrawingError, known
from backend.mechanism.effect import ParameterValue, Places, kind_named, order_faults, parameter_faults
from backend.mechanism.mechanism import Drawn, Mechanism, place_faults
from backend.mechanism.part import Id, Part
from backend.mechanism.tracks import TABLES

if TYPE_CHECKING:
    import pandas as pd

Use = Literal["fit", "held_out"]
MOST_TOLERANCES = 1000
WINDOW_S = 0.3  # a third of a swing of most linkages that stand on a table
NAMED = (*TABLES, "video", "camera")  # what of an experiment names a file


class Release(Part):
    """When the mechanism is let go [s]; samples before are static frames.

    at_rest: false when it starts in motion; its state then comes from the first `window_s`.
    """

    time_s: float
    at_rest: bool = True
    window_s: Annotated[float, Field(gt=0.0)] = WINDOW_S

    @property
    def states_a_window(self) -> bool:
        """Whether the file asks for a window of its own; one that was written in full gives the usual one."""
        return self.window_s != WINDOW_S


class ExperimentFile(Part):
    """One experiment as the study file states it; table paths are relative to that file."""

    id: Id
    use: Use = "fit"
    tracks: Id | None = None
    joint_positions: Id | None = None
    inputs: Id | None = None
    joint_efforts: Id | None = None
    video: Id | None = None
    camera: Id | None = None
    release: Release
    overrides: dict[str, dict[str, ParameterValue]] = Field(default_factory=dict)


class Tolerance(Part):
    """Prior standard deviation of something drawn: known looseness, a finding only when exceeded."""

    kind: Id
    on: Places
    sd: Annotated[float, Field(gt=0.0)]


class StudyFile(Part):
    """study.json, word for word."""

    schema_version: Literal["1.0"] = "1.0"
    mechanism: Id
    experiments: Annotated[tuple[ExperimentFile, ...], Field(strict=False, min_length=1)]
    tolerances: Annotated[tuple[Tolerance, ...], Field(strict=False)] = ()


@dataclass(frozen=True)
class Experiment:
    """One experiment with its tables loaded; a table that was not recorded is None.

    tracks: time_s, marker, x_m, y_m, z_m, sigma_m and what else the tracker wrote (world frame; NaN: not
    measured).
    joint_positions: time_s, joint, q, sigma [rad or m].
    inputs: time_s, effect, parameter, value: a force or torque, held until the next row of the same effect and
    parameter; or a path, joined smoothly between rows.
    joint_efforts: time_s, joint, effort, sigma [N m or N].
    camera: the file of the calibrated camera that took the tracks, with the pose it had: a fit then compares pixels.
    overrides: effect id -> parameters that differ from the drawing in this experiment.
    """

    id: str
    use: Use
    release: Release
    tracks: pd.DataFrame | None = None
    joint_positions: pd.DataFrame | None = None
    inputs: pd.DataFrame | None = None
    joint_efforts: pd.DataFrame | None = None
    video: Path | None = None
    camera: Path | None = None
    overrides: dict[str, dict[str, ParameterValue]] = field(default_factory=dict)


@dataclass(frozen=True)
class Study:
    """A mechanism, its experiments with their tables, and the tolerances of the drawing."""

    mechanism: Mechanism
    experiments: tuple[Experiment, ...]
    tolerances: tuple[Tolerance, ...] = ()
    source: Path | None = None

    @property
    def fit(self) -> tuple[Experiment, ...]:
        """The experiments that parameters may be fitted to."""
        return tuple(experiment for experiment in self.experiments if experiment.use == "fit")

    @property
    def held_out(self) -> tuple[Experiment, ...]:
        """The experiments that only test the fit."""
        return tuple(experiment for experiment in self.experiments if experiment.use == "held_out")

    def nothing_to_fit(self) -> str | None:
        """Why no parameter can be learnt from it: none of its experiments may be fitted."""
        if self.fit:
            return None
        held = len(self.experiments)
        count = "the only experiment is" if held == 1 else f"all {held} experiments are"
        return f'No experiment may be fitted: {count} held_out. Give at least one of them "use": "fit".'

    def experiment(self, id: str) -> Experiment:
        """The experiment of that id; DrawingError listing the known ids otherwise."""
        for experiment in self.experiments:
            if experiment.id == id:
                return experiment
        raise DrawingError(f'there is no experiment "{id}". {known(e.id for e in self.experiments)}')


def driven_effects(study: Study) -> frozenset[str]:
    """Ids of the effects whose value is on record in any experiment."""
    tables = [e.inputs for e in study.experiments if e.inputs is not None]
    return frozenset(str(id) for table in tables for id in table["effect"].unique())


def study_problems(study: StudyFile, mechanism: Mechanism) -> Iterator[str]:
    """What the study file says about parts that the mechanism does not have, or says twice."""
    for id, count in Counter(experiment.id for experiment in study.experiments).items():
        if count > 1:
            yield f'experiment "{id}" stands {count} times in the file; ids are unique: rename all but one'
    effects = {effect.id: effect for effect in mechanism.effects}
    drawn = Drawn.of(mechanism)
    for experiment in study.experiments:
        where = f'experiment "{experiment.id}"'
        if not (experiment.tracks or experiment.joint_positions or experiment.joint_efforts or experiment.video):
            yield f"{where} has 0 tables of measurements; name its tracks, joint_positions or joint_efforts"
        for id, parameters in experiment.overrides.items():
            if id not in effects:
                yield f'{where}: overrides name effect "{id}", which is not drawn. {known(effects)}'
                continue
            effect = effects[id]
            kind = kind_named(effect.kind)
            joints = joints_of(effect, {id: joint.type for id, joint in drawn.joints_of(effect.on).items()})
            faults = parameter_faults(kind, parameters, joints, every=True)  # a torque reaches what turns alone
            faults += [
                f"{name} decides how the effect is built, once for all experiments; draw it so, and remove it here"
                for name in parameters
                if name in kind.choices
            ]
            for fault in faults or order_faults(kind, {**effect.parameters, **parameters}):
                yield f'{where}: override of effect "{id}": {fault}'
    if len(study.tolerances) > MOST_TOLERANCES:
        yield f"{len(study.tolerances)} tolerances are above the limit of {MOST_TOLERANCES}; name several parts in one"
        return
    stated: dict[str, dict[str, tuple[int, float]]] = {}
    for index, tolerance in enumerate(study.tolerances, start=1):
        where = f'tolerance {index} ("{tolerance.kind}")'
        try:
            kind = kind_named(tolerance.kind)
        except ValueError as error:
            yield f"{where}: {error}"
            continue
        for fault in place_faults(drawn, kind, tolerance.on):
            yield f"{where}: {fault}"
        yield from _restated(stated.setdefault(kind.name, {}), index, tolerance)


def twice_set(experiment: ExperimentFile, inputs: pd.DataFrame) -> Iterator[str]:
    """Parameters that an experiment overrides and has on record: the record would act, and the override do nothing."""
    recorded = set(zip(inputs["effect"], inputs["parameter"], strict=True))
    for id, parameters in experiment.overrides.items():
        for name in parameters:
            if (id, name) in recorded:
                yield (
                    f'effect "{id}": {name} is set in overrides and recorded in {experiment.inputs}; a record is what '
                    "acts: remove the override, or those rows"
                )


def _restated(stated: dict[str, tuple[int, float]], index: int, tolerance: Tolerance) -> Iterator[str]:
    """Of a tolerance that takes the place of an earlier one; "all" may come first, and be narrowed part by part.

    stated: part -> number and sd of the tolerance that named it, of one kind; what this one names is added.
    """
    on: tuple[str, ...] = ("all",) if tolerance.on == "all" else tuple(tolerance.on)
    for name in [*stated] if "all" in on else [name for name in on if name in stated]:
        first, sd = stated[name]
        yield (
            f'tolerance {index} ("{tolerance.kind}"): "{name}" has sd {tolerance.sd:g} here and {sd:g} in tolerance '
            f"{first}; keep one"
        )
    stated |= dict.fromkeys(on, (index, tolerance.sd))
