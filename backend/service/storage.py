"""Stored files under any fsspec URL; each is written once, under a name nobody chose."""

from __future__ import annotations

import hashlib
import os
import uuid
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

CHUNK = 2**20
BLOCK = (
    8 * CHUNK
)  # of an object store at once, in memory; s3fs alone would take 50 MiB for each file it reads or writes
OWNER = "database.sha256"  # beside the files: whose they are


@dataclass(frozen=True)
class Kept:
    """A file in storage: its key there, its size and digest."""

    key: str
    bytes: int
    sha256: str


class StorageAway(Exception):
    """An object store does not answer, or refuses; what its own library raised is the cause."""


class Storage:
    """Puts, reads and drops files; on a plain folder no copy is made to hand one to a job.

    Beyond what each method tells, StorageAway is raised where an object store fails, OSError where a folder does.
    """

    def __init__(self, url: str):
        import fsspec

        try:
            # Other processes write and drop files too: a list that is remembered hides theirs.
            self.files, self.root = fsspec.core.url_to_fs(url, use_listings_cache=False)
        except (ImportError, ValueError) as error:
            raise ValueError(
                f"the storage {url.partition('://')[0]}:// cannot be opened: {error}. Install its fsspec package "
                "(pip install 'linktwin[s3]' for s3://, gcsfs for gs://), or name a folder"
            ) from error
        protocols = _protocols(self.files)
        self.url = f"{protocols[0]}://{self.root}"
        self.is_local = "file" in protocols
        if self.is_local:
            Path(self.root).mkdir(parents=True, exist_ok=True)

    def prove(self) -> None:
        """Write, read and drop a few bytes.  ValueError where that fails: no such bucket, a key that opens nothing."""
        place = f"{self.root}/{uuid.uuid4()}"
        try:
            self.files.pipe_file(place, b"linktwin")
            self.files.cat_file(place)
            self.files.rm_file(place)
        except Exception as error:  # each store's library has its own
            raise ValueError(
                f"nothing can be kept in the storage {self.url}: {str(error).rstrip('.')}. Make the bucket where there "
                "is none, and see that endpoint and credentials (AWS_ENDPOINT_URL, AWS_ACCESS_KEY_ID and "
                "AWS_SECRET_ACCESS_KEY for s3://) may write, read and delete there"
            ) from error

    def put(self, path: Path) -> Kept:
        """Keep a copy of a file; whole or not at all."""
        key, digest, size = str(uuid.uuid4()), hashlib.sha256(), 0
        place = self._place(key)
        part = f"{place}.part" if self.is_local else place  # object stores show nothing before the last byte
        if self.is_local:
            Path(place).parent.mkdir(parents=True, exist_ok=True)
        try:
            with self._asked(), path.open("rb") as source, self.files.open(part, "wb", block_size=BLOCK) as target:
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

    def chunks(self, key: str, start: int = 0, stop: int | None = None) -> Iterator[bytes]:
        """Its bytes from one on, up to another, a MiB at a time; FileNotFoundError where it is gone."""
        with self._asked(), self.files.open(self._place(key), "rb", block_size=BLOCK) as source:
            source.seek(start)
            while chunk := source.read(CHUNK if stop is None else min(CHUNK, stop - source.tell())):
                yield chunk

    def read(self, key: str) -> bytes:
        """All its bytes; FileNotFoundError where it is gone."""
        with self._asked():
            return self.files.cat_file(self._place(key))

    def bring(self, key: str, to: Path) -> None:
        """Lay a file at a path of this machine, for reading."""
        to.parent.mkdir(parents=True, exist_ok=True)
        with whole(to) as part:
            if self.is_local:
                part.symlink_to(self._place(key))
                return
            with part.open("wb") as target:
                for chunk in self.chunks(key):
                    target.write(chunk)

    def drop(self, key: str) -> None:
        """Remove it; one that is gone is no error."""
        with suppress(FileNotFoundError), self._asked():
            self.files.rm_file(self._place(key))

    def let_go(self, keys: Iterable[str]) -> None:
        """Remove files that no record names any more; what cannot be removed now is tidied up later."""
        with suppress(Exception):  # a store that is away is not asked for each of them
            for key in keys:
                self.drop(key)

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
    def _asked(self) -> Iterator[None]:
        try:
            yield
        except FileNotFoundError:
            raise
        except Exception as error:
            if self.is_local:
                raise
            raise StorageAway(f"the storage {self.url} failed: {error}") from error


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
