"""What routes ask of a request: the service, the owner, a slice of a list; and how they document what may go wrong."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from fastapi import Depends, Header, Query, Request
from fastapi.security import HTTPAuthorizationCredentials, HTTPBearer

from backend.service.answers import ProblemAnswer
from backend.service.gate import OPENED
from backend.service.keys import owner_of
from backend.service.problems import KINDS, MEDIA_TYPE, Problem
from backend.service.service import LOCAL, Service

bearer = HTTPBearer(auto_error=False, scheme_name="key", description="An API key, as `Authorization: Bearer lt_...`.")
ALWAYS = ("malformed", "no-key", "foreign-origin", "misdirected", "invalid", "too-often", "internal", "unavailable")


def the_service(request: Request) -> Service:
    """The service that answers."""
    return request.app.state.service


TheKey = Annotated[HTTPAuthorizationCredentials | None, Depends(bearer)]


def the_owner(request: Request, shown: TheKey) -> str:
    """Whose things are asked for: the key's owner, or the one of this machine where no key is needed."""
    service = the_service(request)
    if shown is not None:
        owner = owner_of(service.database, shown.credentials)
        request.scope[OPENED] = True
        return owner
    if service.settings.keys_required or "authorization" in request.headers:
        raise Problem(
            "no-key",
            "Send `Authorization: Bearer lt_...` with an API key; whoever runs the service makes one with "
            "`linktwin key new OWNER`.",
            headers={"WWW-Authenticate": "Bearer"},
        )
    return LOCAL


@dataclass(frozen=True)
class Slice:
    """Which part of a list."""

    limit: int
    offset: int


def the_slice(
    limit: Annotated[int, Query(ge=1, le=200, description="How many.")] = 50,
    offset: Annotated[int, Query(ge=0, le=10**9, description="How many to pass over.")] = 0,
) -> Slice:
    """Fifty from the first on, where nothing is said."""
    return Slice(limit, offset)


TheService = Annotated[Service, Depends(the_service)]
TheOwner = Annotated[str, Depends(the_owner)]
TheSlice = Annotated[Slice, Depends(the_slice)]
RepeatKey = Annotated[
    str | None,
    Header(
        alias="Idempotency-Key", min_length=1, max_length=255, pattern=r"^[!-~]+$",
        description="The same key with the same request gives what was made the first time, for a day.",
    ),
]  # fmt: skip


def made(status: int, words: str) -> dict[int | str, dict[str, Any]]:
    """What a route that makes something answers with: where it is."""
    place = {"description": "Where it is: a path on this service.", "schema": {"type": "string"}}
    return {status: {"description": words, "headers": {"Location": place}}}


def may_fail(*kinds: str) -> dict[int | str, dict[str, Any]]:
    """The problem documents that a route may answer with, besides those that every route may."""
    told: dict[int | str, dict[str, Any]] = {}
    for kind in (*ALWAYS, *kinds):
        status, title = KINDS[kind]
        known = told.setdefault(status, {"model": ProblemAnswer, "description": title, "content": {MEDIA_TYPE: {}}})
        if title not in known["description"]:
            known["description"] += f"; {title[0].lower()}{title[1:]}"
    return told
