"""What came of an ensemble of jams: jam_ensemble.json."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from backend.mechanism.part import Id, Part

Interval = Annotated[tuple[float, float], Field(strict=False)]
Values = Annotated[tuple[float, ...], Field(strict=False)]
Flags = Annotated[tuple[bool, ...], Field(strict=False)]
Sentences = Annotated[tuple[str, ...], Field(strict=False)]


class Share(Part):
    """A Sobol' index with its 95% bootstrap interval: a share of the variance of jammed (1) or free (0)."""

    value: float
    ci95: Interval


class VariedParameter(Part):
    """One number that scattered.

    name: `KIND:ON.PARAMETER`. distribution: as asked for, SI. within: share of it inside the parameter's bounds, from
    which alone samples come. first_order: what it does alone; total: with all that it does together with others; null
    where there are no indices.
    """

    name: str
    unit: str
    distribution: str
    within: float
    first_order: Share | None = None
    total: Share | None = None


class ShownSamples(Part):
    """Some of the independent samples, for pictures. values: one row a parameter, SI, entries per sample."""

    values: Annotated[tuple[Values, ...], Field(strict=False)]
    jammed: Flags
    lost: Flags


class Throughput(Part):
    """How fast it went. samples_per_s: after the first chunk, whose compile time is first_chunk_s; null for one chunk.

    chunks: done since the last --resume, none where all were kept.  processes: what did the work, in words.
    """

    wall_s: float
    first_chunk_s: float
    samples_per_s: float | None
    chunk: int
    chunks: int
    processes: str


class EnsembleReport(Part):
    """jam_ensemble.json: how likely it jams, and what drives that.

    samples: all that were simulated. independent: those of them that the probability counts, lost ones left out
    (the mixed matrices of the indices repeat their values). jammed: of the independent. probability_ci95: Wilson.
    probability_range: if none, and if every lost one of the independent samples jammed. lost: of all samples, since
    loops could not be closed or a step could not be solved. index_rows: rows of the index matrices that were used.
    onset_s: 5, 50 and 95% quantiles of since when the jammed ones rest; null where none jams.
    """

    schema_version: Literal["1.0"] = "1.0"
    mechanism: Id
    sentence: str
    warnings: Sentences = ()
    samples: int
    independent: int
    jammed: int
    lost: int
    probability: float
    probability_ci95: Interval
    probability_range: Interval
    onset_s: Annotated[tuple[float, float, float], Field(strict=False)] | None = None
    parameters: Annotated[tuple[VariedParameter, ...], Field(strict=False)]
    index_rows: int
    seed: int
    duration_s: float
    step_s: float
    shown: ShownSamples
    throughput: Throughput
