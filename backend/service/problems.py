"""Every failure is a problem document (RFC 9457): what kind, what happened, what to do."""

from __future__ import annotations

import errno
from collections.abc import Mapping, Sequence
from http import HTTPStatus
from typing import Any

MEDIA_TYPE = "application/problem+json"
ADDRESS = "https://linktwin.invalid/problems/"  # a name, not a page

# kind -> (status, title)
KINDS: dict[str, tuple[int, str]] = {
    "malformed": (400, "The request cannot be read"),
    "no-key": (401, "An API key is needed"),
    "foreign-origin": (403, "Another site may not ask this"),
    "not-found": (404, "There is no such thing"),
    "wrong-method": (405, "This address does not take that method"),
    "too-slow": (408, "The upload was too slow"),
    "not-finished": (409, "The job has not finished"),
    "in-use": (409, "It is still needed"),
    "no-result": (409, "The job wrote no result"),
    "length-required": (411, "The length of the upload is needed"),
    "too-large": (413, "That is too large"),
    "wrong-type": (415, "That is not a kind of file taken here"),
    "no-such-part": (416, "The file has no such part"),
    "misdirected": (421, "The service is not known by that name"),
    "invalid": (422, "The input has faults"),
    "key-reused": (422, "The Idempotency-Key stood for another request"),
    "too-often": (429, "Too many requests"),
    "too-many-jobs": (429, "Too many jobs at once"),
    "storage-full": (507, "The storage is full"),
    "internal": (500, "The service failed"),
    "unavailable": (503, "The service cannot work at the moment"),
}


class Problem(Exception):
    """A request that cannot be granted.

    kind: a key of KINDS.  detail: a sentence with the number and the remedy.  faults: one sentence each, where the
    input has several.  headers: what the answer carries besides.
    """

    def __init__(self, kind: str, detail: str, faults: Sequence[str] = (), headers: Mapping[str, str] | None = None):
        super().__init__(detail)
        self.kind, self.detail, self.faults, self.headers = kind, detail, tuple(faults), dict(headers or {})

    @property
    def status(self) -> int:
        """HTTP status."""
        return KINDS[self.kind][0]

    def document(self, instance: str | None = None) -> dict[str, Any]:
        """The problem as RFC 9457 writes it."""
        status, title = KINDS[self.kind]
        told = {"type": ADDRESS + self.kind, "title": title, "status": status, "detail": self.detail}
        if instance is not None:
            told["instance"] = instance
        return {**told, "errors": list(self.faults)} if self.faults else told


def not_found(what: str, id: str) -> Problem:
    """Nothing of that id is the asker's; whether it is somebody else's is not said."""
    return Problem("not-found", f"There is no {what} {id[:80]!r} of yours; list them to see what there is.")


def disk_full(error: OSError) -> Problem | None:
    """What to answer where no room is left on the service's disk; None for any other error of the system."""
    if error.errno not in (errno.ENOSPC, errno.EDQUOT):
        return None
    return Problem("storage-full", "The service's disk is full; ask whoever runs it to make room, then try again.")


def phrase(status: int) -> str:
    """HTTP's own words for a status."""
    try:
        return HTTPStatus(status).phrase
    except ValueError:
        return "Error"
