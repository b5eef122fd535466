"""Who looks: the owner of an API key, whoever sits at this machine, or the holder of a link to one result."""

from __future__ import annotations

import hashlib
import hmac
import os
import secrets
import tempfile
from contextlib import suppress
from pathlib import Path

from fastapi import Request

from backend.service.keys import owner_of
from backend.service.problems import Problem
from backend.service.records import Job
from backend.service.service import LOCAL, Service

COOKIE = "linktwin_key"
REFUSED = "refused"  # in the address of the view that asks again for a key
KEY_BYTES = 32
SIGNED = 32  # characters of a link's signature: 128 bits


def owner_from(service: Service, request: Request) -> str:
    """The owner whose things are shown; Problem `no-key` where a key is needed and none was given."""
    if not service.settings.keys_required:
        return LOCAL
    text = request.cookies.get(COOKIE)
    if not text:
        if REFUSED in request.query_params:
            raise Problem("no-key", "This API key is unknown or was revoked; ask whoever runs the service for one.")
        raise Problem("no-key", "Sign in with your API key; whoever runs the service makes one with linktwin key new.")
    return owner_of(service.database, text)


def share_token(service: Service, job: str) -> str:
    """What a link needs to show this result to anyone who has the link."""
    return hmac.new(_secret(service), f"job {job}".encode(), hashlib.sha256).hexdigest()[:SIGNED]


def shared_job(service: Service, job: str, token: str) -> Job:
    """The job behind a shared link; Problem `not-found` where the link was not made here or the job is gone."""
    if hmac.compare_digest(share_token(service, job).encode(), token.encode()):
        with service.database.reading() as session:
            if (found := session.get(Job, job)) is not None:
                return found
    raise Problem(
        "not-found", "This link shows nothing: it was cut short, or the result was deleted. Ask for a new one."
    )


def _secret(service: Service) -> bytes:
    """Made once, kept beside the records, read by nobody else."""
    path = Path(service.settings.data_folder).resolve() / "share.key"
    if not path.exists():
        with tempfile.NamedTemporaryFile(dir=path.parent) as made:  # whole under its name, or not there at all
            made.write(secrets.token_bytes(KEY_BYTES))
            made.flush()
            os.fsync(made.fileno())
            with suppress(FileExistsError):  # another process was first
                os.link(made.name, path)
    if len(secret := path.read_bytes()) < KEY_BYTES:
        raise Problem(
            "internal",
            f"{path.name} in the data folder holds {len(secret)} of {KEY_BYTES} bytes; remove it, and share anew.",
        )
    return secret
