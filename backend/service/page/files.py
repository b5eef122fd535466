"""Files for the browser: meshes, clips, pictures, reports, and all of a result as one archive."""

from __future__ import annotations

import asyncio
import tempfile
import zipfile
from pathlib import Path
from typing import Annotated, Literal

from fastapi import Query, Request
from fastapi.responses import FileResponse, Response
from starlette.background import BackgroundTask

from backend.service.jobs.command import WATCHED
from backend.service.jobs.desk import find_job
from backend.service.page.access import owner_from, shared_job
from backend.service.page.running import as_stl, brought, first_frame
from backend.service.page.subject import subject_of
from backend.service.problems import Problem
from backend.service.service import Service
from backend.service.states import Kind
from backend.service.things import CHECKPOINT, file_of, files_of, find_thing, media_type

ROOMS: dict[str, Kind] = {"mechanisms": "mechanism", "studies": "study", "videos": "video"}
SHOWN = (
    "application/json",
    "text/csv",
    "image/png",
    "video/mp4",
    "video/webm",
    "video/quicktime",
    "model/stl",
    "text/plain",
)
As = Annotated[Literal["stl"] | None, Query(alias="as")]  # another kind of file than the stored one
PAGES = "sandbox allow-scripts"  # a report's own script may draw, and reach nothing of this site


def add_files(app, service_of) -> None:
    """Routes under which the views' files lie; service_of: the service that is served."""

    @app.get("/files/{room}/{id}/{path:path}", include_in_schema=False)
    async def owned(request: Request, room: str, id: str, path: str, kind: As = None) -> Response:
        service = service_of()
        return await _answered(lambda: _owned(service, request, room, id), service, id, path, kind)

    @app.get("/shared-files/{id}/{token}/subject/{path:path}", include_in_schema=False)
    async def subject(id: str, token: str, path: str, kind: As = None) -> Response:
        service = service_of()

        def allowed() -> str:
            about = subject_of(service, shared_job(service, id, token))
            if path not in about.meshes():
                raise Problem("not-found", f"The link shows the drawing's meshes; {path[:200]!r} is none of them.")
            return about.id

        return await _answered(allowed, service, "", path, kind)

    @app.get("/shared-files/{id}/{token}/{path:path}", include_in_schema=False)
    async def shared(id: str, token: str, path: str) -> Response:
        service = service_of()
        return await _answered(lambda: shared_job(service, id, token).id, service, id, path)

    @app.get("/frames/{id}.png", include_in_schema=False)
    async def frame(request: Request, id: str, from_s: Annotated[float, Query(ge=0.0, le=1e6)] = 0.0) -> Response:
        service = service_of()
        try:
            find_thing(service, owner_from(service, request), "video", id)
            return FileResponse(await first_frame(service, id, from_s), media_type="image/png")
        except Problem as problem:
            return Response(problem.detail, problem.status, media_type="text/plain")

    @app.get("/watching/{id}.jpg", include_in_schema=False)
    async def watching(request: Request, id: str) -> Response:
        service = service_of()

        def latest() -> bytes:
            find_job(service, owner_from(service, request), id)
            return service.storage.read(file_of(service, CHECKPOINT + id, WATCHED).key)

        try:
            picture = await asyncio.to_thread(latest)
        except Problem as problem:
            return Response(problem.detail, problem.status, media_type="text/plain")
        return Response(picture, media_type="image/jpeg", headers={"Cache-Control": "no-store"})


def _owned(service: Service, request: Request, room: str, id: str) -> str:
    owner = owner_from(service, request)
    if room == "jobs":
        find_job(service, owner, id)
    elif room in ROOMS:
        find_thing(service, owner, ROOMS[room], id)
    else:
        raise Problem("not-found", f"There is no {room}.")
    return id


async def _answered(allowed, service: Service, id: str, path: str, kind: str | None = None) -> Response:
    try:
        id = await asyncio.to_thread(allowed) or id
        if path == "all.zip":
            archive = await asyncio.to_thread(_archive, service, id)
            done = BackgroundTask(archive.unlink, missing_ok=True)
            return FileResponse(archive, media_type="application/zip", filename="linktwin-result.zip", background=done)
        file = file_of(service, id, path)
        there = await as_stl(service, id, path) if kind else await asyncio.to_thread(brought, service, id, path)
    except Problem as problem:
        return Response(problem.detail, problem.status, media_type="text/plain")
    kind = media_type(there.name)
    headers = {"X-Content-Type-Options": "nosniff", "Cache-Control": "private, max-age=3600", "ETag": file.sha256}
    if kind == "text/html":
        return FileResponse(there, media_type=kind, headers={**headers, "Content-Security-Policy": PAGES})
    if kind not in SHOWN:
        return FileResponse(there, media_type=kind, headers=headers, filename=Path(path).name)
    return FileResponse(there, media_type=kind, headers=headers)


def _archive(service: Service, id: str) -> Path:
    with tempfile.NamedTemporaryFile(dir=service.settings.scratch, suffix=".zip", delete=False) as target:
        with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as packed:
            for file in files_of(service, id):
                with packed.open(file.path, "w", force_zip64=True) as entry:
                    for chunk in service.storage.chunks(file.key):
                        entry.write(chunk)
        return Path(target.name)
