"""The sim-to-real gap: gap.json."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from backend.mechanism.effect import Places
from backend.mechanism.part import Id, Part

Verdict = Literal["none", "identified", "ambiguous", "approximate", "unknown"]
Interval = Annotated[tuple[float, float], Field(strict=False)]
Probability = Annotated[float, Field(ge=0.0, le=1.0)]


class Location(Part):
    """A place and how probably the gap lies there.

    at: `joint:ID`, `body:ID`, `marker:ID`, `effect:ID`, `camera` or `world`.
    """

    at: Id
    probability: Probability


class Phase(Part):
    """A stretch of an experiment in which something is missing at a place: its mean over the stretch, in `unit`."""

    experiment: Id
    at: Id
    start_s: float
    end_s: float
    missing: float
    sd: float
    unit: str


class MarkerGap(Part):
    """How far one marker is from where the drawing says it should be, beside its noise [m]."""

    marker: Id
    rms_m: float
    noise_m: float


class JointGap(Part):
    """How far one encoder is from what the drawing says, beside its noise, in `unit`."""

    joint: Id
    rms: float
    noise: float
    unit: str


class Where(Part):
    """Where the gap lies. locations: from the causes and, as far as they are unknown, model-free; they sum to 1, also
    where there is no gap: then they say where one would most likely be.

    model_free: the same from unknown forces and shifts alone, whatever the library says.
    """

    locations: list[Location] = Field(default_factory=list)
    phases: list[Phase] = Field(default_factory=list)
    markers: list[MarkerGap] = Field(default_factory=list)
    joints: list[JointGap] = Field(default_factory=list)
    model_free: list[Location] = Field(default_factory=list)


class Amount(Part):
    """One number of a cause, in the parameter's own unit; sd widened by what the model still misses."""

    value: float
    sd: float | None = None
    unit: str = ""
    ci95: Interval | None = None


class CauseEffect(Part):
    """One effect of a cause."""

    kind: Id
    on: Places
    parameters: dict[str, Amount]


class CauseSet(Part):
    """One explanation: one effect, or several at once. indistinguishable_from: `[kind, place]` of its aliases."""

    effects: list[CauseEffect]
    probability: Probability
    log_evidence: float
    indistinguishable_from: list[list[str]] = Field(default_factory=list)
    adequate: bool = True


class Remainder(Part):
    """Rms of the gap [m, or rad where only encoders measured] before and after the best cause, beside the noise."""

    before_rms_m: float
    after_rms_m: float
    noise_rms_m: float


class HeldOut(Remainder):
    """On experiments that no cause was fitted to. The fraction is null where there was no gap to explain."""

    explained_fraction: float | None = None
    explained_fraction_ci95: Interval | None = None


class Shrink(Part):
    """How far the gap shrinks once the best cause is added. unit: of the rms figures, `m` or `rad`."""

    held_out: HeldOut | None = None
    fit: Remainder | None = None
    unit: str = "m"


class Detectable(Part):
    """Smallest amount of an effect that these data could have shown."""

    kind: Id
    on: Places
    parameter: str
    minimum: float
    unit: str


class EffectNumber(Part):
    """One number of an effect at one place."""

    kind: Id
    on: Places
    parameter: str


class NextExperiment(Part):
    """What to do next. expected_d2: how far apart the causes would then be, in squared standard deviations."""

    separates: list[list[str]]
    do: str
    expected_d2: float | None = None


class GapReport(Part):
    """gap.json."""

    schema_version: Literal["1.0"] = "1.0"
    verdict: Verdict
    sentence: str
    where: Where
    causes: list[CauseSet]
    probability_none: Probability
    probability_unknown: Probability
    p_value: float
    shrink: Shrink
    detectable: list[Detectable]
    inseparable: list[list[EffectNumber]] = Field(default_factory=list)
    """Groups of effects of which these data would show the same motion, whichever of them were there."""
    next_experiment: NextExperiment | None = None
    warnings: list[str] = Field(default_factory=list)
    tolerance_m: float | None = None
    wall_s: float = 0.0

    @property
    def suspected(self) -> list[Location]:
        """Where the gap lies; nowhere if there is none."""
        return [] if self.verdict == "none" else self.where.locations
