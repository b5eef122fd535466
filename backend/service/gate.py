"""What every request passes first: the name it asks for, where it comes from, how often, how much, how slowly."""

from __future__ import annotations

import asyncio
import hashlib
import json
import re
import time
from collections import OrderedDict
from typing import Any
from urllib.parse import urlsplit

from backend.service.problems import MEDIA_TYPE, Problem
from backend.service.settings import Settings

LOOPBACK = ("localhost", "127.0.0.1", "[::1]", "::1")
MOST_ASKERS = 10_000
STRANGERS = 10  # times what one key is granted: keys of one address that opened nothing yet, together
OPENED = "linktwin.opened"  # in the scope of a request whose key opened something
LARGEST_REQUEST = 2**20  # bytes; a job's request may carry a bed and clicks
PAGE_UPLOAD = re.compile(r"/ui/_nicegui/client/[^/]+/upload/")
GRACE_S = 10.0  # before an upload's average speed counts
READING = ("GET", "HEAD", "OPTIONS")


class Buckets:
    """So many requests a minute each, and so many at once."""

    def __init__(self, per_minute: int, burst: int):
        self.rate, self.burst = per_minute / 60.0, float(burst)
        self._left: OrderedDict[str, tuple[float, float]] = OrderedDict()

    def wait_s(self, asker: str) -> float:
        """Take one; 0, or how long to wait until there is one."""
        now = time.monotonic()
        left, at = self._left.pop(asker, (self.burst, now))
        left = min(self.burst, left + (now - at) * self.rate)
        taken = left >= 1.0
        self._left[asker] = (left - taken, now)
        if len(self._left) > MOST_ASKERS:
            self._left.popitem(last=False)
        return 0.0 if taken else (1.0 - left) / self.rate


class Gate:
    """ASGI middleware; refuses with a problem document."""

    def __init__(self, app: Any, settings: Settings):
        self.app, self.settings = app, settings
        self.buckets = Buckets(settings.requests_per_minute, settings.request_burst)
        # Keys can be invented: those that opened nothing yet share what their address is granted.
        self.strangers = Buckets(STRANGERS * settings.requests_per_minute, STRANGERS * settings.request_burst)
        self.known: set[str] = set()
        self.hosts = {*LOOPBACK, settings.host, *settings.allowed_hosts}

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        """Let a request through, or answer why not."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        # Of a header that stands twice the first counts, as for the framework.
        headers = {key.lower(): value.decode("latin-1") for key, value in reversed(list(scope["headers"]))}
        asker, client = _asker(headers), (scope.get("client") or ("",))[0]
        try:
            self._refuse_strangers(scope, headers)
            if scope["type"] == "websocket":
                await self.app(scope, receive, send)
                return
            self._refuse_too_often(scope, asker, client)
            taken = Taken(receive, self._largest(scope), self.settings)
            taken.refuse_declared(headers.get(b"content-length"))
        except Problem as problem:
            if scope["type"] == "http":
                await refuse(problem, scope["path"], send)
            else:
                await send({"type": "websocket.close", "code": 1008, "reason": problem.detail[:100]})
            return
        await self.app(scope, taken, send)
        if asker is not None and scope.get(OPENED):
            if len(self.known) >= MOST_ASKERS:
                self.known.clear()
            self.known.add(asker)

    def _refuse_strangers(self, scope: Any, headers: dict[bytes, str]) -> None:
        host = headers.get(b"host", "")
        name = host.rpartition(":")[0] if host.rpartition(":")[2].isdigit() else host
        # Without keys anybody who is let in may do anything: a page elsewhere must not reach this machine by a name
        # of its own that leads here.
        if not self.settings.keys_required and name not in self.hosts:
            raise Problem(
                "misdirected",
                f"The service is not known as {name[:100]!r}; ask for http://127.0.0.1, or add the name to "
                "LINKTWIN_ALLOWED_HOSTS and require keys.",
            )
        origin = headers.get(b"origin")
        writes = scope["type"] == "websocket" or scope["method"] not in READING
        if origin is not None and writes and urlsplit(origin).netloc != host:
            raise Problem("foreign-origin", f"A page of {origin[:100]!r} may not do this; use the service's own page.")

    def _refuse_too_often(self, scope: Any, asker: str | None, client: str) -> None:
        if not scope["path"].startswith("/api/"):
            return
        wait_s = self.buckets.wait_s(asker or client)
        if asker is not None and asker not in self.known:
            wait_s = max(wait_s, self.strangers.wait_s(client))
        if wait_s:
            raise Problem(
                "too-often",
                f"{self.settings.requests_per_minute} requests a minute are granted; try again in {wait_s:.1f} s.",
                headers={"Retry-After": str(max(1, round(wait_s)))},
            )

    def _largest(self, scope: Any) -> int:
        path = scope["path"]
        if path.startswith("/api/v1/videos") or PAGE_UPLOAD.match(path):  # the page takes clips too
            return self.settings.largest_video
        if path.startswith(("/api/v1/jobs", "/ui")):
            return min(LARGEST_REQUEST, self.settings.largest_document)
        if path.startswith(("/api/v1/mechanisms", "/api/v1/studies")):
            return self.settings.largest_archive
        return self.settings.largest_document


def _asker(headers: dict[bytes, str]) -> str | None:
    """A digest of the key that is shown, however it is written; None where none is."""
    key = headers.get(b"authorization", "").partition(" ")[2].strip()
    return hashlib.sha256(key.encode()).hexdigest() if key else None


class Taken:
    """A request's body as it comes in: refused where it is too large, silent or too slow."""

    def __init__(self, receive: Any, largest: int, settings: Settings):
        self.receive, self.largest, self.settings = receive, largest, settings
        self.bytes, self.complete, self.began = 0, False, time.monotonic()

    def refuse_declared(self, length: str | None) -> None:
        """Problem where the declared length is no number, or too large."""
        if length is None:
            return
        if not length.isdecimal():
            raise Problem("malformed", f"Content-Length is {length[:40]!r}; it is a number of bytes.")
        if int(length) > self.largest:
            raise self._too_large(int(length))

    async def __call__(self) -> Any:
        """The next message."""
        if self.complete:
            return await self.receive()
        try:
            message = await asyncio.wait_for(self.receive(), self.settings.stall_s)
        except TimeoutError:
            silent = f"Nothing came for {self.settings.stall_s:g} s after {self.bytes} bytes"
            raise Problem("too-slow", f"{silent}; send it again over a steady line.") from None
        if message["type"] == "http.request":
            self.bytes += len(message.get("body", b""))
            self.complete = not message.get("more_body", False)
            if self.bytes > self.largest:
                raise self._too_large(self.bytes)
            took = time.monotonic() - self.began
            grace_s = min(GRACE_S, self.settings.stall_s)
            if not self.complete and took > grace_s and self.bytes < took * self.settings.slowest_bytes_per_s:
                raise Problem("too-slow", f"{self.bytes} bytes came in {took:.0f} s; send it again over a faster line.")
        return message

    def _too_large(self, size: int) -> Problem:
        return Problem("too-large", f"{size} bytes are above the limit of {self.largest} here; send less.")


async def refuse(problem: Problem, path: str, send: Any) -> None:
    """Answer with a problem document, without the framework."""
    body = json.dumps(problem.document(path)).encode()
    headers = {"content-type": MEDIA_TYPE, "content-length": str(len(body)), "connection": "close", **problem.headers}
    listed = [(key.lower().encode(), value.encode("latin-1")) for key, value in headers.items()]
    await send({"type": "http.response.start", "status": problem.status, "headers": listed})
    await send({"type": "http.response.body", "body": body})
