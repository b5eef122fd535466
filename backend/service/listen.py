"""Connections that bring no whole request are closed: in time, or when too many others wait like them.

uvicorn waits for the head for ever, and answers nobody else once as many wait as it serves at once.
"""

from __future__ import annotations

import asyncio
import resource
from typing import Any

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

AT_ONCE = 2000  # connections; beyond, a request is answered with 503
MOST_SILENT = 1000  # of them; one more, and the longest silent of them gives way
BODY = (b"content-length", b"transfer-encoding")  # either announces one
OPEN_FILES = 4 * AT_ONCE


def protocol(stall_s: float, most_silent: int = MOST_SILENT) -> type[HttpToolsProtocol]:
    """HTTP as uvicorn speaks it, closing a connection that brings no whole head for so many seconds.

    most_silent: connections that may wait for the rest of a request at once, its head or its body. How long a body may
    take the gate says (`gate.Taken`).
    """
    silent: dict[Prompt, asyncio.TimerHandle | None] = {}  # the longest silent first

    class Prompt(HttpToolsProtocol):
        """One connection."""

        def connection_made(self, transport: Any) -> None:
            super().connection_made(transport)
            self._await_head()

        def on_headers_complete(self) -> None:
            self._forget()
            super().on_headers_complete()
            if any(name in BODY for name, _ in self.headers):
                self._await()

        def on_body(self, body: bytes) -> None:
            super().on_body(body)
            self._forget()
            self._await()

        def on_message_complete(self) -> None:
            self._forget()
            super().on_message_complete()

        def on_response_complete(self) -> None:
            super().on_response_complete()
            if self.cycle.response_complete:  # no further request waits on this connection
                self._await_head()

        def connection_lost(self, exc: Exception | None) -> None:
            self._forget()
            super().connection_lost(exc)

        def _await_head(self) -> None:
            if self not in silent:
                self._await(self.loop.call_later(stall_s, self.transport.close))

        def _await(self, due: asyncio.TimerHandle | None = None) -> None:
            silent[self] = due
            if len(silent) <= most_silent:
                return
            # One whose bytes are not read yet is not silent: the service is busy.
            if longest := next((one for one in silent if not one.flow.read_paused), None):
                longest._forget()
                longest.transport.close()

        def _forget(self) -> None:
            if due := silent.pop(self, None):
                due.cancel()

    return Prompt


def allow_connections() -> None:
    """Open as many files as connections may need, or as many as this machine grants."""
    granted, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = OPEN_FILES if most == resource.RLIM_INFINITY else min(OPEN_FILES, most)
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(granted, wanted), most))
