"""The routes that every kind of stored thing has: list, one, its files, delete."""

from __future__ import annotations

from itertools import chain
from typing import Annotated, Any
from urllib.parse import quote
from uuid import UUID

from fastapi import APIRouter, Header, Path
from fastapi.responses import Response, StreamingResponse

from backend.service.answers import API, ROOMS, ListAnswer, ThingAnswer
from backend.service.asking import TheOwner, TheService, TheSlice, may_fail
from backend.service.records import StoredFile
from backend.service.routes.parts import PartAsked, part_of
from backend.service.service import Service
from backend.service.states import Kind
from backend.service.telling import list_answer, thing_answer
from backend.service.things import delete_thing, file_of, files_of, find_thing, list_things

FilePath = Annotated[str, Path(pattern=r"^[^\x00-\x1f]{1,400}$", description="As it stands in the list of files.")]
ThePart = Annotated[PartAsked, Header()]
CONTENT = {"application/octet-stream": {}, "application/json": {}}
WHICH = {"Content-Range": {"description": "Which of how many bytes.", "schema": {"type": "string"}}}
FILE: dict[int | str, dict[str, Any]] = {
    **may_fail("not-found", "no-such-part"),
    200: {"description": "The file.", "content": CONTENT},
    206: {"description": "The part of it that was asked for.", "content": CONTENT, "headers": WHICH},
}
# Results are pages with scripts of their own: shown, but kept apart from the service's own pages.
APART = {"Content-Security-Policy": "sandbox allow-scripts allow-popups", "X-Content-Type-Options": "nosniff"}


def add_routes(router: APIRouter, kind: Kind) -> None:
    """GET of the list, of one, of one file, and DELETE."""
    room = ROOMS[kind]

    @router.get(f"/{room}", operation_id=f"list_{room}", responses=may_fail(), summary=f"Your {room}, newest first")
    def list_all(service: TheService, owner: TheOwner, part: TheSlice) -> ListAnswer[ThingAnswer]:
        page = list_things(service, owner, kind, part.limit, part.offset)
        told = [thing_answer(thing) for thing in page.rows]
        return list_answer(told, page.total, part.limit, part.offset, f"{API}/{room}")

    @router.get(
        f"/{room}/{{id}}", operation_id=f"get_{kind}", responses=may_fail("not-found"), summary=f"One {kind}"
    )  # fmt: skip
    def get_one(id: UUID, service: TheService, owner: TheOwner) -> ThingAnswer:
        thing = find_thing(service, owner, kind, str(id))
        return thing_answer(thing, files_of(service, thing.id))

    @router.get(
        f"/{room}/{{id}}/files/{{path:path}}",
        operation_id=f"get_{kind}_file",
        response_class=Response,
        responses=FILE,
        summary=f"One file of a {kind}",
    )
    def get_file(id: UUID, path: FilePath, service: TheService, owner: TheOwner, asked: ThePart) -> Response:
        thing = find_thing(service, owner, kind, str(id))
        return send_file(service, file_of(service, thing.id, path), asked)

    @router.delete(
        f"/{room}/{{id}}",
        operation_id=f"delete_{kind}",
        status_code=204,
        responses=may_fail("not-found", "in-use"),
        summary=f"Delete a {kind} and its files",
    )
    def delete_one(id: UUID, service: TheService, owner: TheOwner) -> None:
        delete_thing(service, owner, kind, str(id))


def send_file(service: Service, file: StoredFile, asked: PartAsked) -> Response:
    """A stored file, or the part of it that is asked for."""
    name, etag = file.path.rpartition("/")[2], f'"{file.sha256}"'
    headers = {**APART, "Content-Disposition": f"inline; filename*=UTF-8''{quote(name)}", "ETag": etag}
    headers["Accept-Ranges"] = "bytes"
    part = part_of(file.bytes, etag, asked)
    if part is not None:
        headers["Content-Range"] = f"bytes {part.start}-{part.stop - 1}/{file.bytes}"
    sent = range(file.bytes) if part is None else part
    headers["Content-Length"] = str(len(sent))
    pieces = service.storage.chunks(file.key, sent.start, sent.stop)
    first = next(pieces, b"")  # a storage that is away is told of while the answer has not begun
    status = 200 if part is None else 206
    return StreamingResponse(chain((first,), pieces), status, headers=headers, media_type=file.media_type)
