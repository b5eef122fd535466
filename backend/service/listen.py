"""Connections on which the head of a request does not come in time are closed.

uvicorn waits for it for ever, and answers nobody else once two thousand wait.
"""

from __future__ import annotations

import asyncio
from typing import Any

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol


def protocol(stall_s: float) -> type[HttpToolsProtocol]:
    """HTTP as uvicorn speaks it, closing a connection that brings no whole head for so many seconds."""

    class Prompt(HttpToolsProtocol):
        """One connection."""

        due: asyncio.TimerHandle | None = None

        def connection_made(self, transport: Any) -> None:
            super().connection_made(transport)
            self._await_head()

        def on_headers_complete(self) -> None:
            self._forget_head()
            super().on_headers_complete()

        def on_response_complete(self) -> None:
            super().on_response_complete()
            if self.cycle.response_complete:  # no further request waits on this connection
                self._await_head()

        def connection_lost(self, exc: Exception | None) -> None:
            self._forget_head()
            super().connection_lost(exc)

        def _await_head(self) -> None:
            if self.due is None:
                self.due = self.loop.call_later(stall_s, self.transport.close)

        def _forget_head(self) -> None:
            if self.due is not None:
                self.due.cancel()
                self.due = None

    return Prompt
