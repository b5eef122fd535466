"""One job's process: started, watched, ended with all that it started."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from backend.service.settings import Settings

# What a job may know of the service's own surroundings: never its database, storage or keys.
PASSED_ON = ("PATH", "HOME", "LANG", "LC_ALL", "TZ", "PYTHONPATH", "XDG_CACHE_HOME", "LINKTWIN_KERNEL")
PASSED_ON_BEGINNINGS = ("JAX_", "XLA_", "OMP_", "OPENBLAS_", "MKL_", "DASK_", "CUDA_")
MOST_SAID = 16 * 2**20  # of a report on standard output


@dataclass(frozen=True)
class Ended:
    """How a process ended.  code: its exit code, negative for a signal.  stopped: why we ended it, where we did."""

    code: int
    stopped: str | None = None


def run(
    command: Sequence[str],
    folder: Path,
    settings: Settings,
    told: Callable[[float, str], None],
    stop: Callable[[], str | None],
) -> Ended:
    """Run a job's command in `folder`: its words go to stdout.txt and stderr.txt there.

    told: called with the part done (0 to 1) and words, when they change.  stop: asked several times a second; a reason
    ends the process and all that it started.
    """
    progress = folder / "progress.json"
    leash = (sys.executable, "-m", "backend.service.jobs.child", str(os.getpid()))
    limits = (str(settings.job_file_bytes), str(settings.job_nice))
    began = time.monotonic()
    with (folder / "stdout.txt").open("wb") as out, (folder / "stderr.txt").open("wb") as err:
        process = subprocess.Popen(
            [*leash, *limits, *command], cwd=folder, env=_environment(folder, progress), stdin=subprocess.DEVNULL,
            stdout=out, stderr=err, start_new_session=True,
        )  # fmt: skip
        last: tuple[float, str] | None = None
        try:
            while True:
                with suppress(subprocess.TimeoutExpired):
                    return Ended(process.wait(settings.poll_s))
                if (seen := _read(progress)) is not None and seen != last:
                    last = seen
                    told(*seen)
                if reason := stop() or _beyond(process.pid, began, settings):
                    return Ended(_end(process), reason)
        finally:
            _end(process)


def _end(process: subprocess.Popen) -> int:
    """End a process group; the exit code of its leader."""
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL)
    return process.wait()


def _beyond(pid: int, began: float, settings: Settings) -> str | None:
    if (took := time.monotonic() - began) > settings.job_timeout_s:
        return f"It took {took:.0f} s, above the limit of {settings.job_timeout_s:.0f} s; ask for less."
    if (held := _resident_bytes(pid)) > settings.job_memory_bytes:
        limit = settings.job_memory_bytes // 2**20
        return f"It held {held // 2**20} MiB of memory, above the limit of {limit} MiB; ask for less at once."
    return None


def _resident_bytes(pid: int) -> int:
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, IndexError, ValueError):
        return 0


def _environment(folder: Path, progress: Path) -> dict[str, str]:
    passed = {k: v for k, v in os.environ.items() if k in PASSED_ON or k.startswith(PASSED_ON_BEGINNINGS)}
    # The project's root first: the job runs elsewhere, and must be the same program as the service.
    root = str(Path(__file__).parents[3])
    path = os.pathsep.join([root, *filter(None, [passed.get("PYTHONPATH")])])
    return {**passed, "PYTHONPATH": path, "TMPDIR": str(folder), "LINKTWIN_PROGRESS": str(progress)}


def _read(progress: Path) -> tuple[float, str] | None:
    try:
        told = json.loads(progress.read_text(encoding="utf-8"))
        return min(1.0, max(0.0, float(told["part"]))), str(told["words"])[:200]
    except (OSError, ValueError, KeyError, TypeError):
        return None


def said(folder: Path) -> str:
    """What the process wrote to standard output, up to a limit."""
    with (folder / "stdout.txt").open("rb") as file:
        return file.read(MOST_SAID).decode("utf-8", "replace")


def complaint(folder: Path) -> str:
    """The sentence after the last `error:` on standard error, or its last line."""
    text = (folder / "stderr.txt").read_bytes()[-64_000:].decode("utf-8", "replace").replace(f"{folder}/", "")
    for inner in ("inputs/", "out/"):
        text = text.replace(inner, "")
    _, found, sentence = text.rpartition("error: ")
    if found:
        return sentence.strip()[:4000]
    lines = text.strip().splitlines()
    return lines[-1][:1000] if lines else ""
