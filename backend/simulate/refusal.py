"""What a simulation would refuse of a drawing that can be read: found by building it as a simulation does."""

from collections.abc import Iterator

from backend.effects.shapes import AbstractJointMotion, AbstractJointStop
from backend.mechanism.drawing_error import DrawingError
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.study import Study
from backend.model.build import build
from backend.model.model import Model
from backend.model.system import system
from backend.simulate.record import on_steps, series_of
from backend.simulate.standing import check_drives, check_ends


def refusals(mechanism: Mechanism) -> list[str]:
    """Why a drawing cannot be let go as it is drawn; empty where it can."""
    try:
        return list(_misplaced(build(mechanism)))
    except ValueError as error:
        return _said(error)


def study_refusals(study: Study) -> list[str]:
    """Why the experiments of a study cannot be followed.  Where each begins its data say, not the drawing."""
    try:
        return list(_undrivable(study, build(study.mechanism)))
    except ValueError as error:
        return _said(error)


def _misplaced(model: Model) -> Iterator[str]:
    for shape, check in ((AbstractJointMotion, check_drives), (AbstractJointStop, check_ends)):
        if model.of(shape):
            try:
                check(model, system(model))
            except ValueError as error:
                yield from _said(error)


def _undrivable(study: Study, model: Model) -> Iterator[str]:
    for experiment in study.experiments:
        try:
            model.overridden(experiment.overrides)
            if series := series_of(experiment):
                on_steps(model, series, 1.0, 1)
        except ValueError as error:
            yield from (f"experiment '{experiment.id}': {sentence}" for sentence in _said(error))


def _said(error: ValueError) -> list[str]:
    return list(error.problems) if isinstance(error, DrawingError) else [str(error)]
