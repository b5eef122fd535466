"""Jobs as their owner sees them: started, watched, cancelled, listed, their files read, deleted."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from typing import Any

from sqlmodel import Session, col, func, select, update

from backend.observe.carried import read_targets
from backend.observe.tracking_error import TrackingError
from backend.service.jobs.requests import DiagnoseRequest, FitRequest, JamRequest, SimulateRequest, TrackRequest
from backend.service.mechanisms import MOST_TOLD
from backend.service.problems import Problem, not_found
from backend.service.records import Job, StoredFile, Thing
from backend.service.repeats import forget, made_before, remember
from backend.service.service import Service
from backend.service.states import FINISHED, Kind
from backend.service.things import Page, drop_files, file_of, files_of, locked_account, page, refund

AnyRequest = SimulateRequest | JamRequest | FitRequest | DiagnoseRequest | TrackRequest
REPORT = "report.json"
MAY_EVERY_S = 3.0  # a key that was revoked meanwhile ends a watching
INPUTS: dict[str, Kind] = {"mechanism": "mechanism", "study": "study", "video": "video"}


@dataclass(frozen=True)
class Progress:
    """How far a job is.  part: 0 to 1.  remaining_s: a guess [s], None before there is anything to guess from."""

    state: str
    part: float
    words: str
    elapsed_s: float
    remaining_s: float | None


def start_job(service: Service, owner: str, request: AnyRequest, repeat_key: str | None = None) -> Job:
    """Ask for work; it is done even if every process dies after this returns.

    repeat_key: the same key with the same request gives the job made the first time.  Raises Problem: an input that is
    not the owner's, too many jobs at once, a key that stood for another request.
    """
    told = request.model_dump(mode="json")
    with service.database.writing() as session:
        locked_account(session, owner)
        if (made := made_before(session, owner, repeat_key, told)) is not None:
            return session.get_one(Job, made)
        for field, kind in INPUTS.items():
            if (id := told.get(field)) is not None:
                thing = session.get(Thing, id)
                if thing is None or thing.owner != owner or thing.kind != kind:
                    raise not_found(kind, id)
                if isinstance(request, TrackRequest) and kind == "mechanism":
                    _refuse_unknown_markers(request, thing.summary["markers"])
        _refuse_too_many(service, session, owner)
        job = Job(owner=owner, kind=request.kind, request=told)
        session.add(job)
        remember(session, owner, repeat_key, told, job.id)
    return job


def find_job(service: Service, owner: str, id: str) -> Job:
    """One job of this owner; Problem `not-found` otherwise."""
    with service.database.reading() as session:
        job = session.get(Job, id)
    if job is None or job.owner != owner:
        raise not_found("job", id)
    return job


def list_jobs(service: Service, owner: str, limit: int = 50, offset: int = 0, state: str | None = None) -> Page:
    """This owner's jobs, newest first."""
    where = (Job.owner == owner,) if state is None else (Job.owner == owner, Job.state == state)
    with service.database.reading() as session:
        return page(session, Job, where, limit, offset)


def cancel_job(service: Service, owner: str, id: str) -> Job:
    """End a job; its worker sees it within a second and ends the work.  A finished job stays as it is."""
    find_job(service, owner, id)
    with service.database.writing() as session:
        session.execute(
            update(Job)
            .where(col(Job.id) == id, col(Job.state).in_(("queued", "running")))
            .values(state="cancelled", finished=time.time(), message="Cancelled.")
        )
    return find_job(service, owner, id)


def delete_job(service: Service, owner: str, id: str) -> None:
    """Forget a finished job and what it wrote; Problem `not-finished` before."""
    job = find_job(service, owner, id)
    if job.state not in FINISHED:
        raise Problem("not-finished", f"The job is {job.state}; cancel it first.")
    forget_job(service, job)


def forget_job(service: Service, job: Job) -> None:
    """Drop a finished job's record, files and Idempotency-Key."""
    with service.database.writing() as session:
        locked_account(session, job.owner)  # whoever forgets it too finds it gone
        if (there := session.get(Job, job.id)) is None:
            return
        keys = drop_files(session, job.id)
        forget(session, job.id)
        session.delete(there)
        refund(session, job.owner, there.bytes)
    service.storage.let_go(keys)


def progress_of(job: Job) -> Progress:
    """How far it is, and how long it may still take."""
    now = job.finished or time.time()
    elapsed_s = max(0.0, now - job.started) if job.started else 0.0
    known = job.state == "running" and job.part > 0.02
    remaining_s = elapsed_s * (1.0 - job.part) / job.part if known else None
    return Progress(job.state, job.part, job.words, elapsed_s, 0.0 if job.state in FINISHED else remaining_s)


async def watch_job(
    service: Service, owner: str, id: str, every_s: float = 0.3, may: Callable[[], object] = lambda: None
) -> AsyncIterator[Progress]:
    """Its progress now and at every change, until it has finished.  Raises Problem `not-found`.

    may: asked every few seconds; the Problem that it raises ends the watching.
    """
    last: tuple[Any, ...] | None = None
    asked = time.monotonic()
    while True:
        if time.monotonic() - asked > MAY_EVERY_S:
            await asyncio.to_thread(may)
            asked = time.monotonic()
        job = await asyncio.to_thread(find_job, service, owner, id)
        if (seen := (job.state, round(job.part, 3), job.words)) != last:
            last = seen
            yield progress_of(job)
        if job.state in FINISHED:
            return
        await asyncio.sleep(every_s)


def job_files(service: Service, owner: str, id: str) -> list[StoredFile]:
    """What a job wrote, by path."""
    return files_of(service, find_job(service, owner, id).id)


def job_file(service: Service, owner: str, id: str, path: str) -> StoredFile:
    """One file that a job wrote; Problem `not-found` naming those there are."""
    return file_of(service, find_job(service, owner, id).id, path)


def job_report(service: Service, owner: str, id: str) -> dict[str, Any]:
    """The report that the command printed: gap.json, fit.json and so on.

    Raises Problem: `not-finished` before its end, `no-result` where it ended without one.
    """
    job = find_job(service, owner, id)
    if job.state not in FINISHED:
        raise Problem("not-finished", f"The job is {job.state}; wait for its events to end, then ask again.")
    for file in files_of(service, job.id):
        if file.path == REPORT:
            return json.loads(service.storage.read(file.key))
    raise Problem("no-result", job.message or f"The job ended as {job.state} and wrote no report.")


def _refuse_unknown_markers(request: TrackRequest, markers: list[str]) -> None:
    if len(markers) == MOST_TOLD:  # there may be more of them: the command itself will say
        return
    try:
        read_targets(request.targets, markers)
    except TrackingError as error:
        raise Problem("invalid", str(error)[:2000]) from None
    if strangers := sorted(set(request.clicks or {}) - set(markers)):
        raise Problem(
            "invalid", f"Clicks name {', '.join(strangers)[:500]}; the drawing has {', '.join(markers) or 'no marker'}."
        )


def _refuse_too_many(service: Service, session: Session, owner: str) -> None:
    granted = service.settings.active_jobs_per_owner
    waiting = select(func.count()).select_from(Job).where(Job.owner == owner, col(Job.state).not_in(FINISHED))
    if (active := session.exec(waiting).one()) >= granted:
        raise Problem(
            "too-many-jobs",
            f"{active} jobs are waiting or running, and {granted} are granted; wait for one to end, or cancel one.",
            headers={"Retry-After": "10"},
        )
