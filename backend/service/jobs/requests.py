"""What can be asked of the service: each kind of job with its options, the same as the command's."""

from __future__ import annotations

import json
from typing import Annotated, Any, Literal
from uuid import UUID

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from backend.observe.bed import read_bed
from backend.observe.carried import read_targets

MOST_STEPS = 2_000_000
MOST_MARKS = 1000


def _printable(value: str) -> str:
    if not value.strip() or not value.isprintable():
        raise ValueError("has no visible character, or one that cannot be printed; write it plainly")
    return value


def _writable(value: Any) -> Any:
    try:
        json.dumps(value, ensure_ascii=False, allow_nan=False).encode()
    except (ValueError, RecursionError) as error:
        raise ValueError(f"cannot be written as JSON ({error}); keep to finite numbers and plain text") from None
    return value


def _bed(value: Any) -> Any:
    """A bed as `linktwin track` reads it from a file; refused with the tracker's own sentence."""
    told = value if isinstance(value, dict) else {"marks": value}
    if isinstance(told.get("camera"), str):
        raise ValueError("camera names a file; give what stands in it, as linktwin calibrate wrote it")
    for of in ("marks", "tags"):
        if isinstance(told.get(of), list) and len(told[of]) > MOST_MARKS:
            raise ValueError(f"{len(told[of])} {of} are above {MOST_MARKS}; leave some out")
    try:
        with np.errstate(all="ignore"):
            read_bed(value)
    except np.linalg.LinAlgError:
        raise ValueError("the marks' places cannot be reckoned with; give metres and pixels") from None
    return value


def _targets(value: dict[str, Any] | None) -> dict[str, Any] | None:
    read_targets(value, list(value or {}))  # whether these are the drawing's markers is seen when it is known
    return value


Seconds = Annotated[float, Field(gt=0.0, le=3600.0)]
Step = Annotated[float, Field(ge=1e-6, le=0.1)]
Tag = Annotated[int, Field(ge=0, le=10**6, strict=True)]
Line = Annotated[str, Field(min_length=1, max_length=200), AfterValidator(_printable)]


class Request(BaseModel):
    """Base: no unknown fields, no infinities."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class _Motion(Request):
    duration_s: Seconds = 1.0
    step_s: Step = 1e-3

    @model_validator(mode="after")
    def _in_bounds(self) -> _Motion:
        if self.duration_s / self.step_s > MOST_STEPS:
            raise ValueError(f"{self.duration_s / self.step_s:.0f} steps are above {MOST_STEPS}; take longer ones")
        return self


class SimulateRequest(_Motion):
    """Let a stored mechanism go: `linktwin simulate`."""

    kind: Literal["simulate"]
    mechanism: Annotated[UUID, Field(description="Id of a stored mechanism.")]
    solve: Literal["compliance", "reduced"] = "compliance"
    threshold: Annotated[float, Field(gt=0.0, lt=1.0)] | None = None


class JamRequest(Request):
    """Whether it jams, from the drawn pose or from each experiment's start: `linktwin jam`."""

    kind: Literal["jam"]
    mechanism: Annotated[UUID, Field(description="Id of a stored mechanism; or give a study.")] | None = None
    study: Annotated[UUID, Field(description="Id of a stored study; or give a mechanism.")] | None = None
    duration_s: Seconds | None = None
    step_s: Step = 1e-3
    samples: Annotated[int, Field(ge=1, le=1_000_000)] | None = None
    vary: Annotated[list[Line], Field(max_length=50)] = []
    seed: Annotated[int, Field(ge=0, le=2**31)] = 0

    @model_validator(mode="after")
    def _one_subject(self) -> JamRequest:
        if (self.mechanism is None) == (self.study is None):
            raise ValueError("give either a mechanism or a study")
        if (self.samples is not None or self.vary) and self.mechanism is None:
            raise ValueError("samples are let go from the drawn pose; give a mechanism")
        if self.vary and self.samples is None:
            raise ValueError("vary needs to know how many samples to draw; give samples")
        return self


class FitRequest(Request):
    """Fit what the drawing leaves open: `linktwin fit`."""

    kind: Literal["fit"]
    study: Annotated[UUID, Field(description="Id of a stored study.")]
    free: Annotated[list[Line], Field(min_length=1, max_length=200, description="KIND:ON[.PARAMETER]; * is every one.")]
    optimiser: Literal["lm", "lbfgsb"] = "lm"
    loss: Literal["linear", "soft_l1", "huber", "student"] = "linear"
    noise: Literal["white", "ar1"] = "white"
    starts: Annotated[int, Field(ge=0, le=1000)] = 0
    sparse: bool = False
    step_s: Step | None = None


class DiagnoseRequest(Request):
    """Say why the real one differs: `linktwin diagnose`."""

    kind: Literal["diagnose"]
    study: Annotated[UUID, Field(description="Id of a stored study.")]
    tolerance_mm: Annotated[float, Field(ge=0.0)] | None = None
    minutes: Annotated[float, Field(ge=0.0, description="After which the search ends; 0: never.")] | None = None
    without: Annotated[list[Line], Field(max_length=100)] = []


class TrackRequest(Request):
    """Measure where the markers went in a clip: `linktwin track`."""

    kind: Literal["track"]
    video: Annotated[UUID, Field(description="Id of a stored video.")]
    mechanism: Annotated[UUID, Field(description="Id of a stored mechanism: names the markers.")]
    bed: Annotated[
        dict[str, Any] | list[Any],
        AfterValidator(_writable),
        AfterValidator(_bed),
        Field(
            description="What a bed file holds: marks, in metres and pixels, or tags, or a stick where one length is "
            "known; plane, lens or camera, heights."
        ),
    ]
    clicks: Annotated[
        Annotated[dict[str, tuple[float, float]], Field(max_length=1000)] | None,
        AfterValidator(_writable),
        Field(description="Marker to pixel (x, y) in the first frame that is followed."),
    ] = None
    targets: Annotated[
        Annotated[dict[str, Tag | Annotated[str, Field(max_length=40)]], Field(max_length=1000)] | None,
        AfterValidator(_writable),
        AfterValidator(_targets),
        Field(
            description="Marker to the tag that it carries in place of a coloured dot; or the same of every marker: "
            "`dark` (a dot without a colour), `patch` (a coloured area of any shape), `texture` or `texture:40` "
            "(nothing is stuck there; 40 pixels round about count)."
        ),
    ] = None
    from_s: Annotated[float, Field(ge=0.0, le=1e6, description="Where to begin, as a player shows it.")] = 0.0
    to_s: Annotated[float, Field(ge=0.0, le=1e6, description="Where to end, as a player shows it.")] | None = None
    filmed_per_s: (
        Annotated[
            float, Field(ge=1.0, le=1e6, description="Frames a second of slow motion that does not note its rate.")
        ]
        | None
    ) = None
    keep_truncated: bool = False
    coast_s: Annotated[
        float, Field(ge=0.0, le=1e6, description="Gaps up to this long are filled with predictions, marked as such.")
    ] = 0.0

    @model_validator(mode="after")
    def _some_part(self) -> TrackRequest:
        if self.to_s is not None and self.to_s <= self.from_s:
            raise ValueError(f"from_s {self.from_s:g} is not before to_s {self.to_s:g}; give a part of the clip")
        return self


JobRequest = Annotated[
    SimulateRequest | JamRequest | FitRequest | DiagnoseRequest | TrackRequest, Field(discriminator="kind")
]
