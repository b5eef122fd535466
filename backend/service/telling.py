"""Rows as the API tells them."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any
from urllib.parse import quote

from backend.service.answers import API, ROOMS, FileAnswer, JobAnswer, ListAnswer, ThingAnswer
from backend.service.jobs.desk import progress_of
from backend.service.records import Job, StoredFile, Thing


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
    """A slice as it is told; path: of the list, with what it is asked for by."""
    more = offset + len(items) < total and items
    joined = "&" if "?" in path else "?"
    return ListAnswer(
        items=items, total=total, limit=limit, offset=offset,
        next=f"{path}{joined}limit={limit}&offset={offset + limit}" if more else None,
    )  # fmt: skip


def _when(seconds: float) -> datetime:
    return datetime.fromtimestamp(seconds, UTC)
