"""Bodies of uploads, laid on this machine's disk piece by piece."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from fastapi import Request
from fastapi.concurrency import run_in_threadpool
from starlette.datastructures import UploadFile
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect

from backend.service.intake.folder import unpack
from backend.service.problems import Problem
from backend.service.service import Service

JSON, ZIP, FORM = "application/json", "application/zip", "multipart/form-data"


def folder_body(what: str, example: dict[str, Any]) -> dict[str, Any]:
    """The documented body of a folder's upload."""
    files = {"type": "array", "items": {"type": "string", "format": "binary"}}
    form = {"type": "object", "properties": {"files": files}, "required": ["files"]}
    return {
        "requestBody": {
            "required": True,
            "description": f"{what} alone, its folder as zip, or its files as parts whose file names are paths.",
            "content": {
                JSON: {"schema": {"type": "object"}, "example": example},
                ZIP: {"schema": {"type": "string", "format": "binary"}},
                FORM: {"schema": form},
            },
        }
    }


def kind_of_body(request: Request) -> str:
    """What the body is said to be; Problem `wrong-type` where it was packed for the way."""
    if (coding := request.headers.get("content-encoding", "")).lower() not in ("", "identity"):
        raise Problem("wrong-type", f"Content-Encoding is {coding[:60]!r}; send the bytes as they are.")
    return request.headers.get("content-type", "").partition(";")[0].strip().lower()


def json_alone(request: Request) -> None:
    """Problem `wrong-type` for a body that is not said to be JSON."""
    if (kind := kind_of_body(request)) != JSON:
        raise Problem("wrong-type", f"Content-Type is {kind[:60]!r}; send {JSON}.")


@asynccontextmanager
async def received(request: Request, service: Service) -> AsyncIterator[Path]:
    """The body as a file, which goes when the request is answered."""
    with tempfile.TemporaryDirectory(dir=service.settings.scratch, prefix="upload-") as folder:
        path = Path(folder) / "body"
        try:
            with path.open("wb") as file:
                async for chunk in request.stream():
                    if chunk:
                        await run_in_threadpool(file.write, chunk)
        except ClientDisconnect:
            raise Problem("malformed", "The upload broke off; send it again.") from None
        yield path


async def received_folder(
    request: Request,
    service: Service,
    document: Callable[[bytes], Any],
    folder: Callable[[Mapping[str, Path]], Any],
) -> Any:
    """Hand a body on: JSON to `document`, files (path -> file) to `folder`, in a thread; what they return."""
    kind = kind_of_body(request)
    if kind == FORM:
        with tempfile.TemporaryDirectory(dir=service.settings.scratch, prefix="upload-") as place:
            files = await _form(request, service, Path(place))
            return await run_in_threadpool(folder, files)
    if kind not in (JSON, ZIP, "application/x-zip-compressed"):
        raise Problem("wrong-type", f"Content-Type is {kind[:60]!r}; send {JSON}, {ZIP} or {FORM}.")
    async with received(request, service) as body:
        if kind == JSON:
            limit = service.settings.largest_document
            if (size := body.stat().st_size) > limit:
                raise Problem("too-large", f"The document has {size} bytes, above the limit of {limit}.")
            return await run_in_threadpool(lambda: document(body.read_bytes()))
        return await run_in_threadpool(lambda: folder(unpack(body, body.parent / "unpacked", service.settings)))


async def _form(request: Request, service: Service, place: Path) -> dict[str, Path]:
    most = service.settings.most_files
    try:
        async with request.form(max_files=most, max_fields=10, max_part_size=2**16) as form:
            files: dict[str, Path] = {}
            for field, part in form.multi_items():
                if not isinstance(part, UploadFile):
                    raise Problem("invalid", f"Part {field[:60]!r} has no file name; send files alone.")
                name = part.filename or ""
                if name in files:
                    raise Problem("invalid", f"{name[:100]!r} is sent twice; keep one.")
                files[name] = place / f"{len(files)}"
                await run_in_threadpool(_copy, part, files[name])
            return files
    except ClientDisconnect:
        raise Problem("malformed", "The upload broke off; send it again.") from None
    except HTTPException as error:
        raise Problem(
            "malformed", f"The form cannot be read ({error.detail.rstrip('.')}); send files as parts."
        ) from None


def _copy(part: UploadFile, path: Path) -> None:
    with path.open("wb") as target:
        shutil.copyfileobj(part.file, target, 2**20)
