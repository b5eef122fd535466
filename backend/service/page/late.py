"""The page, loaded once the API answers: what asks for it before waits."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from typing import Any

from fastapi import FastAPI

from backend.service.logs import logger
from backend.service.service import Service

ROOT = "/ui"  # where the page is mounted
HEAD_START_S = 0.5  # in which the API gives its first answers, unless the page itself is asked for


class LatePage:
    """An ASGI application that stands for the page from the start; its framework takes longer to import than the rest.

    Raises what kept the page from loading at each request for it; the API answers all the same.
    """

    def __init__(self, service: Service):
        self.service = service
        self._asked = asyncio.Event()
        self._loading: asyncio.Task[Any] | None = None

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        """As the page does, as soon as it is there."""
        if self._loading is None:
            raise RuntimeError("the page was asked for before its application started; run it within its lifespan")
        self._asked.set()
        # Whoever waits may leave: the page is loaded for all.
        page = await asyncio.shield(self._loading)
        await page(scope, receive, send)

    @asynccontextmanager
    async def alive(self) -> AsyncIterator[None]:
        """Load the page beside what the block does, and end it with the block."""
        async with AsyncExitStack() as open_until_the_end:
            self._loading = asyncio.create_task(self._load(open_until_the_end))
            self._loading.add_done_callback(_tell)
            try:
                yield
            finally:
                self._loading.cancel()
                await asyncio.wait([self._loading])

    async def _load(self, stack: AsyncExitStack) -> Any:
        with suppress(TimeoutError):
            await asyncio.wait_for(self._asked.wait(), HEAD_START_S)
        mount_page = await asyncio.to_thread(_import)
        # The page's own startup and shutdown belong to the application that it is mounted on; that of the API has
        # started already.
        carrier = FastAPI(openapi_url=None)
        page = mount_page(carrier, self.service)
        await stack.enter_async_context(carrier.router.lifespan_context(carrier))
        return page


def mount_late(app: FastAPI, service: Service) -> None:
    """Put the page under /ui of an application, loaded once the application has started."""
    page = LatePage(service)
    app.mount(ROOT, page)
    api_alive = app.router.lifespan_context

    @asynccontextmanager
    async def alive(app: FastAPI) -> AsyncIterator[Any]:
        async with api_alive(app) as state, page.alive():
            yield state

    app.router.lifespan_context = alive


def _import() -> Callable[[FastAPI, Service], Any]:
    from backend.service.page.mount import mount_page

    return mount_page


def _tell(loading: asyncio.Task[Any]) -> None:
    if not loading.cancelled() and (error := loading.exception()) is not None:
        logger().error("the page did not load", exc_info=error)
