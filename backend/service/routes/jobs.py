"""Jobs: asked for, watched, cancelled, their results read."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import AsyncIterator, Callable
from dataclasses import asdict
from typing import Annotated
from uuid import UUID

from fastapi import APIRouter, Body, Depends, Query, Request, Response
from fastapi.concurrency import run_in_threadpool
from sse_starlette import EventSourceResponse, ServerSentEvent

from backend.service.answers import (
    API,
    ID,
    FileAnswer,
    JobAnswer,
    ListAnswer,
    ProgressAnswer,
    ResultAnswer,
)  # fmt: skip
from backend.service.asking import RepeatKey, TheKey, TheOwner, TheService, TheSlice, made, may_fail, the_owner
from backend.service.jobs.desk import (
    cancel_job,
    delete_job,
    find_job,
    job_file,
    job_files,
    job_report,
    list_jobs,
    start_job,
    watch_job,
)  # fmt: skip
from backend.service.jobs.requests import JobRequest
from backend.service.problems import Problem
from backend.service.routes.things import FILE, FilePath, ThePart, send_file
from backend.service.routes.uploads import json_alone
from backend.service.service import Service
from backend.service.states import FINISHED, State
from backend.service.telling import file_answer, job_answer, list_answer

router = APIRouter(prefix="/jobs", tags=["jobs"])
MARKS = [
    {"id": name, "x_m": x_m, "y_m": y_m, "x_px": x_px, "y_px": y_px}
    for name, x_m, y_m, x_px, y_px in (
        ("A", 0.0, 0.0, 60.5, 660.0), ("B", 0.2, 0.0, 460.0, 661.5), ("C", 0.2, 0.1, 459.5, 460.0),
        ("D", 0.0, 0.1, 61.0, 459.0),
    )
]  # fmt: skip
STICK = {"a_px": [20.0, 300.0], "b_px": [620.0, 300.0], "length_m": 0.94}
UPRIGHT = {"x_axis": [1.0, 0.0, 0.0], "y_axis": [0.0, 0.0, 1.0]}
EXAMPLES = {
    "simulate": {"value": {"kind": "simulate", "mechanism": ID, "duration_s": 1.0, "step_s": 0.001}},
    "jam": {"value": {"kind": "jam", "mechanism": ID, "duration_s": 1.0}},
    "fit": {"value": {"kind": "fit", "study": ID, "free": ["coulomb_friction:*"]}},
    "diagnose": {"value": {"kind": "diagnose", "study": ID, "tolerance_mm": 1.0}},
    "track": {"value": {"kind": "track", "video": ID, "mechanism": ID, "bed": {"marks": MARKS}, "clicks": None}},
    "track a part of a clip that somebody else filmed": {
        "value": {
            "kind": "track", "video": ID, "mechanism": ID, "bed": {"stick": STICK, "plane": UPRIGHT},
            "targets": {"elbow": "texture:40", "tip": "texture:40"}, "from_s": 2.0, "to_s": 7.5, "filmed_per_s": 240.0,
        }
    },
}  # fmt: skip
EVENT = {
    "type": "object",
    "properties": {
        "event": {"enum": ["progress", "end"]},
        "id": {"type": "string"},
        "data": {"type": "string", "contentMediaType": "application/json"},
    },
}
_streams: Counter[str] = Counter()


@router.post(
    "", status_code=202,
    responses=made(202, "Taken") | may_fail("not-found", "too-large", "too-slow", "wrong-type", "key-reused"),
    dependencies=[Depends(json_alone)],
)  # fmt: skip
def post_job(
    request: Annotated[JobRequest, Body(openapi_examples=EXAMPLES)],  # pyright: ignore[reportArgumentType]
    response: Response,
    service: TheService,
    owner: TheOwner,
    repeat_key: RepeatKey = None,
) -> JobAnswer:
    """Ask for work.  It is done, once, even if the machine's power is cut after this answer."""
    job = start_job(service, owner, request, repeat_key)
    response.headers["Location"] = f"{API}/jobs/{job.id}"
    return job_answer(job)


