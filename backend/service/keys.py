"""API keys: shown once, kept as a digest, each opening the things of one owner."""

from __future__ import annotations

import hashlib
import re
import secrets
import time

from sqlmodel import col, func, select

from backend.service.database import Database
from backend.service.problems import Problem
from backend.service.records import ApiKey

PREFIX = "lt_"
OWNER = re.compile(r"[\w.@+-]{1,64}")


def make_key(database: Database, owner: str) -> tuple[ApiKey, str]:
    """A new key of this owner, and its text: it is not kept and cannot be shown again.

    Raises ValueError where the owner's name is no plain word.
    """
    if not OWNER.fullmatch(owner):
        raise ValueError(f"{owner!r} is no name of an owner; write up to 64 letters, digits or . _ @ + -")
    # 256 random bits: a plain digest is enough, nothing can be guessed faster than the key itself.
    text = PREFIX + secrets.token_urlsafe(32)
    key = ApiKey(owner=owner, digest=_digest(text))
    with database.writing() as session:
        session.add(key)
    return key, text


def owner_of(database: Database, text: str) -> str:
    """Whose key it is; Problem `no-key` where it is unknown or revoked."""
    with database.reading() as session:
        key = session.exec(select(ApiKey).where(ApiKey.digest == _digest(text))).first()
    if key is None or key.revoked is not None:
        raise Problem(
            "no-key",
            "The API key is unknown or was revoked; ask whoever runs the service for a new one.",
            headers={"WWW-Authenticate": "Bearer"},
        )
    return key.owner


def list_keys(database: Database) -> list[ApiKey]:
    """Every key, oldest first."""
    with database.reading() as session:
        return list(session.exec(select(ApiKey).order_by(col(ApiKey.created))))


def revoke_key(database: Database, id: str) -> ApiKey:
    """Let a key open nothing any more; ValueError where there is none of that id."""
    with database.writing() as session:
        key = session.get(ApiKey, id)
        if key is None:
            raise ValueError(f"there is no key {id!r}; list them with linktwin key list")
        key.revoked = key.revoked or time.time()
        session.add(key)
    return key


def any_key(database: Database) -> bool:
    """Whether a key exists that still opens something."""
    with database.reading() as session:
        return session.exec(select(func.count()).select_from(ApiKey).where(col(ApiKey.revoked).is_(None))).one() > 0


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
