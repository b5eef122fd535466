"""The service over HTTP, with nothing but the standard library."""

from __future__ import annotations

import http.client
import io
import json
import socket
import time
import urllib.error
import urllib.request
import zipfile
from collections.abc import Callable
from pathlib import Path

TIMEOUT_S = 30.0
PAUSES_S = (0.5, 2.0)  # before what no answer came to is asked again
LARGEST_ANSWER = 4 * 2**20


class Refused(Exception):
    """The service answered no. `status` is HTTP's; the text is the service's own words, with its remedy."""

    def __init__(self, status: int, text: str):
        super().__init__(text)
        self.status = status


class Unreachable(Exception):
    """No answer came: nothing listens there, the name is unknown, or the connection broke."""


class Cancelled(Exception):
    """The user stopped it."""


class _NoRedirects(urllib.request.HTTPRedirectHandler):
    """A redirect would carry the key and the drawing somewhere else."""

    def redirect_request(self, *_args, **_kwargs):
        """Not followed."""


class _Watched(io.BytesIO):
    """Bytes that tell how many of them have been read."""

    def __init__(self, data: bytes, told: Callable[[int, int], None]):
        super().__init__(data)
        self._size, self._told = len(data), told

    def read(self, size: int | None = -1) -> bytes:
        """The next bytes."""
        chunk = super().read(size)
        self._told(self.tell(), self._size)
        return chunk


class Service:
    """A LinkTwin service at an address.

    url: without a slash at its end.  key: sent with every request where there is one.
    """

    def __init__(self, url: str, key: str = ""):
        self.url, self._key = url, key
        self._opener = urllib.request.build_opener(_NoRedirects)

    def check(self) -> None:
        """Ask for nothing much: a key that is refused is better told before the upload than in the middle of it."""
        self._ask("GET", "/api/v1/mechanisms?limit=1")

    def store_mechanism(
        self, folder: Path, repeat_key: str, progress: Callable[[int, int], None] = lambda *_: None
    ) -> dict:
        """Send an export (mechanism.json and its meshes) as one zip; the stored mechanism, with its `id`.

        repeat_key: the same stores it once, however often it is sent.  progress: told bytes sent and bytes in all; what
        it raises ends the upload.  Where the line breaks it is sent again.  Raises Refused and Unreachable.
        """
        data = packed(folder)
        headers = {"Content-Type": "application/zip", "Content-Length": str(len(data)), "Idempotency-Key": repeat_key}
        return _again(lambda: self._ask("POST", "/api/v1/mechanisms", _Watched(data, progress), headers))

    def start_job(self, request: dict, repeat_key: str) -> dict:
        """Ask for work; the job, with its `id`. The same repeat_key starts it once however often it is sent."""
        headers = {"Content-Type": "application/json", "Idempotency-Key": repeat_key}
        return _again(lambda: self._ask("POST", "/api/v1/jobs", json.dumps(request).encode(), headers))

    def job(self, id: str) -> dict:
        """A job as it stands."""
        return self._ask("GET", f"/api/v1/jobs/{id}")

    def cancel_job(self, id: str) -> None:
        """End a job."""
        self._ask("DELETE", f"/api/v1/jobs/{id}")

    def page(self, mechanism: str = "") -> str:
        """The address of the page, with a mechanism opened."""
        return f"{self.url}/ui/" + (f"mechanisms/{mechanism}" if mechanism else "")

    def _ask(self, method: str, path: str, data: object = None, headers: dict | None = None) -> dict:
        told = {"Accept": "application/json", **(headers or {})}
        if self._key:
            told["Authorization"] = f"Bearer {self._key}"
        request = urllib.request.Request(self.url + path, data=data, headers=told, method=method)  # type: ignore[arg-type]
        try:
            with self._opener.open(request, timeout=TIMEOUT_S) as answer:
                return _object(answer.read(LARGEST_ANSWER), answer.headers.get("Location"))
        except urllib.error.HTTPError as error:
            with error:
                raise Refused(error.code, _reason(error)) from None
        except (urllib.error.URLError, http.client.HTTPException, socket.timeout, ConnectionError) as error:
            reason = getattr(error, "reason", error)
            raise Unreachable(
                f"{self.url} does not answer ({reason}); start the service (linktwin serve), or correct its address in "
                "the settings"
            ) from None


def _again(ask: Callable[[], dict]) -> dict:
    """Ask; and again where no answer came, since what was asked carries a key under which it is done once."""
    for pause_s in PAUSES_S:
        try:
            return ask()
        except Unreachable:
            time.sleep(pause_s)
    return ask()


def packed(folder: Path) -> bytes:
    """mechanism.json and meshes/ as a zip; what Fusion said (raw/) stays here."""
    folder = Path(folder)
    files = [folder / "mechanism.json", *sorted((folder / "meshes").glob("*.stl"))]
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in files:
            archive.write(file, file.relative_to(folder).as_posix())
    return stream.getvalue()


def _object(text: bytes, location: str | None) -> dict:
    """The answer as an object; one that only has an address gets its `id` from there."""
    try:
        found = json.loads(text) if text.strip() else {}
    except ValueError:
        raise Refused(200, "the answer is no JSON: this is not a LinkTwin service; correct its address") from None
    if not isinstance(found, dict):
        raise Refused(200, "the answer is no object: this is not a LinkTwin service; correct its address")
    if "id" not in found and location:
        found["id"] = location.rstrip("/").rsplit("/", 1)[-1]
    return found


def _reason(error: urllib.error.HTTPError) -> str:
    """What a problem document (RFC 9457) says, or else HTTP's own words."""
    try:
        told = json.loads(error.read(LARGEST_ANSWER))
    except (ValueError, OSError, http.client.HTTPException):
        told = None
    if not isinstance(told, dict):
        return f"{error.code} {error.reason}; check the address in the settings"
    faults = [str(fault) for fault in told.get("errors") or ()]
    text = str(told.get("detail") or told.get("title") or error.reason)
    if error.code in (401, 403):
        text += " Set the key in LinkTwin's settings."
    return " ".join([text, *faults])