@router.get("", responses=may_fail())
def get_jobs(
    service: TheService, owner: TheOwner, part: TheSlice, state: Annotated[State | None, Query()] = None
) -> ListAnswer[JobAnswer]:
    """Your jobs, newest first."""
    page = list_jobs(service, owner, part.limit, part.offset, state)
    told = [job_answer(job) for job in page.rows]
    path = f"{API}/jobs" if state is None else f"{API}/jobs?state={state}"
    return list_answer(told, page.total, part.limit, part.offset, path)


@router.get("/{id}", responses=may_fail("not-found"))
def get_job(id: UUID, service: TheService, owner: TheOwner) -> JobAnswer:
    """One job, and how far it is."""
    return job_answer(find_job(service, owner, str(id)))


@router.delete("/{id}", responses=may_fail("not-found"), response_model=JobAnswer | None)
def delete(
    id: UUID,
    service: TheService,
    owner: TheOwner,
    response: Response,
    forget: Annotated[bool, Query(description="Delete a finished job with what it wrote.")] = False,
) -> JobAnswer | None:
    """Cancel a job: its work ends within two seconds.  With `forget`, delete it too."""
    job = cancel_job(service, owner, str(id))
    if forget:
        delete_job(service, owner, job.id)
    return job_answer(job)


@router.get(
    "/{id}/events",
    response_class=EventSourceResponse,
    responses={
        **may_fail("not-found", "too-many-jobs"),
        200: {
            "description": "`progress` events with data as ProgressAnswer, at every change, then one `end`.",
            "content": {"text/event-stream": {"schema": EVENT}},
        },
    },
)
async def get_events(
    request: Request, shown: TheKey, id: UUID, service: TheService, owner: TheOwner
) -> EventSourceResponse:
    """The job's progress as server-sent events, until it has finished."""
    job = await run_in_threadpool(find_job, service, owner, str(id))
    if _streams[owner] >= service.settings.event_streams_per_owner:
        raise Problem(
            "too-many-jobs", f"{_streams[owner]} event streams are open; close one.", headers={"Retry-After": "5"}
        )
    events = _events(service, owner, job.id, lambda: the_owner(request, shown))
    return EventSourceResponse(events, ping=15, headers={"X-Accel-Buffering": "no"})


@router.get("/{id}/result", responses=may_fail("not-found", "not-finished", "no-result"))
def get_result(id: UUID, service: TheService, owner: TheOwner) -> ResultAnswer:
    """What a finished job found: the command's own report, and the files it wrote."""
    report = job_report(service, owner, str(id))
    job = find_job(service, owner, str(id))
    return ResultAnswer(job=job_answer(job), report=report, files=get_files(id, service, owner))


@router.get("/{id}/files", responses=may_fail("not-found"))
def get_files(id: UUID, service: TheService, owner: TheOwner) -> list[FileAnswer]:
    """What the job wrote: reports, pages, motions."""
    return [file_answer(file, f"{API}/jobs/{id}") for file in job_files(service, owner, str(id))]


@router.get("/{id}/files/{path:path}", response_class=Response, responses=FILE)
def get_file(id: UUID, path: FilePath, service: TheService, owner: TheOwner, asked: ThePart) -> Response:
    """One file that the job wrote."""
    return send_file(service, job_file(service, owner, str(id), path), asked)


async def _events(service: Service, owner: str, id: str, may: Callable[[], object]) -> AsyncIterator[ServerSentEvent]:
    _streams[owner] += 1
    try:
        number = 0
        async for progress in watch_job(service, owner, id, may=may):
            number += 1
            told = ProgressAnswer(**asdict(progress))  # pyright: ignore[reportArgumentType]
            event = "end" if progress.state in FINISHED else "progress"
            yield ServerSentEvent(data=json.dumps(told.model_dump()), event=event, id=str(number))
    except Problem:
        return  # deleted, or the key revoked, while it was watched
    finally:
        _streams[owner] -= 1
