"""Short work that needs heavy imports: a process of the command line, so that the web process stays light."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any

from backend.service.problems import Problem
from backend.service.service import Service
from backend.service.storage import whole
from backend.service.things import file_of, files_of

LONGEST_S = 120.0
MOST_FRAMES = 8  # kept of a clip
_two = asyncio.Semaphore(2)  # at once


async def linktwin(service: Service, *arguments: str, longest_s: float = LONGEST_S) -> str:
    """Standard output of a command; Problem `invalid` with its sentence where it fails."""
    async with _two:
        process = await asyncio.create_subprocess_exec(
            *service.settings.job_command, *arguments, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE
        )
        try:
            out, said = await asyncio.wait_for(process.communicate(), longest_s)
        except (TimeoutError, asyncio.CancelledError) as error:
            process.kill()
            await process.wait()
            if isinstance(error, asyncio.CancelledError):
                raise
            raise Problem("invalid", f"It took longer than {longest_s:.0f} s and was stopped.") from None
    if process.returncode and not out:
        lines = said.decode("utf-8", "replace").strip().splitlines()
        raise Problem("invalid", lines[-1].removeprefix("error: ") if lines else f"exit code {process.returncode}")
    return out.decode("utf-8", "replace")


async def checked(service: Service, thing: str, drawing: str) -> dict[str, Any]:
    """The report of `linktwin check` on a stored drawing; kept beside it, since neither ever changes."""
    kept = place(service, f"check-{thing}.json")
    if not kept.exists():
        path = await asyncio.to_thread(brought, service, thing, drawing)
        told = await linktwin(service, "check", str(path), "--json")
        with whole(kept) as part:
            part.write_text(told, encoding="utf-8")
    return json.loads(kept.read_text(encoding="utf-8"))


async def first_frame(service: Service, video: str, from_s: float = 0.0) -> Path:
    """The first picture of a stored clip, or of what a player shows from a time on, as PNG in its own size.

    The latest few of each clip are kept.
    """
    kept = place(service, f"frame-{video}-{from_s}.png")
    if not kept.exists():
        (film,) = files_of(service, video)
        path = await asyncio.to_thread(brought, service, video, film.path)
        with whole(kept) as part:
            await linktwin(service, "still", str(path), f"--from={from_s}", f"--out={part}")
        made = sorted(kept.parent.glob(f"frame-{video}-*.png"), key=lambda png: png.stat().st_mtime)
        for old in made[:-MOST_FRAMES]:
            old.unlink(missing_ok=True)
    return kept


async def as_stl(service: Service, of: str, path: str) -> Path:
    """A stored mesh of another kind as STL, made once; Problem `invalid` says in a sentence why there is none."""
    mesh = await asyncio.to_thread(brought, service, of, path)
    kept = mesh.with_suffix(".as.stl")
    if not kept.exists():
        try:
            with whole(kept) as part:
                await linktwin(service, "surface", str(mesh), f"--out={part}")
        except Problem as problem:
            raise Problem("invalid", problem.detail.replace(str(mesh), f'"{path}"') + ".") from None
    return kept


def brought(service: Service, of: str, path: str) -> Path:
    """A stored file on this machine, for reading; its suffix is kept."""
    file = file_of(service, of, path)
    there = place(service, f"{file.key}{Path(path).suffix.lower()}")
    if not there.exists():
        service.storage.bring(file.key, there)
    return there


def place(service: Service, name: str) -> Path:
    """A file of the page's own among the scratch space: it may vanish and is then made again."""
    folder = service.settings.scratch / "page"
    folder.mkdir(parents=True, exist_ok=True)
    return folder / name
