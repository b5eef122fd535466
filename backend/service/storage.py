"""Stored files under any fsspec URL; each is written once, under a name nobody chose."""

from __future__ import annotations

import hashlib
import os
import shutil
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

CHUNK = 2**20
OWNER = "database.sha256"  # beside the files: whose they are


@dataclass(frozen=True)
class Kept:
    """A file in storage: its key there, its size and digest."""

    key: str
    bytes: int
    sha256: str


class Storage:
    """Puts, reads and drops files; on a plain folder no copy is made to hand one to a job."""

    def __init__(self, url: str):
        import fsspec

        try:
            self.files, self.root = fsspec.core.url_to_fs(url)
        except (ImportError, ValueError) as error:
            raise ValueError(
                f"the storage {url.partition('://')[0]}:// cannot be opened: {error}. Install its fsspec package "
                "beside linktwin (s3fs for s3://, gcsfs for gs://), or name a folder"
            ) from error
        self.is_local = "file" in _protocols(self.files)
        if self.is_local:
            Path(self.root).mkdir(parents=True, exist_ok=True)

    def put(self, path: Path) -> Kept:
        """Keep a copy of a file; whole or not at all."""
        key, digest, size = str(uuid.uuid4()), hashlib.sha256(), 0
        place = self._place(key)
        part = f"{place}.part" if self.is_local else place  # object stores show nothing before the last byte
        if self.is_local:
            Path(place).parent.mkdir(parents=True, exist_ok=True)
        try:
            with path.open("rb") as source, self.files.open(part, "wb") as target:
                while chunk := source.read(CHUNK):
                    digest.update(chunk)
                    size += len(chunk)
                    target.write(chunk)
                if self.is_local:
                    target.flush()
                    os.fsync(target.fileno())
            if self.is_local:
                os.replace(part, place)
        except BaseException:
            with suppress(Exception):  # an object store keeps what it has of a file that breaks off, a full disk too
                self.files.rm_file(part)
            raise
        return Kept(key, size, digest.hexdigest())

    def chunks(self, key: str) -> Iterator[bytes]:
        """Its bytes, a MiB at a time; FileNotFoundError where it is gone."""
        with self.files.open(self._place(key), "rb") as source:
            while chunk := source.read(CHUNK):
                yield chunk

    def read(self, key: str) -> bytes:
        """All its bytes."""
        return b"".join(self.chunks(key))

    def bring(self, key: str, to: Path) -> None:
        """Lay a file at a path of this machine, for reading."""
        to.parent.mkdir(parents=True, exist_ok=True)
        with whole(to) as part:
            if self.is_local:
                part.symlink_to(self._place(key))
                return
            with self.files.open(self._place(key), "rb") as source, part.open("wb") as target:
                shutil.copyfileobj(source, target, CHUNK)

    def path(self, key: str) -> Path | None:
        """Where a file lies on this machine; None in an object store."""
        return Path(self._place(key)) if self.is_local else None

    def drop(self, key: str) -> None:
        """Remove it; one that is gone is no error."""
        try:
            self.files.rm_file(self._place(key))
        except FileNotFoundError:
            return

    def owner(self) -> str | None:
        """Which database's files these are, as `belong_to` was told; None before."""
        try:
            return self.files.cat_file(f"{self.root}/{OWNER}").decode()
        except FileNotFoundError:
            return None

    def belong_to(self, database: str) -> None:
        """Say which database's files these are."""
        self.files.pipe_file(f"{self.root}/{OWNER}", database.encode())

    def written(self) -> Iterator[tuple[str, float]]:
        """Every kept file in storage, with the time it was written where the storage knows."""
        for place, told in self.files.find(self.root, detail=True).items():
            if place.endswith(f"/{OWNER}"):
                continue
            changed = told.get("mtime") or told.get("LastModified") or told.get("created") or 0.0
            yield place.rsplit("/", 1)[-1], changed.timestamp() if isinstance(changed, datetime) else float(changed)

    def _place(self, key: str) -> str:
        return f"{self.root}/{key[:2]}/{key}"


@contextmanager
def whole(to: Path) -> Iterator[Path]:
    """Where to write what is to lie at a path: it takes its name at the end of the block, or not at all."""
    part = to.with_name(f".{uuid.uuid4().hex[:12]}{to.suffix}")
    try:
        yield part
        os.replace(part, to)
    finally:
        part.unlink(missing_ok=True)


def _protocols(files: Any) -> tuple[str, ...]:
    return (files.protocol,) if isinstance(files.protocol, str) else tuple(files.protocol)
