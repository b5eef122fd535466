"""What the API answers with; nothing but pydantic is loaded, so that clients read it too."""

from __future__ import annotations

from datetime import datetime
from typing import Any, Generic, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field

from backend.service.states import Kind, State

API = "/api/v1"
ROOMS = {"mechanism": "mechanisms", "study": "studies", "video": "videos"}
Item = TypeVar("Item")
ID = "0b6d2f0e-6c1b-4a7e-9a53-0d7f6f1f3c55"
WHEN = "2026-11-22T08:30:00Z"


class Answer(BaseModel):
    """Base of all answers."""

    model_config = ConfigDict(frozen=True)


class FileAnswer(Answer):
    """One stored file."""

    path: str = Field(examples=["gap.json"])
    bytes: int = Field(examples=[18234])
    sha256: str
    media_type: str = Field(examples=["application/json"])
    url: str = Field(examples=[f"{API}/jobs/{ID}/files/gap.json"])


class ThingAnswer(Answer):
    """A stored mechanism, study or video."""

    id: str = Field(examples=[ID])
    kind: Kind
    name: str = Field(examples=["fourbar"])
    bytes: int
    created: datetime = Field(examples=[WHEN])
    summary: dict[str, Any] = Field(examples=[{"name": "fourbar", "bodies": 4, "joints": 4}])
    files: list[FileAnswer] | None = Field(default=None, description="Told for one, not in lists.")


class JobAnswer(Answer):
    """A job: what was asked, and how far it is."""

    id: str = Field(examples=[ID])
    kind: Literal["track", "fit", "jam", "diagnose", "simulate"]
    state: State
    request: dict[str, Any] = Field(examples=[{"kind": "simulate", "mechanism": ID, "duration_s": 1.0}])
    created: datetime = Field(examples=[WHEN])
    started: datetime | None = None
    finished: datetime | None = None
    part: float = Field(description="Of the work done, 0 to 1.", examples=[0.4])
    words: str = Field(description="What is being done.", examples=["letting it go"])
    elapsed_s: float
    remaining_s: float | None = Field(description="A guess; null while there is nothing to guess from.")
    attempt: int = Field(description="How often it was begun; above 1 where a worker died.")
    exit_code: int | None = Field(description="Of the command: 0 done, 1 the work failed, 2 bad input.")
    message: str = Field(description="Why it failed, and what to do.")


class ProgressAnswer(Answer):
    """The data of one server-sent event."""

    state: State
    part: float
    words: str
    elapsed_s: float
    remaining_s: float | None


class ResultAnswer(Answer):
    """What a finished job found: the report of its command, and the files it wrote."""

    job: JobAnswer
    report: dict[str, Any]
    files: list[FileAnswer]


class ListAnswer(Answer, Generic[Item]):
    """A slice of a list, newest first."""

    items: list[Item]
    total: int
    limit: int
    offset: int
    next: str | None = Field(description="Where the next slice is; null at the end.")


class HealthAnswer(Answer):
    """Whether the service works."""

    status: Literal["ok"]
    workers: int = Field(description="Workers with a heartbeat.")
    waiting: int = Field(description="Jobs not yet begun.")
    running: int


class ProblemAnswer(BaseModel):
    """RFC 9457: what went wrong, and what to do."""

    type: str = Field(examples=["https://linktwin.invalid/problems/not-found"])
    title: str
    status: int
    detail: str
    instance: str | None = None
    errors: list[str] | None = Field(default=None, description="Each fault with its remedy, where there are several.")
