"""The page under /ui: its views, its files, signing in."""

from __future__ import annotations

from pathlib import Path

from fastapi import FastAPI, Form
from fastapi.responses import FileResponse, RedirectResponse, Response
from nicegui import core, ui

from backend.service.keys import owner_of
from backend.service.page import (  # noqa: F401  each declares its views
    clip_view,
    compose_view,
    home,
    job_view,
    mechanism_view,
    study_view,
    work,
)
from backend.service.page.access import COOKIE, REFUSED
from backend.service.page.files import add_files
from backend.service.page.late import ROOT
from backend.service.page.shell import page, serve_views
from backend.service.page.shell import service as served
from backend.service.problems import Problem
from backend.service.service import Service

ICON = Path(__file__).parent / "icon.svg"
_mounted = False


def mount_page(app: FastAPI, service: Service) -> FastAPI:
    """Put the page under /ui of an application and return it.

    A process serves one service at a time: the one mounted last.
    """
    global _mounted
    serve_views(service)
    if _mounted:  # NiceGUI is one application per process
        app.mount(ROOT, core.app)
        return core.app
    _mounted = True
    add_files(core.app, served)
    core.app.post("/sign-in", include_in_schema=False)(_sign_in)
    core.app.post("/sign-out", include_in_schema=False)(_sign_out)
    ui.run_with(
        app, mount_path=ROOT, title="linktwin", favicon=ICON, dark=None, tailwind=False, show_welcome_message=False,
        reconnect_timeout=30.0,
    )  # fmt: skip
    core.app.get("/favicon.ico", include_in_schema=False)(_icon)  # NiceGUI's own comes later, and too late
    page("/{rest:path}")(_lost)  # the last route: whatever no other one takes
    return core.app


def _icon() -> Response:
    return FileResponse(ICON)


def _lost(service: Service, owner: str, rest: str) -> None:
    """An address that nothing stands at."""
    raise Problem("not-found", f"There is no view at {rest[:80]!r}.")


def _sign_in(key: str = Form(default="")) -> Response:
    """Keep a key that opens something in a cookie that no script can read; else ask again."""
    try:
        owner_of(served().database, key.strip())
    except Problem:
        return RedirectResponse(f"{ROOT}/?{REFUSED}", status_code=303)
    answer = RedirectResponse(f"{ROOT}/", status_code=303)
    answer.set_cookie(COOKIE, key.strip(), httponly=True, samesite="strict", path=ROOT, max_age=30 * 86400)
    return answer


def _sign_out() -> Response:
    """Forget the key."""
    answer = RedirectResponse(f"{ROOT}/", status_code=303)
    answer.delete_cookie(COOKIE, path=ROOT)
    return answer
