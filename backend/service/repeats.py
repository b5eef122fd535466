"""Idempotency-Keys: the same key with the same request gives what was made the first time, for a day."""

from __future__ import annotations

import hashlib
import json
from typing import Any

from sqlmodel import Session, select

from backend.service.problems import Problem
from backend.service.records import Repeat


def made_before(session: Session, owner: str, key: str | None, request: Any) -> str | None:
    """Id of what the same request made under this key; None where it is the first, or has no key.

    request: plain JSON values.  The owner's account must be locked.  Raises Problem `key-reused`: another request.
    """
    if key is None or (known := session.get(Repeat, (owner, key))) is None:
        return None
    if known.fingerprint != _fingerprint(request):
        raise Problem("key-reused", "This Idempotency-Key stood for another request; take a new key for a new request.")
    return known.made


def remember(session: Session, owner: str, key: str | None, request: Any, made: str) -> None:
    """Keep what a request made under this key."""
    if key is not None:
        session.add(Repeat(owner=owner, key=key, fingerprint=_fingerprint(request), made=made))


def stands(session: Session, owner: str, key: str | None) -> bool:
    """Whether this key stands for something already."""
    return key is not None and session.get(Repeat, (owner, key)) is not None


def forget(session: Session, made: str) -> None:
    """Drop the keys of what is gone."""
    for repeat in session.exec(select(Repeat).where(Repeat.made == made)):
        session.delete(repeat)


def _fingerprint(request: Any) -> str:
    return hashlib.sha256(json.dumps(request, sort_keys=True).encode()).hexdigest()
