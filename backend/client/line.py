"""The line to a service: one request and its answer, asked again where the line broke."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import IO, Any, TypeVar
from urllib.parse import urlsplit

import httpx
from pydantic import TypeAdapter, ValidationError

from backend.client.problem import ServiceProblem, no_answer, not_ours, refused
from backend.service.answers import API

LOOPBACK = ("localhost", "127.0.0.1", "::1")
PAUSES_S = (0.2, 0.5, 1.0, 2.0)  # before each further attempt
CONNECT_S, ANSWER_S = 10.0, 120.0  # a large study is read before it is answered
CHUNK = 2**18
Answer = TypeVar("Answer")
Done = TypeVar("Done")


class Line:
    """Requests to one service under one key.  Everything that goes wrong is a ServiceProblem."""

    def __init__(self, url: str, key: str | None):
        self.url = _address(url, key)
        headers = {"Authorization": f"Bearer {key}"} if key else {}
        # Redirects are not followed: one would carry the key and the drawing somewhere else.
        self.http = httpx.Client(
            base_url=self.url + API, headers=headers, timeout=httpx.Timeout(ANSWER_S, connect=CONNECT_S)
        )

    def ask(self, method: str, path: str, **more: Any) -> httpx.Response:
        """An answer that grants what was asked; asked again where it may do better."""
        return attempt(lambda: self.once(method, path, **more))

    def once(self, method: str, path: str, **more: Any) -> httpx.Response:
        """The same, asked once."""
        with self.stream(method, path, **more) as answer:
            answer.read()
            return answer

    @contextmanager
    def stream(self, method: str, path: str, **more: Any) -> Iterator[httpx.Response]:
        """The same, its body still to be read."""
        try:
            with self.http.stream(method, path, **more) as answer:
                if not answer.is_success:
                    answer.read()
                    raise refused(answer)
                yield answer
        except httpx.RequestError as error:
            raise no_answer(self.url, error) from error


def attempt(once: Callable[[], Done]) -> Done:
    """Do what may be done twice, and do it again a few times where it may do better."""
    for pause_s in PAUSES_S:
        try:
            return once()
        except ServiceProblem as problem:
            if not problem.passing:
                raise
            time.sleep(max(pause_s, problem.retry_after_s or 0.0))
    return once()


def read(kind: type[Answer], answer: httpx.Response) -> Answer:
    """The answer as one of the service's models."""
    return parsed(kind, answer.content, answer)


def parsed(kind: type[Answer], text: bytes | str, answer: httpx.Response) -> Answer:
    """A part of an answer as one of the service's models."""
    try:
        return TypeAdapter(kind).validate_json(text)
    except ValidationError:
        told = answer.headers.get("content-type", "something")
        raise not_ours(answer.url, f"{told} that linktwin does not write", answer.status_code) from None


def pieces(file: IO[bytes], size: int, sent: Callable[[float], None]) -> Iterator[bytes]:
    """A file on its way out; `sent` is told the part of it that has gone."""
    gone = 0
    while chunk := file.read(CHUNK):
        yield chunk
        gone += len(chunk)
        sent(gone / size)


def _address(url: str, key: str | None) -> str:
    """The address without a slash at its end; ValueError where it is none, or would show the key to others."""
    url = url.strip().rstrip("/")
    try:
        parts = urlsplit(url)
        known = parts.scheme in ("http", "https") and bool(parts.hostname) and parts.port != 0
    except ValueError:  # a port that is no number
        known = False
    if not known or parts.username or parts.query or parts.fragment:
        raise ValueError(f"{url!r} is no address of a service; write http://127.0.0.1:8000")
    if key and parts.scheme == "http" and parts.hostname not in LOOPBACK:
        raise ValueError(f"the key would travel unencrypted to {parts.hostname}; write https:// there")
    if key and not (key.isascii() and key.isprintable() and " " not in key):
        raise ValueError("the key holds a space or a letter that no key has; copy it again")
    return url
