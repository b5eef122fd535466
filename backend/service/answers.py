"""What the API answers with."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any, Generic, Literal, TypeVar
from urllib.parse import quote

from pydantic import BaseModel, ConfigDict, Field

from backend.service.jobs.desk import progress_of
from backend.service.records import Job, State, StoredFile, Thing

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
    kind: Literal["mechanism", "study", "video"]
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


def thing_answer(thing: Thing, files: Sequence[StoredFile] | None = None) -> ThingAnswer:
    """A thing as it is told."""
    base = f"{API}/{ROOMS[thing.kind]}/{thing.id}"
    return ThingAnswer(
        id=thing.id,
        kind=thing.kind,  # pyright: ignore[reportArgumentType]
        name=thing.name,
        bytes=thing.bytes,
        created=_when(thing.created),
        summary=thing.summary,
        files=None if files is None else [file_answer(file, base) for file in files],
    )


def job_answer(job: Job) -> JobAnswer:
    """A job as it is told."""
    progress = progress_of(job)
    return JobAnswer.model_validate(
        {
            **job.model_dump(include={"id", "kind", "request", "attempt", "exit_code", "message"}),
            **{name: _when(at) if (at := getattr(job, name)) else None for name in ("created", "started", "finished")},
            **vars(progress),
        }
    )


def file_answer(file: StoredFile, base: str) -> FileAnswer:
    """A file as it is told; base: the address of what it belongs to."""
    return FileAnswer(
        path=file.path, bytes=file.bytes, sha256=file.sha256, media_type=file.media_type,
        url=f"{base}/files/{quote(file.path)}",
    )  # fmt: skip


def list_answer(items: list[Any], total: int, limit: int, offset: int, path: str) -> ListAnswer[Any]:
    """A slice as it is told; path: of the list."""
    more = offset + len(items) < total and items
    return ListAnswer(
        items=items, total=total, limit=limit, offset=offset,
        next=f"{path}?limit={limit}&offset={offset + limit}" if more else None,
    )  # fmt: skip


def _when(seconds: float) -> datetime:
    return datetime.fromtimestamp(seconds, UTC)
