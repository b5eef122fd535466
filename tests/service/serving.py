"""A service as people run it: `linktwin serve` in a process of its own, asked over HTTP."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import httpx

from backend.service.settings import Settings

ROOT = Path(__file__).resolve().parents[2]
FOURBAR = ROOT / "samples" / "fourbar" / "mechanism.json"
STAND_IN = ROOT / "tests" / "service" / "stand_in.py"
PATIENCE_S = 90.0  # a busy machine starts processes slowly; nothing waits so long on a quiet one
Found = TypeVar("Found")


def until(what: str, look: Callable[[], Found | None]) -> Found:
    """What `look` finds, as soon as it finds something."""
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        if found := look():
            return found
        time.sleep(0.05)
    raise AssertionError(f"not within {PATIENCE_S:g} s: {what}")


def settings_in(folder: Path, **more: Any) -> Settings:
    """Settings of a small, quick service whose jobs are stood in for."""
    quick = {
        "data_folder": folder / "data", "port": 0, "workers": 2,
        "poll_s": 0.1, "heartbeat_s": 0.3, "dead_after_s": 10.0,
        "job_command": (sys.executable, "-I", "-S", str(STAND_IN), str(folder / "ledger")),
        "requests_per_minute": 60_000, "request_burst": 10_000,
    }  # fmt: skip
    return Settings(**{**quick, **more})


def pendulum(*releases: str) -> bytes:
    """The measured pendulum as a zip: a study of these of its releases, all where none is named."""
    sample = ROOT / "samples" / "pendulum"
    told = json.loads((sample / "measured" / "study.json").read_text())
    kept = [one for one in told["experiments"] if not releases or one["id"] in releases]
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.write(sample / "mechanism.json", "mechanism.json")
        for one in kept:
            archive.write(sample / "measured" / one["tracks"], one["tracks"])
        archive.writestr("study.json", json.dumps({**told, "mechanism": "mechanism.json", "experiments": kept}))
    return packed.getvalue()


@dataclass
class Served:
    """A running service."""

    supervisor: subprocess.Popen
    client: httpx.Client
    folder: Path
    log: Path
    web_start_s: float = 0.0  # what the web process took of a core until it answered

    def store(self, file: Path = FOURBAR) -> str:
        """Store a drawing; its id."""
        headers = {"content-type": "application/json"}
        answer = self.client.post("/api/v1/mechanisms", content=file.read_bytes(), headers=headers)
        assert answer.status_code == 201, answer.text
        return answer.json()["id"]

    def store_study(self, folder: bytes) -> str:
        """Store a study's zip; its id."""
        answer = self.client.post("/api/v1/studies", content=folder, headers={"content-type": "application/zip"})
        assert answer.status_code == 201, answer.text
        return answer.json()["id"]

    def start(self, mechanism: str, headers: dict[str, str] | None = None, **options: Any) -> str:
        """Ask for a simulation; the job's id."""
        return self.ask({"kind": "simulate", "mechanism": mechanism, **options}, headers)

    def ask(self, asked: dict[str, Any], headers: dict[str, str] | None = None) -> str:
        """Ask for a job; its id."""
        answer = self.client.post("/api/v1/jobs", json=asked, headers=headers)
        assert answer.status_code == 202, answer.text
        assert answer.headers["location"] == f"/api/v1/jobs/{answer.json()['id']}"
        return answer.json()["id"]

    def job(self, id: str) -> dict[str, Any]:
        """A job as told."""
        answer = self.client.get(f"/api/v1/jobs/{id}")
        assert answer.status_code == 200, answer.text
        return answer.json()

    def finished(self, id: str) -> dict[str, Any]:
        """A job at its end."""

        def look() -> dict[str, Any] | None:
            try:
                job = self.job(id)
            except httpx.TransportError:  # the web process was killed under an open connection
                return None
            return job if job["finished"] else None

        return until(f"job {id} ends", look)

    def running(self, id: str) -> dict[str, Any]:
        """A job under way: its process has told of itself."""

        def look() -> dict[str, Any] | None:
            job = self.job(id)
            return job if job["state"] == "running" and job["words"] else None

        return until(f"job {id} runs", look)

    def ledger(self, what: str, id: str) -> int:
        """How often a job's process began, or came to its end."""
        ledger = self.folder / "ledger"
        return ledger.read_text().count(f"{what} {id} ") if ledger.exists() else 0

    def processes(self, module: str) -> list[int]:
        """Processes that the supervisor keeps, by module: backend.service.web or backend.service.jobs."""
        children = f"/proc/{self.supervisor.pid}/task/{self.supervisor.pid}/children"
        pids = [int(pid) for pid in Path(children).read_text().split()]
        return [pid for pid in pids if module in _command(pid)]


def used_s(pid: int) -> float:
    """User and system time of a process [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _command(pid: int) -> list[str]:
    try:
        return Path(f"/proc/{pid}/cmdline").read_text().split("\0")
    except OSError:
        return []


@contextmanager
def serving(folder: Path, settings: Settings) -> Iterator[Served]:
    """Run `linktwin serve` until the end of the block; whatever it logs lies in folder/log."""
    folder.mkdir(parents=True, exist_ok=True)
    log = folder / "log"
    before = log.stat().st_size if log.exists() else 0
    environment = {**os.environ, **settings.environment(), "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", "from backend.cli import main; main()", "serve"]
    with log.open("ab") as writing:
        process = subprocess.Popen(command, env=environment, stdout=writing, stderr=writing, cwd=folder)

    def address() -> str | None:
        assert process.poll() is None, log.read_text()
        found = [line.split()[1] for line in log.read_text()[before:].splitlines() if line.startswith("serving ")]
        return found[-1] if found else None

    try:
        with httpx.Client(base_url=until("it listens", address), timeout=PATIENCE_S) as client:
            health = client.get("/health")
            assert health.status_code == 200, log.read_text()
            served = Served(process, client, folder, log)
            served.web_start_s = used_s(*served.processes("backend.service.web"))
            yield served
    finally:
        process.terminate()
        process.wait(20)


def events(client: httpx.Client, id: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Server-sent events of a job: name and data."""
    with client.stream("GET", f"/api/v1/jobs/{id}/events") as answer:
        assert answer.headers["content-type"].startswith("text/event-stream")
        name = ""
        for line in answer.iter_lines():
            if line.startswith("event:"):
                name = line.removeprefix("event:").strip()
            elif line.startswith("data:"):
                yield name, json.loads(line.removeprefix("data:"))
