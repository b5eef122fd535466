"""The drawing with what a fit found written into its effects."""

import numpy as np

from backend.fit.free import free_parameters
from backend.mechanism.apart import set_apart
from backend.mechanism.effect import Effect, kind_named
from backend.mechanism.fit_report import FitReport
from backend.mechanism.mechanism import Mechanism


def fitted(mechanism: Mechanism, report: FitReport) -> Mechanism:
    """The fitted twin as a drawing: values of fit.json stand in the effects drawn, or in new ones beside them.

    A parameter's name in fit.json is the `--free` that freed it, so the same reading finds its effects.  Raises
    ValueError where a name does not belong to this drawing: fit.json and mechanism.json are of different mechanisms.
    """
    mechanism = set_apart(mechanism)
    try:
        freedom = free_parameters(mechanism, [parameter.name for parameter in report.parameters])
    except ValueError as error:
        raise ValueError(
            f"fit.json does not belong to '{mechanism.name}': {str(error).removeprefix('--free ')} "
            "Give the mechanism.json that was fitted."
        ) from None
    values = {parameter.name: parameter.value for parameter in report.parameters}
    found: dict[str, dict[str, float]] = {}
    for free in freedom.parameters:
        for effect, name in free.addresses:
            found.setdefault(effect, {})[name] = values[free.name]
    effects = [*mechanism.effects, *freedom.added]
    return mechanism.model_copy(
        update={"effects": tuple(_with(effect, found.get(effect.id, {})) for effect in effects)}
    )


def _with(effect: Effect, values: dict[str, float]) -> Effect:
    parameters, kind = dict(effect.parameters), kind_named(effect.kind)
    for name, value in values.items():
        whole, of_several, at = name.partition("[")
        if not of_several:
            parameters[name] = value
            continue
        spec = kind.parameters[whole]
        numbers = np.broadcast_to(np.asarray(parameters.get(whole, spec.default), float), spec.size).copy()
        numbers[int(at[:-1])] = value
        parameters[whole] = tuple(map(float, numbers))
    return effect.model_copy(update={"parameters": parameters})
