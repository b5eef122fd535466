"""The API answers while the page is still loading, and whoever asks for the page meanwhile waits."""

import asyncio
import shutil
import threading
from collections.abc import Awaitable, Callable

import httpx
import pytest
from fastapi import FastAPI
from fastapi.responses import PlainTextResponse

from backend.service.app import create_app
from backend.service.page import late
from backend.service.service import Service, open_service
from tests.service.serving import settings_in


@pytest.fixture
def service(tmp_path, empty_records) -> Service:
    told = settings_in(tmp_path)
    told.data_folder.mkdir(exist_ok=True)
    shutil.copy(empty_records, told.data_folder / "records.sqlite")
    return open_service(told)


def asked(service: Service, questions: Callable[[httpx.AsyncClient], Awaitable[None]]) -> None:
    """Put questions to an application that is alive in this process."""
    app = create_app(service)
    late.mount_late(app, service)

    async def ask() -> None:
        transport = httpx.ASGITransport(app, raise_app_exceptions=False)
        async with (
            app.router.lifespan_context(app),
            httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as client,
        ):
            await questions(client)

    asyncio.run(ask())


def small_page(carrier: FastAPI, service: Service):
    """A page in the real one's place."""
    return PlainTextResponse("the page")


def test_a_visitor_who_comes_before_the_page_waits_for_it_and_the_api_does_not(service, monkeypatch):
    imported = threading.Event()
    monkeypatch.setattr(late, "_import", lambda: imported.wait(60) and small_page)

    async def questions(client):
        visit = asyncio.create_task(client.get("/ui/"))
        assert (await client.get("/health")).json()["status"] == "ok"
        assert not visit.done()
        imported.set()
        assert (await visit).text == "the page"

    asked(service, questions)


def test_a_visitor_who_leaves_early_takes_the_page_from_nobody(service, monkeypatch):
    imported = threading.Event()
    monkeypatch.setattr(late, "_import", lambda: imported.wait(60) and small_page)

    async def questions(client):
        visit = asyncio.create_task(client.get("/ui/"))
        await client.get("/health")
        visit.cancel()
        imported.set()
        assert (await client.get("/ui/")).text == "the page"

    asked(service, questions)


def test_a_page_that_cannot_be_loaded_leaves_the_api_alone(service, monkeypatch):
    def broken():
        raise ImportError("no page on this machine")

    monkeypatch.setattr(late, "_import", broken)

    async def questions(client):
        answer = await client.get("/ui/")
        assert (answer.status_code, answer.json()["type"].rpartition("/")[2]) == (500, "internal")
        assert (await client.get("/health")).json()["status"] == "ok"

    asked(service, questions)


def test_a_service_that_ends_at_once_waits_for_no_page(service, monkeypatch):
    monkeypatch.setattr(late, "_import", lambda: pytest.fail("the page was loaded for nobody"))

    async def questions(client):
        assert (await client.get("/health")).status_code == 200

    asked(service, questions)
