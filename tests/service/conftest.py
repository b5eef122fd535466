"""The service in this process: its application asked over a socket, no worker behind it."""

from __future__ import annotations

import shutil
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
from backend.service.listen import protocol
from backend.service.logs import write_logs
from backend.service.service import Service, open_service
from tests.service.serving import FOURBAR, settings_in

JSON = {"content-type": "application/json"}


@contextmanager
def asking(service: Service, **speaking: Any) -> Iterator[httpx.Client]:
    """A client of the service's application; speaking: of the protocol."""
    with socket.create_server(("127.0.0.1", 0)) as listening:
        speaks = protocol(service.settings.stall_s, **speaking)
        server = uvicorn.Server(uvicorn.Config(create_app(service), log_config=None, access_log=False, http=speaks))
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]})
        thread.start()
        try:
            with httpx.Client(base_url=f"http://127.0.0.1:{listening.getsockname()[1]}", timeout=60.0) as client:
                yield client
        finally:
            server.should_exit = True
            thread.join(20)


@pytest.fixture(scope="session")
def empty_records(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A migrated database with nothing in it: copying it is quicker than making it."""
    write_logs()
    folder = tmp_path_factory.mktemp("empty")
    service = open_service(settings_in(folder))
    service.close()
    return service.settings.data_folder / "records.sqlite"


@pytest.fixture
def opened(tmp_path: Path, empty_records: Path) -> Iterator[Callable[..., tuple[Service, httpx.Client]]]:
    """Open a service with settings of one's own, and a client that asks it."""
    with ExitStack() as stack:

        def make(**settings: Any) -> tuple[Service, httpx.Client]:
            told = settings_in(tmp_path, **settings)
            told.data_folder.mkdir(exist_ok=True)
            shutil.copy(empty_records, told.data_folder / "records.sqlite")
            service = open_service(told)
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
