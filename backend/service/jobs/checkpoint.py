"""Checkpoints of long jobs, kept in storage while they run, for another machine to go on from; and what is watched."""

from __future__ import annotations

import os
import shutil
import time
from pathlib import Path

from sqlmodel import select

from backend.service.jobs.command import CHECKPOINTS, WATCHED
from backend.service.jobs.holding import Claim, lost
from backend.service.records import StoredFile
from backend.service.service import Service
from backend.service.things import CHECKPOINT, drop_files, files_of, stored

WATCHED_EVERY_S = 2.0


class Checkpoints:
    """What a job's command keeps in its folder to go on from, or shows of its work, copied away when it has changed."""

    def __init__(self, service: Service, claim: Claim, out: Path):
        self.service, self.claim, self.out = service, claim, out
        self.of = CHECKPOINT + claim.job.id
        self._copied: dict[str, int] = {}
        self._last: dict[str, float] = {name: time.monotonic() for name in CHECKPOINTS}

    def restore(self) -> bool:
        """Lay the last ones in the folder; whether there were any."""
        kept = [file for file in files_of(self.service, self.of) if file.path in CHECKPOINTS]
        for file in kept:
            with (self.out / file.path).open("wb") as target:
                for chunk in self.service.storage.chunks(file.key):
                    target.write(chunk)
        return bool(kept)

    def copy(self) -> None:
        """Keep what changed since the last copy; not more often than every few seconds."""
        now = time.monotonic()
        for name in (*CHECKPOINTS, WATCHED):
            pause = WATCHED_EVERY_S if name == WATCHED else self.service.settings.checkpoint_s
            if now - self._last.get(name, 0.0) < pause:
                continue
            path = self.out / name
            try:
                written = os.stat(path).st_mtime_ns
            except FileNotFoundError:
                continue
            if self._copied.get(name) != written:
                self._last[name] = now  # also where the storage is away: it is not asked more often for that
                self._keep(path)
                self._copied[name] = written

    def drop(self) -> None:
        """Forget them: the job has ended."""
        with self.service.database.writing() as session:
            keys = drop_files(session, self.of)
        self.service.storage.let_go(keys)

    def _keep(self, path: Path) -> None:
        copy = path.with_name(f".{path.name}.copied")
        try:
            shutil.copyfile(path, copy)  # the command may replace its own while this one is read
        except FileNotFoundError:
            return
        kept = self.service.storage.put(copy)
        copy.unlink()
        stale = [kept.key]
        if not lost(self.service, self.claim):
            with self.service.database.writing() as session:
                same = (StoredFile.of == self.of, StoredFile.path == path.name)
                before = list(session.exec(select(StoredFile).where(*same)))
                stale = [file.key for file in before]
                for file in before:
                    session.delete(file)
                session.flush()
                session.add(stored(self.of, path.name, kept))
        self.service.storage.let_go(stale)
