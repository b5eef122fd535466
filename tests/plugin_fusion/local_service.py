"""A service on this machine that answers as docs and routes say, for the add-in's uploads."""

import io
import json
import threading
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from backend.mechanism.drawing_error import DrawingError
from backend.mechanism.read import parse_mechanism

KEY = "lt_right"
MECHANISM, JOB = "6f1d0c9e-0000-4000-8000-000000000001", "6f1d0c9e-0000-4000-8000-000000000002"


class LocalService(ThreadingHTTPServer):
    """What it was sent, and how its one job goes."""

    daemon_threads = True
    parts = (0.0, 0.5, 1.0)  # of the job, at each time it is asked for

    def __init__(self):
        super().__init__(("127.0.0.1", 0), Handler)
        self.folders: list[dict[str, bytes]] = []
        self.requests: list[dict] = []
        self.repeat_keys: list[str | None] = []
        self.upload_keys: list[str | None] = []
        self.breaks = 0  # uploads to which no answer comes
        self.asked = 0
        self.cancelled = threading.Event()
        self.ends = "succeeded"
        self.endless = False

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server_address[1]}"


class Handler(BaseHTTPRequestHandler):
    server: LocalService
    protocol_version = "HTTP/1.1"

    def log_message(self, format, *args):
        pass

    def do_GET(self):
        if not self._known():
            return
        if self.path.startswith("/api/v1/mechanisms"):
            self._answer(200, {"items": [], "total": 0})
        else:
            self._answer(200, self._job())

    def do_POST(self):
        body = self.rfile.read(int(self.headers["Content-Length"]))
        if not self._known():
            return
        if self.path == "/api/v1/jobs":
            self.server.requests.append(json.loads(body))
            self.server.repeat_keys.append(self.headers["Idempotency-Key"])
            self._answer(202, {"id": JOB, "state": "queued", "part": 0.0}, f"/api/v1/jobs/{JOB}")
            return
        with zipfile.ZipFile(io.BytesIO(body)) as archive:
            files = {name: archive.read(name) for name in archive.namelist()}
        try:
            parse_mechanism(json.loads(files["mechanism.json"]))
        except DrawingError as error:
            self._problem(422, "The drawing has faults.", error.problems)
            return
        self.server.upload_keys.append(self.headers["Idempotency-Key"])
        if self.server.breaks:
            self.server.breaks -= 1
            self.close_connection = True
            return
        self.server.folders.append(files)
        self._answer(201, {"id": MECHANISM}, f"/api/v1/mechanisms/{MECHANISM}")

    def do_DELETE(self):
        self.server.cancelled.set()
        self._answer(200, {"id": JOB, "state": "cancelled"})

    def _job(self) -> dict:
        server = self.server
        part = server.parts[min(server.asked, len(server.parts) - 1)]
        server.asked += 1
        if server.endless:
            return {"id": JOB, "state": "running", "part": 0.1, "words": "letting it go"}
        state = server.ends if part == 1.0 else "running"
        return {"id": JOB, "state": state, "part": part, "words": "letting it go", "message": "it broke"}

    def _known(self) -> bool:
        if self.headers["Authorization"] == f"Bearer {KEY}":
            return True
        self._problem(401, "This key is not known.", ())
        return False

    def _problem(self, status: int, detail: str, errors) -> None:
        self._answer(status, {"title": "No", "detail": detail, "errors": list(errors)}, kind="application/problem+json")

    def _answer(self, status: int, told: dict, location: str | None = None, kind: str = "application/json") -> None:
        data = json.dumps(told).encode()
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(data)))
        if location:
            self.send_header("Location", location)
        self.end_headers()
        self.wfile.write(data)


@contextmanager
def local_service() -> Iterator[LocalService]:
    """A running service; its thread ends with the block."""
    service = LocalService()
    thread = threading.Thread(target=service.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    try:
        yield service
    finally:
        service.shutdown()
        thread.join()
        service.server_close()
