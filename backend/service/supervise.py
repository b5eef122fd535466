"""`linktwin serve`: one web process and N workers, started again whenever one dies or falls silent."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
import uuid
from collections.abc import Callable
from dataclasses import dataclass, field
from types import FrameType

from backend.service.pulse import Pulse
from backend.service.settings import Settings

QUICK_S = 3.0  # a process that dies sooner after its start is started again more slowly each time
SLOWEST_S = 15.0


@dataclass
class Kept:
    """A process that is kept alive.  start: begins it under a name of its own; died: told the name after its end."""

    start: Callable[[str, Pulse], subprocess.Popen]
    dead_after_s: float
    died: Callable[[str], None] = lambda name: None
    name: str = ""
    process: subprocess.Popen | None = None
    pulse: Pulse | None = None
    began: float = 0.0
    quick: int = field(default=0)

    def look(self) -> None:
        """Start it, or start it again; end it where it has been silent for too long."""
        now = time.monotonic()
        if self.process is not None and self.pulse is not None:
            if self.process.poll() is None:
                if self.pulse.silent_s() < self.dead_after_s:
                    return
                self.process.kill()
                self.process.wait()
            self.pulse.close()
            self.died(self.name)
            self.quick = self.quick + 1 if now - self.began < QUICK_S else 0
            self.process = None
        if now >= self.began + min(SLOWEST_S, 2.0 ** min(self.quick - 1, 4) if self.quick else 0.0):
            self.name, self.began, self.pulse = str(uuid.uuid4()), now, Pulse.open()
            self.process = self.start(self.name, self.pulse)
            os.close(self.pulse.writing)


def supervise(settings: Settings, listens: Callable[[str], None] = lambda url: None) -> None:
    """Serve until SIGTERM or Ctrl-C.  listens: told the address.  Raises OSError where it cannot be listened on."""
    listening = socket.create_server(
        (settings.host, settings.port), backlog=1024, reuse_port=False,
        family=socket.AF_INET6 if ":" in settings.host else socket.AF_INET,
    )  # fmt: skip
    # The socket is held here: while a web process is started again, who asks waits instead of being refused.
    listening.set_inheritable(True)
    here, port = str(os.getpid()), listening.getsockname()[1]
    environment = {**os.environ, **settings.model_copy(update={"port": port}).environment()}

    def begin(module: str, *words: str, files: tuple[int, ...]) -> subprocess.Popen:
        command = [sys.executable, "-m", module, here, *words]
        return subprocess.Popen(command, env=environment, pass_fds=files, start_new_session=True)

    def web(name: str, pulse: Pulse) -> subprocess.Popen:
        files = (pulse.writing, listening.fileno())
        return begin("backend.service.web", *(str(file) for file in files), files=files)

    def worker(name: str, pulse: Pulse) -> subprocess.Popen:
        return begin("backend.service.jobs", str(pulse.writing), name, files=(pulse.writing,))

    silence = settings.dead_after_s
    workers = [Kept(worker, silence, lambda name: _bury(settings, name)) for _ in range(settings.workers)]
    kept = [Kept(web, silence), *workers]
    host = f"[{settings.host}]" if ":" in settings.host else settings.host
    listens(f"http://{host}:{port}")
    ended = _told_to_end()
    try:
        while not ended():
            for one in kept:
                one.look()
            time.sleep(0.1)
    finally:
        _end([one.process for one in kept if one.process is not None])


def _bury(settings: Settings, worker: str) -> None:
    """Say that a worker is dead, so that its jobs need not wait until its heartbeat is missed."""
    from sqlalchemy.exc import SQLAlchemyError

    from backend.service.database import Database
    from backend.service.records import Worker

    database = Database(settings.database)
    try:
        with database.writing() as session:
            if (row := session.get(Worker, worker)) is not None:
                row.ended = time.time()
                session.add(row)
    except SQLAlchemyError:
        return  # its heartbeat will be missed
    finally:
        database.close()


def _told_to_end() -> Callable[[], bool]:
    told: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        told.append(number)

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, note)
    return lambda: bool(told)


def _end(processes: list[subprocess.Popen]) -> None:
    """Workers lose nothing: their jobs go on from their checkpoints at the next start."""
    for process in processes:
        process.terminate()
    until = time.monotonic() + 5.0
    for process in processes:
        try:
            process.wait(max(0.1, until - time.monotonic()))
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
