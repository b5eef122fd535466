"""The service in this process: its application asked over a socket, no worker behind it."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
import uvicorn

from backend.service.app import create_app
from backend.service.service import Service, open_service
from tests.service.serving import FOURBAR, settings_in

JSON = {"content-type": "application/json"}


@contextmanager
def asking(service: Service) -> Iterator[httpx.Client]:
    """A client of the service's application."""
    with socket.create_server(("127.0.0.1", 0)) as listening:
        server = uvicorn.Server(uvicorn.Config(create_app(service), log_config=None, access_log=False))
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]})
        thread.start()
        try:
            with httpx.Client(base_url=f"http://127.0.0.1:{listening.getsockname()[1]}", timeout=60.0) as client:
                yield client
        finally:
            server.should_exit = True
            thread.join(20)


@pytest.fixture
def opened(tmp_path: Path) -> Iterator[Callable[..., tuple[Service, httpx.Client]]]:
    """Open a service with settings of one's own, and a client that asks it."""
    with ExitStack() as stack:

        def make(**settings: Any) -> tuple[Service, httpx.Client]:
            service = open_service(settings_in(tmp_path, **settings))
            client = stack.enter_context(asking(service))
            return service, client

        yield make


@pytest.fixture
def client(opened) -> httpx.Client:
    return opened()[1]


@pytest.fixture
def drawing(client: httpx.Client) -> str:
    """A stored four-bar; its id."""
    return client.post("/api/v1/mechanisms", content=FOURBAR.read_bytes(), headers=JSON).json()["id"]
