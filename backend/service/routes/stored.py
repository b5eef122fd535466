"""Mechanisms, studies and videos come in."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Request, Response
from fastapi.concurrency import run_in_threadpool

from backend.mechanism.drawing_error import DrawingError
from backend.mechanism.read import decode
from backend.service.answers import API, ID, ROOMS, ThingAnswer
from backend.service.asking import RepeatKey, TheOwner, TheService, made, may_fail
from backend.service.mechanisms import faulty, store_mechanism, store_mechanism_document
from backend.service.problems import Problem
from backend.service.records import Thing
from backend.service.routes.things import add_routes
from backend.service.routes.uploads import FORM, folder_body, kind_of_body, received, received_folder
from backend.service.service import Service
from backend.service.studies import STUDY, compose_study, store_study
from backend.service.telling import thing_answer
from backend.service.things import files_of
from backend.service.videos import store_video

UPLOAD = made(201, "Stored") | may_fail(
    "not-found", "too-slow", "too-large", "wrong-type", "storage-full", "key-reused"
)
Name = Annotated[str | None, Query(max_length=200, description="What to call it.")]
DRAWING = {
    "schema_version": "1.0",
    "name": "bar",
    "bodies": [{"id": "ground", "fixed": True}],
    "joints": [],
}
STUDY_EXAMPLE = {
    "schema_version": "1.0",
    "mechanism": f"mechanisms/{ID}",
    "experiments": [{"id": "e1", "tracks": f"jobs/{ID}/files/tracks.csv", "release": {"time_s": 0.1}}],
}

router = APIRouter(tags=["stored things"])
for kind in ("mechanism", "study", "video"):
    add_routes(router, kind)


@router.post(
    "/mechanisms", status_code=201, responses=UPLOAD, openapi_extra=folder_body("mechanism.json", DRAWING),
    summary="Store a mechanism with its meshes",
)  # fmt: skip
async def post_mechanism(
    request: Request,
    response: Response,
    service: TheService,
    owner: TheOwner,
    name: Name = None,
    repeat_key: RepeatKey = None,
) -> ThingAnswer:
    """Every fault of the drawing is listed, with its remedy."""
    name = _plain(name)
    thing = await received_folder(
        request, service,
        lambda text: store_mechanism_document(service, owner, text, name, repeat_key),
        lambda files: store_mechanism(service, owner, files, name, repeat_key),
    )  # fmt: skip
    return await _created(response, service, thing)


@router.post(
    "/studies", status_code=201, responses=UPLOAD, openapi_extra=folder_body("study.json", STUDY_EXAMPLE),
    summary="Store a study: a mechanism and its experiments",
)  # fmt: skip
async def post_study(
    request: Request,
    response: Response,
    service: TheService,
    owner: TheOwner,
    name: Name = None,
    repeat_key: RepeatKey = None,
) -> ThingAnswer:
    """As JSON it refers to what is stored already: `mechanisms/ID`, `videos/ID`, `jobs/ID/files/tracks.csv`."""
    name = _plain(name)
    thing = await received_folder(
        request, service,
        lambda text: compose_study(service, owner, _document(text), name, repeat_key),
        lambda files: store_study(service, owner, files, name, repeat_key),
    )  # fmt: skip
    return await _created(response, service, thing)


@router.put(
    "/videos", status_code=201, responses=UPLOAD, summary="Store a video, streamed",
    openapi_extra={
        "requestBody": {
            "required": True,
            "description": "The file's bytes: MP4, MOV, MKV, WebM or AVI, as its content says.",
            "content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}},
        }
    },
)  # fmt: skip
async def put_video(
    request: Request,
    response: Response,
    service: TheService,
    owner: TheOwner,
    name: Name = None,
    repeat_key: RepeatKey = None,
) -> ThingAnswer:
    """Each upload is a video of its own, unless an Idempotency-Key says otherwise; the Location says where."""
    name = _plain(name)
    if kind_of_body(request) == FORM:
        raise Problem("wrong-type", "A clip comes as its bytes, not as a form; send it as `curl -T clip.mp4` does.")
    async with received(request, service) as body:
        thing = await run_in_threadpool(store_video, service, owner, body, name, repeat_key)
    return await _created(response, service, thing)


async def _created(response: Response, service: Service, thing: Thing) -> ThingAnswer:
    response.headers["Location"] = f"{API}/{ROOMS[thing.kind]}/{thing.id}"
    return thing_answer(thing, await run_in_threadpool(files_of, service, thing.id))


def _document(text: bytes) -> dict:
    try:
        document = decode(text.decode("utf-8-sig"), STUDY)
    except UnicodeDecodeError:
        raise Problem("invalid", f"{STUDY} is not UTF-8 text; save it as UTF-8.") from None
    except DrawingError as error:
        raise faulty(error) from None
    if not isinstance(document, dict):
        raise Problem("invalid", f"{STUDY} holds no object in braces.")
    return document


def _plain(name: str | None) -> str | None:
    if name is not None and not (name.strip() and name.isprintable()):
        raise Problem("invalid", f"The name {name[:60]!r} cannot be printed; write it plainly.")
    return name
