"""What people store (mechanisms, studies, videos): kept with their files, listed, read and dropped; owners apart."""

from __future__ import annotations

import mimetypes
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from sqlmodel import Session, col, func, select

from backend.service.problems import Problem, not_found
from backend.service.records import Account, Job, StoredFile, Thing
from backend.service.repeats import forget, made_before, remember, stands
from backend.service.service import Service
from backend.service.states import FINISHED, Kind
from backend.service.storage import Kept

Row = TypeVar("Row", Thing, Job)
MOST_LISTED = 200
CHECKPOINT = "checkpoint:"  # before a job's id: whose files these are


@dataclass(frozen=True)
class Page:
    """A slice of a list, newest first, and how many there are in all."""

    rows: list[Any]
    total: int


def keep_thing(
    service: Service,
    owner: str,
    kind: Kind,
    name: str,
    files: Mapping[str, Path],
    summary: dict[str, Any],
    repeat_key: str | None = None,
) -> Thing:
    """Store files (relative path -> file on this machine) as one thing.

    repeat_key: the same key with the same files, kind and name gives the thing made the first time.  Raises Problem:
    `storage-full` beyond the quota, `key-reused` where the key stood for another request.
    """
    size = sum(path.stat().st_size for path in files.values())
    with service.database.reading() as session:
        again = stands(session, owner, repeat_key)
    if not again:  # what is there already takes no more room
        weigh(service, owner, size)
    kept: dict[str, Kept] = {}
    committing = False
    try:
        for path, file in files.items():
            kept[path] = service.storage.put(file)
        told = [kind, name, sorted((path, file.sha256) for path, file in kept.items())]
        with service.database.writing() as session:
            locked_account(session, owner)
            if (made := made_before(session, owner, repeat_key, told)) is not None:
                return session.get_one(Thing, made)
            charge(service, session, owner, size)
            thing = Thing(owner=owner, kind=kind, name=name[:200], bytes=size, summary=summary)
            session.add(thing)
            session.add_all(stored(thing.id, path, file) for path, file in kept.items())
            remember(session, owner, repeat_key, told, thing.id)
            session.flush()
            # Whether a commit whose answer is lost was done nobody knows: files that no record names are tidied up.
            committing = True
        return thing
    finally:
        if not committing:
            service.storage.let_go(file.key for file in kept.values())


def stored(of: str, path: str, kept: Kept) -> StoredFile:
    """The record of a file in storage."""
    return StoredFile(
        key=kept.key, of=of, path=path, bytes=kept.bytes, sha256=kept.sha256, media_type=media_type(path)
    )  # fmt: skip


def find_thing(service: Service, owner: str, kind: Kind, id: str) -> Thing:
    """One thing of this owner; Problem `not-found` otherwise."""
    with service.database.reading() as session:
        thing = session.get(Thing, id)
    if thing is None or thing.owner != owner or thing.kind != kind:
        raise not_found(kind, id)
    return thing


def list_things(service: Service, owner: str, kind: Kind, limit: int = 50, offset: int = 0) -> Page:
    """This owner's things of a kind, newest first."""
    with service.database.reading() as session:
        return page(session, Thing, (Thing.owner == owner, Thing.kind == kind), limit, offset)


def page(session: Session, table: type[Row], where: tuple[Any, ...], limit: int, offset: int) -> Page:
    """Rows that meet the conditions, newest first."""
    total = session.exec(select(func.count()).select_from(table).where(*where)).one()
    order = (col(table.created).desc(), col(table.id))
    rows = session.exec(select(table).where(*where).order_by(*order).limit(min(limit, MOST_LISTED)).offset(offset))
    return Page(list(rows), int(total))


def files_of(service: Service, of: str) -> list[StoredFile]:
    """The files of a thing or a job, by path.  Whose they are must have been asked before."""
    with service.database.reading() as session:
        return list(session.exec(select(StoredFile).where(StoredFile.of == of).order_by(StoredFile.path)))


def file_of(service: Service, of: str, path: str) -> StoredFile:
    """One file of a thing or a job; Problem `not-found` naming those there are."""
    with service.database.reading() as session:
        found = session.exec(select(StoredFile).where(StoredFile.of == of, StoredFile.path == path)).first()
    if found is None:
        there = ", ".join(file.path for file in files_of(service, of)[:20]) or "none"
        raise Problem("not-found", f"There is no file {path[:200]!r}; there are: {there}.")
    return found


def delete_thing(service: Service, owner: str, kind: Kind, id: str) -> None:
    """Drop a thing and its files; Problem `in-use` while an unfinished job needs it."""
    with service.database.writing() as session:
        locked_account(session, owner)  # who starts a job or deletes holds it too: one after the other
        thing = session.get(Thing, id)
        if thing is None or thing.owner != owner or thing.kind != kind:
            raise not_found(kind, id)
        waiting = session.exec(select(Job).where(Job.owner == owner, col(Job.state).not_in(FINISHED)))
        if needing := next((job for job in waiting if thing.id in job.request.values()), None):
            raise Problem("in-use", f"Job {needing.id} still needs this {kind}; wait for it, or cancel it first.")
        keys = drop_files(session, thing.id)
        forget(session, thing.id)
        session.delete(thing)
        refund(session, owner, thing.bytes)
    service.storage.let_go(keys)


def drop_files(session: Session, of: str) -> list[str]:
    """Forget the files of a thing or a job; the keys to drop from storage once that is committed."""
    files = list(session.exec(select(StoredFile).where(StoredFile.of == of)))
    for file in files:
        session.delete(file)
    return [file.key for file in files]


def weigh(service: Service, owner: str, size: int) -> None:
    """Problem `storage-full` where so many bytes more are beyond the quota."""
    with service.database.reading() as session:
        account = session.get(Account, owner)
    _refuse_beyond(service, account.stored_bytes if account else 0, size)


def charge(service: Service, session: Session, owner: str, size: int) -> None:
    """Count bytes to an owner, one writer at a time."""
    account = locked_account(session, owner)
    _refuse_beyond(service, account.stored_bytes, size)
    account.stored_bytes += size
    session.add(account)


def refund(session: Session, owner: str, size: int) -> None:
    """Count bytes off."""
    account = locked_account(session, owner)
    account.stored_bytes = max(0, account.stored_bytes - size)
    session.add(account)


def locked_account(session: Session, owner: str) -> Account:
    """The owner's account, held until the session ends."""
    if session.get_bind().dialect.name == "postgresql":
        from sqlalchemy.dialects.postgresql import insert

        session.execute(insert(Account).values(owner=owner, stored_bytes=0).on_conflict_do_nothing())
    account = session.exec(select(Account).where(Account.owner == owner).with_for_update()).first()
    if account is None:
        account = Account(owner=owner)
        session.add(account)
    return account


def media_type(path: str) -> str:
    """By suffix; what browsers could run is told as data."""
    special = {".h5": "application/x-hdf5", ".stl": "model/stl", ".ply": "model/ply", ".obj": "model/obj"}
    suffix = "." + path.rpartition(".")[2].lower()
    return special.get(suffix) or mimetypes.guess_type(path)[0] or "application/octet-stream"


def _refuse_beyond(service: Service, stored_bytes: int, size: int) -> None:
    granted = service.settings.stored_bytes_per_owner
    if stored_bytes + size > granted:
        raise Problem(
            "storage-full",
            f"{stored_bytes} bytes are stored and {size} more would exceed the {granted} granted; "
            "delete what is no longer needed.",
        )
