"""A line that can be cut: it carries bytes to a service and back, and breaks where it is told to."""

from __future__ import annotations

import select
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from urllib.parse import urlsplit

CHUNK = 2**14


class Lossy:
    """`cuts`: for each connection to come, after how many bytes of answers it breaks; one without a number holds."""

    def __init__(self, url: str):
        self.there = (urlsplit(url).hostname, urlsplit(url).port)
        self.cuts: list[int | None] = []
        self.connections = 0
        self.carrying: list[threading.Thread] = []
        self.ended = threading.Event()
        self.listening = socket.create_server(("127.0.0.1", 0))
        self.listening.settimeout(0.05)
        self.url = f"http://127.0.0.1:{self.listening.getsockname()[1]}"

    def serve(self) -> None:
        while not self.ended.is_set():
            with suppress(TimeoutError):
                near, _ = self.listening.accept()
                self.connections += 1
                cut = self.cuts.pop(0) if self.cuts else None
                self.carrying.append(threading.Thread(target=self._carry, args=(near, cut)))
                self.carrying[-1].start()

    def _carry(self, near: socket.socket, cut: int | None) -> None:
        left = float("inf") if cut is None else cut
        with near, socket.create_connection(self.there) as far, suppress(OSError):
            while not self.ended.is_set():
                for source in select.select([near, far], [], [], 0.05)[0]:
                    data = source.recv(CHUNK)
                    if source is far:
                        data = data[: int(min(left, CHUNK))]
                        left -= len(data)
                    (near if source is far else far).sendall(data)
                    if not data or left <= 0:
                        return


@contextmanager
def lossy(url: str, *cuts: int | None) -> Iterator[Lossy]:
    """A line to the service at an address."""
    line = Lossy(url)
    line.cuts = list(cuts)
    thread = threading.Thread(target=line.serve)
    thread.start()
    try:
        yield line
    finally:
        line.ended.set()
        for one in (thread, *line.carrying):
            one.join(10)
        line.listening.close()
