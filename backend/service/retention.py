"""What is kept no longer: things and jobs beyond their time, and files that no record names."""

from __future__ import annotations

import shutil
import time

from sqlmodel import col, select

from backend.service.jobs.desk import forget_job
from backend.service.logs import logger
from backend.service.problems import Problem
from backend.service.records import Job, Repeat, StoredFile, Thing, Worker
from backend.service.service import Service
from backend.service.states import FINISHED
from backend.service.storage import OWNER
from backend.service.things import CHECKPOINT, delete_thing, drop_files

DAY_S = 86_400.0

_warned: set[str] = set()  # of storages: once a process


def tidy_up(service: Service) -> None:
    """Drop what is past its time, and what a process that died left behind."""
    now = time.time()
    if service.settings.retention_days is not None:
        _drop_old(service, now - service.settings.retention_days * DAY_S)
    with service.database.writing() as session:
        for row in session.exec(select(Repeat).where(Repeat.created < now - DAY_S)):
            session.delete(row)
        for row in session.exec(select(Worker).where(col(Worker.ended) < now - DAY_S)):
            session.delete(row)
    _drop_checkpoints(service)
    _drop_strays(service, now - DAY_S)


def _drop_old(service: Service, before: float) -> None:
    with service.database.reading() as session:
        jobs = list(session.exec(select(Job).where(col(Job.state).in_(FINISHED), col(Job.finished) < before)))
        things = list(session.exec(select(Thing).where(Thing.created < before)))
    for job in jobs:
        forget_job(service, job)
    for thing in things:
        try:
            delete_thing(service, thing.owner, thing.kind, thing.id)  # pyright: ignore[reportArgumentType]
        except Problem:
            continue  # a job still needs it: the next time


def _drop_checkpoints(service: Service) -> None:
    """Checkpoints of jobs that were cancelled: nobody goes on from there."""
    with service.database.reading() as session:
        kept = set(session.exec(select(StoredFile.of).where(col(StoredFile.of).startswith(CHECKPOINT))))
        wanted = set(session.exec(select(Job.id).where(col(Job.state).not_in(FINISHED))))
    for of in kept:
        if of.removeprefix(CHECKPOINT) not in wanted:
            with service.database.writing() as session:
                keys = drop_files(session, of)
            service.storage.let_go(keys)


def _drop_strays(service: Service, before: float) -> None:
    """Files in storage or scratch that nothing names; young ones may belong to an upload on its way."""
    with service.database.reading() as session:
        named = set(session.exec(select(StoredFile.key)))
    files = dict(service.storage.written())
    strays = [key for key, written in files.items() if written < before and key.removesuffix(".part") not in named]
    if _belongs(service, known=not files or not named.isdisjoint(files)):
        for key in strays:
            service.storage.drop(key)
    elif strays and service.storage.root not in _warned:
        _warned.add(service.storage.root)
        logger().warning(
            f"{len(strays)} files that no record names are kept, since they may be another database's; "
            f"drop them by hand, or, where they are this one's, remove {OWNER} beside them",
            storage=service.storage.root,
        )
    for path in service.settings.scratch.iterdir():
        if path.name != "jobs" and path.stat().st_mtime < before:
            shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)


def _belongs(service: Service, known: bool) -> bool:
    """Whether the storage is this database's: beside another one, every file there would be a stray.

    known: whether nothing lies there, or something that records here name; it is then this database's from now on.
    """
    mine, owner = service.database.digest, service.storage.owner()
    if owner is None and known:
        service.storage.belong_to(mine)
        return True
    return owner == mine
