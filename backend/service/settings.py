"""What can be set: by environment, each name with LINKTWIN_ before it, or by options of `linktwin serve`."""

from __future__ import annotations

import ipaddress
import sys
from pathlib import Path
from typing import Annotated

from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict

MIB = 2**20


class Settings(BaseSettings):
    """Everything the service is told.  Sizes in bytes, times in seconds.

    Left alone, everything lives in `data_folder`: two SQLite files, stored files, and scratch space.
    """

    model_config = SettingsConfigDict(env_prefix="LINKTWIN_", extra="ignore", frozen=True)

    data_folder: Path = Path("out/service")
    database_url: str | None = None  # sqlite or postgresql; the records
    queue_url: str | None = None  # where DBOS keeps the queue; beside the records where nothing is said
    storage_url: str | None = None  # any fsspec URL: file://, s3://, ...

    host: str = "127.0.0.1"
    port: Annotated[int, Field(ge=0, le=65535)] = 8000
    workers: Annotated[int, Field(ge=0, le=256)] = 1
    require_keys: bool | None = None  # None: everywhere but on loopback
    allowed_hosts: tuple[str, ...] = ()  # further names under which the service may be asked

    largest_document: int = 16 * MIB  # mechanism.json and study.json
    largest_archive: int = 256 * MIB  # a folder as sent
    largest_folder: int = 512 * MIB  # a folder unpacked
    largest_table: int = 32 * MIB
    largest_video: int = 4096 * MIB
    most_files: int = 2000  # in one folder
    most_parts: int = 20_000  # bodies, joints, effects and markers of one drawing, together
    most_rows: int = 2_000_000  # of one Parquet table
    stall_s: float = 30.0  # an upload that stays silent so long is dropped
    slowest_bytes_per_s: float = 1024.0  # an upload slower than this on average is dropped

    stored_bytes_per_owner: int = 20 * 1024 * MIB
    active_jobs_per_owner: int = 100
    requests_per_minute: int = 600
    request_burst: int = 200
    event_streams_per_owner: int = 32
    retention_days: Annotated[float, Field(gt=0.0)] | None = None  # None: kept until deleted

    job_command: tuple[str, ...] = (sys.executable, "-c", "from backend.cli import main; main()")
    job_timeout_s: float = 24 * 3600.0
    job_memory_bytes: int = 8 * 1024 * MIB
    job_file_bytes: int = 8 * 1024 * MIB
    job_nice: int = 5
    most_attempts: int = 20  # a job whose worker died so often is given up
    most_crashes: int = 3  # a job whose own process was killed so often is given up
    heartbeat_s: float = 1.0
    dead_after_s: float = 30.0  # a worker silent so long has lost its jobs; one that ended is noticed at once
    checkpoint_s: float = 5.0  # how often what a job keeps to go on from is copied to storage
    poll_s: float = 0.2  # how often a worker looks for jobs, for cancellations and for progress

    @property
    def database(self) -> str:
        """SQLAlchemy URL of the records."""
        return _driver(self.database_url or f"sqlite:///{self.data_folder.resolve() / 'records.sqlite'}")

    @property
    def queue(self) -> str:
        """URL that DBOS is given: its own SQLite file, or its own schema in the same PostgreSQL."""
        if self.queue_url:
            return self.queue_url
        if self.database.startswith("sqlite"):
            return f"sqlite:///{self.data_folder.resolve() / 'queue.sqlite'}"
        return self.database.replace("postgresql+psycopg://", "postgresql://", 1)

    @property
    def storage(self) -> str:
        """fsspec URL under which stored files lie."""
        return self.storage_url or f"file://{self.data_folder.resolve() / 'files'}"

    @property
    def scratch(self) -> Path:
        """Folder on this machine for uploads on their way and for jobs at work."""
        return self.data_folder.resolve() / "scratch"

    @property
    def on_loopback(self) -> bool:
        """Whether only this machine can reach the service."""
        if self.host == "localhost":
            return True
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return False

    @property
    def keys_required(self) -> bool:
        """Whether every request must show an API key: always where others reach it, whatever is set."""
        return not self.on_loopback or bool(self.require_keys)

    def environment(self) -> dict[str, str]:
        """The same settings as variables, for the processes that `linktwin serve` starts."""
        told = self.model_dump(mode="json", exclude_none=True)
        return {f"LINKTWIN_{name.upper()}": _as_text(value) for name, value in told.items()}


def _as_text(value: object) -> str:
    import json

    return value if isinstance(value, str) else json.dumps(value)


def _driver(url: str) -> str:
    for plain in ("postgres://", "postgresql://"):
        if url.startswith(plain):
            return "postgresql+psycopg://" + url.removeprefix(plain)
    return url
