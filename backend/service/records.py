"""What the service remembers: one table a class.  Times are seconds since 1970 (UTC), sizes bytes."""

from __future__ import annotations

import time
import uuid
from typing import Any, ClassVar

from sqlalchemy import JSON, BigInteger, Column, UniqueConstraint
from sqlmodel import Field, SQLModel


def new_id() -> str:
    """A name nobody can guess."""
    return str(uuid.uuid4())


class Account(SQLModel, table=True):
    """An owner of things; its row is locked while a quota is weighed."""

    owner: str = Field(primary_key=True, max_length=64)
    stored_bytes: int = Field(default=0, sa_column=Column(BigInteger, nullable=False))


class ApiKey(SQLModel, table=True):
    """A key by its digest; several keys may open the same owner's things."""

    __tablename__: ClassVar[Any] = "api_key"

    id: str = Field(default_factory=new_id, primary_key=True, max_length=36)
    owner: str = Field(index=True, max_length=64)
    digest: str = Field(unique=True, max_length=64)
    created: float = Field(default_factory=time.time)
    revoked: float | None = None


class Thing(SQLModel, table=True):
    """A mechanism, a study or a video that somebody stored; its files are StoredFile rows."""

    id: str = Field(default_factory=new_id, primary_key=True, max_length=36)
    owner: str = Field(index=True, max_length=64)
    kind: str = Field(index=True, max_length=16)
    name: str = Field(max_length=200)
    bytes: int = Field(sa_column=Column(BigInteger, nullable=False))
    summary: dict[str, Any] = Field(default_factory=dict, sa_column=Column(JSON, nullable=False))
    created: float = Field(default_factory=time.time, index=True)


class StoredFile(SQLModel, table=True):
    """One file of a thing, or one that a job wrote.  `key` is its name in storage, `path` its name for people."""

    __tablename__: ClassVar[Any] = "stored_file"
    __table_args__ = (UniqueConstraint("of", "path"),)

    key: str = Field(primary_key=True, max_length=64)
    of: str = Field(index=True, max_length=64)  # id of the thing or of the job; checkpoint:ID while a job runs
    path: str = Field(max_length=400)
    bytes: int = Field(sa_column=Column(BigInteger, nullable=False))
    sha256: str = Field(max_length=64)
    media_type: str = Field(max_length=100)


class Job(SQLModel, table=True):
    """Work asked for.  `attempt` fences: only who holds the latest attempt may say how it ended."""

    id: str = Field(default_factory=new_id, primary_key=True, max_length=36)
    owner: str = Field(index=True, max_length=64)
    kind: str = Field(max_length=16)
    request: dict[str, Any] = Field(sa_column=Column(JSON, nullable=False))
    state: str = Field(default="queued", index=True, max_length=16)
    created: float = Field(default_factory=time.time, index=True)
    handed_over: float | None = Field(default=None, index=True)  # when the durable queue took it
    handovers: int = 0
    attempt: int = 0
    crashes: int = 0
    worker: str | None = Field(default=None, index=True, max_length=36)
    started: float | None = None
    finished: float | None = Field(default=None, index=True)
    part: float = 0.0
    words: str = Field(default="", max_length=200)
    exit_code: int | None = None
    message: str = Field(default="", max_length=8000)
    bytes: int = Field(default=0, sa_column=Column(BigInteger, nullable=False))


class Repeat(SQLModel, table=True):
    """An Idempotency-Key and what it made: a job, or a stored thing."""

    owner: str = Field(primary_key=True, max_length=64)
    key: str = Field(primary_key=True, max_length=255)
    fingerprint: str = Field(max_length=64)
    made: str = Field(max_length=36)
    created: float = Field(default_factory=time.time)


class Worker(SQLModel, table=True):
    """A worker process; it is dead once `ended` stands, or when its heartbeat is old."""

    id: str = Field(primary_key=True, max_length=36)
    host: str = Field(max_length=255)
    pid: int
    started: float = Field(default_factory=time.time)
    beat: float = Field(default_factory=time.time, index=True)
    ended: float | None = None
