"""The web application: routes, and a problem document for whatever fails."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from importlib.metadata import version
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from sqlalchemy.exc import OperationalError
from starlette.exceptions import HTTPException

from backend.service.answers import API
from backend.service.gate import Gate
from backend.service.logs import logger
from backend.service.problems import MEDIA_TYPE, Problem, disk_full, phrase
from backend.service.routes import health, jobs, stored
from backend.service.service import Service
from backend.service.storage import StorageAway

ABOUT = """Store a mechanism, films or tables of the real one, and start jobs: track, fit, jam, diagnose, simulate.
Every failure is a problem document (RFC 9457) that says what to do.  Units are SI, spelled in the names."""
BY_STATUS = {
    400: "malformed", 401: "no-key", 404: "not-found", 405: "wrong-method", 413: "too-large", 415: "wrong-type",
    422: "invalid",
}  # fmt: skip
MOST_SAID = 2000  # letters of a fault: one that lists what was sent would be as long


def create_app(service: Service) -> FastAPI:
    """The application over an open service; it closes the service at its end."""

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        yield
        service.close()

    app = FastAPI(
        title="linktwin", version=version("linktwin"), description=ABOUT, lifespan=lifespan,
        openapi_url=f"{API}/openapi.json", docs_url=None, redoc_url=None,  # their pages load scripts from elsewhere
    )  # fmt: skip
    app.state.service = service
    app.include_router(stored.router, prefix=API)
    app.include_router(jobs.router, prefix=API)
    app.include_router(health.router)
    for error, handler in HANDLERS.items():
        app.add_exception_handler(error, handler)
    app.add_middleware(Gate, settings=service.settings)
    return app


def _answer(problem: Problem, request: Request) -> JSONResponse:
    document = problem.document(request.url.path)
    # What was sent may stand in a sentence, and need not be text that UTF-8 can write.
    plain = _writable(document)
    return JSONResponse(plain, problem.status, headers=problem.headers, media_type=MEDIA_TYPE)


def _writable(value: Any) -> Any:
    if isinstance(value, str):
        return value.encode("utf-8", "backslashreplace").decode("utf-8")
    if isinstance(value, list):
        return [_writable(one) for one in value]
    return {key: _writable(one) for key, one in value.items()} if isinstance(value, dict) else value


def _on_problem(request: Request, error: Any) -> JSONResponse:
    return _answer(error, request)


def _on_invalid(request: Request, error: Any) -> JSONResponse:
    faults = []
    for record in error.errors()[:100]:
        where = ".".join(str(step) for step in record["loc"] if step != "body")[:200]
        said = record["msg"][:MOST_SAID]
        faults.append(f"{where}: {said}" if where else said)
    if any(record["type"] == "json_invalid" for record in error.errors()[:1]):
        return _answer(Problem("malformed", "The body is not JSON; correct it.", faults), request)
    count = "1 fault" if len(faults) == 1 else f"{len(faults)} faults"
    return _answer(Problem("invalid", f"The request has {count}; each is listed.", faults), request)


def _on_http(request: Request, error: Any) -> JSONResponse:
    if isinstance(error.__cause__, Problem):  # raised while a body was read
        return _answer(error.__cause__, request)
    details = {
        400: "The body cannot be read; send JSON as UTF-8 text, not packed.",
        404: f"Nothing is at {request.url.path[:200]!r}; GET {API}/openapi.json to see what there is.",
        405: f"{request.method} is not taken here; the header Allow says what is.",
    }
    kind = BY_STATUS.get(error.status_code)
    if kind is None:
        kind = "internal" if error.status_code >= 500 else "malformed"
    detail = details.get(error.status_code, f"{(error.detail or phrase(error.status_code)).rstrip('.')}.")
    return _answer(Problem(kind, detail, headers=error.headers), request)


def _on_busy(request: Request, error: Any) -> JSONResponse:
    logger().error("database", path=request.url.path, error=str(error)[:500])
    said = Problem("unavailable", "The database does not answer; try again in a while.", headers={"Retry-After": "5"})
    return _answer(said, request)


def _on_system(request: Request, error: Any) -> JSONResponse:
    if (said := disk_full(error)) is None:
        raise error
    logger().error("disk full", path=request.url.path, error=str(error)[:500])
    return _answer(said, request)


def _on_storage(request: Request, error: Any) -> JSONResponse:
    logger().error("storage", path=request.url.path, error=str(error)[:500])
    said = Problem("unavailable", "The storage does not answer; try again in a while.", headers={"Retry-After": "5"})
    return _answer(said, request)


def _on_failure(request: Request, error: Any) -> JSONResponse:
    logger().error("failed", path=request.url.path, exc_info=error)
    return _answer(
        Problem("internal", "The service failed at this; its log says where.  Try again, or tell us."), request
    )


HANDLERS: dict[Any, Any] = {
    Problem: _on_problem,
    RequestValidationError: _on_invalid,
    HTTPException: _on_http,
    OperationalError: _on_busy,
    StorageAway: _on_storage,
    OSError: _on_system,
    Exception: _on_failure,
}
