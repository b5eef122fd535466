"""What every view shares: the head with the way back, light and dark, and errors that say what to do."""

from __future__ import annotations

import asyncio
import inspect
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import Any

from fastapi import Depends, HTTPException, Request
from nicegui import core, ui

from backend.service.gate import Buckets
from backend.service.page.access import COOKIE, owner_from
from backend.service.page.late import ROOT
from backend.service.page.markup import button, drawn, empty, link, notice, tag
from backend.service.problems import Problem
from backend.service.service import Service

MARK = (
    '<svg viewBox="0 0 32 32" aria-hidden="true"><path d="M6 25 11 9 25 7M26 25 25 7M3 25h26"/>'
    '<circle cx="6" cy="25" r="3"/><circle cx="11" cy="9" r="3"/><circle cx="25" cy="7" r="3"/>'
    '<circle cx="26" cy="25" r="3"/></svg>'
)
SCHEME = """<script>(() => {
  const name = "linktwin scheme", kept = localStorage.getItem(name);
  window.linktwinScheme = (next) => { localStorage.setItem(name, next); Quasar.Dark.set(next === "dark"); };
  const ready = () => window.Quasar && document.body.classList.length;
  const apply = () => ready() ? Quasar.Dark.set(kept === "dark") : setTimeout(apply, 20);
  if (kept) document.addEventListener("DOMContentLoaded", apply);
})();</script>"""
SWITCH = "() => linktwinScheme(document.body.classList.contains('body--dark') ? 'light' : 'dark')"
KEY_EVERY_S = 5.0
FIGURES = Path(__file__).parents[2] / "report" / "templates" / "figures.css"
STYLE = Path(__file__).parent / "style.css"


def service() -> Service:
    """The service that is served."""
    return core.app.state.linktwin


def serve_views(served: Service) -> None:
    """Say which service the views are of."""
    settings = served.settings
    core.app.state.linktwin = served
    core.app.state.views = Buckets(settings.requests_per_minute, settings.request_burst)


@contextmanager
def view(title: str, trail: Sequence[tuple[str, str]] = (), now: str = "") -> Iterator[None]:
    """The frame of a view. trail: (name, address) of the views above it. now: which entry of the head is this one."""
    ui.page_title(f"{title} · linktwin")
    # The reports' own rules reach no further than the charts.
    style = f"{STYLE.read_text(encoding='utf-8')}\n.timeline {{ {FIGURES.read_text(encoding='utf-8')} }}"
    ui.add_head_html(f"<style>{style}</style>{SCHEME}")
    tag("a", "Skip to the content", "skip", href="#content")
    with tag("header", look="masthead"), tag("div"):
        with link("", "/", "brand", aria_label="linktwin, home"):
            drawn(MARK)
            tag("span", "linktwin")
        with tag("nav", aria_label="Main"):
            for name, address in (("Mechanisms", "/"), ("Work", "/work")):
                link(name, address, aria_current="page" if now == address else None)
            dark = button("Light / dark", None, "quiet", aria_label="Switch between light and dark")
            dark.on("click", js_handler=SWITCH)
            if service().settings.keys_required and COOKIE in ui.context.client.request.cookies:
                with tag("form", method="post", action=f"{ROOT}/sign-out"):
                    tag("button", "Sign out", "quiet", type="submit")
    with tag("div", look="page", id="content", tabindex="-1"):
        if trail:
            with tag("nav", look="trail", aria_label="Where you are"):
                for name, address in trail:
                    link(name, address)
        yield


def page(path: str, open_to_all: bool = False) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """A view at a path. It is given the service and the owner first; a Problem becomes a view that says what to do.

    open_to_all: no key is asked for, and nobody is the owner.
    """

    def made(show: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(show)
        async def shown(request: Request, **given: Any) -> None:
            try:
                owner = "" if open_to_all else await asyncio.to_thread(owner_from, service(), request)
                answer = show(service(), owner, **given)
                if inspect.isawaitable(answer):
                    await answer
                if owner and service().settings.keys_required:
                    _end_with_its_key(request)
            except Problem as problem:
                ui.context.client.content.clear()
                with ui.context.client.content:
                    sorry(problem)

        kept = [p for p in inspect.signature(show).parameters.values() if p.name not in ("service", "owner")]
        first = inspect.Parameter("request", inspect.Parameter.KEYWORD_ONLY, annotation=Request)
        shown.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
            [first, *(p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in kept)]
        )
        shown.__annotations__ = {"request": Request, **{p.name: p.annotation for p in kept}}
        return ui.page(path, response_timeout=30.0, dependencies=[Depends(_counted)])(shown)

    return made


def _counted(request: Request) -> None:
    """Refuse (429) what is beyond the requests granted to an address: a view takes memory for a minute, seen or not."""
    if wait_s := core.app.state.views.wait_s(request.client.host if request.client else ""):
        said = f"Too many views were opened from here; try again in {wait_s:.1f} s."
        raise HTTPException(429, said, headers={"Retry-After": str(max(1, round(wait_s)))})


def _end_with_its_key(request: Request) -> None:
    """Ask every few seconds whether the key still opens something; once it does not, nothing here can be pressed."""
    client = ui.context.client

    async def look() -> None:
        try:
            await asyncio.to_thread(owner_from, service(), request)
        except Problem:
            client.run_javascript("location.reload()")  # which asks for a key
            client.content.clear()

    ui.timer(KEY_EVERY_S, look)


def sorry(problem: Problem) -> None:
    """A view for what cannot be shown."""
    if problem.kind == "no-key":
        sign_in(problem)
        return
    with view("Not here"):
        tag("h1", "This cannot be shown", style="margin-top: 28px")
        with (
            empty("It was deleted, it is not yours, or the address is not complete", problem.detail),
            tag("div", look="actions"),
        ):
            link("To your mechanisms", "/", "act primary")


def sign_in(problem: Problem) -> None:
    """A view that asks for a key."""
    with view("Sign in"):
        tag("h1", "Sign in", style="margin-top: 28px")
        tag("p", problem.detail, "soft", role="status")
        with tag("form", look="panel", method="post", action=f"{ROOT}/sign-in", style="max-width: 460px"):
            with tag("label", look="field"):
                tag("span", "API key")
                tag("input", look="in", type="password", name_="key", autocomplete="current-password", required=True)
            with tag("div", look="actions", style="margin-top: 12px"):
                tag("button", "Sign in", "act primary", type="submit")


def tell(problem: Problem, where: Any) -> None:
    """Put a problem, with all its faults, into a box of the view; what stood there goes."""
    where.clear()
    with where:
        notice(problem.faults, "bad", problem.detail)
