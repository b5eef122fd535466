"""What a fit found: fit.json."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from backend.mechanism.effect import Places
from backend.mechanism.part import Id, Part
from backend.mechanism.study import Use

Interval = Annotated[tuple[float | None, float | None], Field(strict=False)]


class FittedParameter(Part):
    """One fitted number, in `unit`.

    name: `kind:on.parameter`, the name that correlation, identifiability and history use.
    sd: from noise and misfit. ci95: also allows for what is `unstated`. Both are null where the data do not bound it.
    at_bound: the optimum lies on a declared bound.
    """

    name: Id
    kind: Id
    on: Places
    parameter: Id
    value: float
    sd: float | None = None
    ci95: Interval | None = None
    unit: str
    at_bound: bool = False


class Identifiability(Part):
    """How well the data determine one parameter.

    information: diagonal of the Fisher information [1/unit²]. profile: likelihood interval of 95%.
    weakest_direction: parameters (in units of their scale) that can change together with little effect.
    """

    name: Id
    information: float
    profile: Interval | None = None
    weakest_direction: dict[str, float] | None = None
    warning: str | None = None


class Iteration(Part):
    """One step of the optimiser."""

    iteration: int
    objective: float
    gradient_norm: float
    parameters: dict[str, float]


class Residual(Part):
    """Root mean square error of one marker or joint in one experiment, in `unit`.

    at: `marker:ID` or `joint:ID`. before: with the drawing as it was. noise: of the measurement.
    """

    experiment: Id
    use: Use = "fit"
    at: Id
    rms: float
    before: float | None = None
    noise: float | None = None
    unit: str
    count: int


class Deviation(Part):
    """A place whose value differs from the one its kind shares elsewhere, by `difference` in `unit`.

    name, others: the parameters of the two. could_be: places that explain the data as well in its stead.
    """

    name: Id
    others: Id
    difference: float
    sd: float | None = None
    unit: str
    could_be: Annotated[tuple[Id, ...], Field(strict=False)] = ()


class Unstated(Part):
    """A parameter that nobody stated, held at a default; intervals allow for all values from `held` to `up_to`.

    name: as `--free` takes it. shifts: how far each fitted value moves when it goes all that way.
    """

    name: Id
    held: float
    up_to: float
    unit: str
    shifts: dict[str, float]


class CameraNumber(Part):
    """One number of a calibrated camera, in `unit`: as calibrated, and as the fit moved it.

    name: of the lens (fx_px, ..., k3), the pose (turns count from the calibrated pose, about the camera's own axes), or
    `height_m of MARKER`.
    """

    name: Id
    value: float
    sd: float
    calibrated: float
    calibrated_sd: float
    unit: str


class FittedCamera(Part):
    """A camera file that fitted experiments name, and what the fit says of it."""

    file: Id
    experiments: Annotated[tuple[Id, ...], Field(strict=False)]
    numbers: Annotated[tuple[CameraNumber, ...], Field(strict=False)]


class FitReport(Part):
    """fit.json. `correlation` is a matrix in the order of `parameters`; null where not determined."""

    schema_version: Literal["1.0", "1.1", "1.2"] = "1.2"
    parameters: Annotated[tuple[FittedParameter, ...], Field(strict=False)]
    correlation: Annotated[
        tuple[Annotated[tuple[float | None, ...], Field(strict=False)], ...], Field(strict=False)
    ] = ()
    identifiability: Annotated[tuple[Identifiability, ...], Field(strict=False)] = ()
    history: Annotated[tuple[Iteration, ...], Field(strict=False)] = ()
    residuals: Annotated[tuple[Residual, ...], Field(strict=False)] = ()
    held_out: Annotated[tuple[Residual, ...], Field(strict=False)] = ()
    deviations: Annotated[tuple[Deviation, ...], Field(strict=False)] = ()
    cameras: Annotated[tuple[FittedCamera, ...], Field(strict=False)] = ()
    unstated: Annotated[tuple[Unstated, ...], Field(strict=False)] = ()
    converged: bool
    wall_s: Annotated[float, Field(ge=0.0)]
    message: str = ""
    warnings: Annotated[tuple[str, ...], Field(strict=False)] = ()
