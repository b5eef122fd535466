"""Addresses of stored files as a study may name them: mechanisms/ID, videos/ID, jobs/ID/files/PATH."""

from __future__ import annotations

from dataclasses import dataclass

from backend.service.problems import Problem, not_found
from backend.service.records import Job
from backend.service.service import Service
from backend.service.states import Kind
from backend.service.things import file_of, files_of, find_thing

KINDS: dict[str, Kind] = {"mechanisms": "mechanism", "studies": "study", "videos": "video"}


@dataclass(frozen=True)
class Reference:
    """A stored file: its key in storage and its path among the files it was stored with."""

    key: str
    path: str


def follow(service: Service, owner: str, address: str, wanted: str | None) -> list[Reference]:
    """The files behind an address: one, or all of a thing when `wanted` stands among them.

    Raises Problem: an address of another form, or of nothing that is the owner's.
    """
    room, _, rest = address.removeprefix("/api/v1/").partition("/")
    id, _, tail = rest.partition("/")
    if room not in (*KINDS, "jobs") or not id or (tail and not tail.startswith("files/")):
        raise Problem(
            "invalid",
            f"{address[:200]!r} is no address here; write mechanisms/ID, videos/ID or jobs/ID/files/tracks.csv.",
        )
    if room == "jobs":
        with service.database.reading() as session:
            job = session.get(Job, id)
        if job is None or job.owner != owner:
            raise not_found("job", id)
    else:
        find_thing(service, owner, KINDS[room], id)
    if tail:
        file = file_of(service, id, tail.removeprefix("files/"))
        return [Reference(file.key, file.path if wanted is None else wanted)]
    files = files_of(service, id)
    if wanted is not None and wanted not in {file.path for file in files}:
        raise Problem("invalid", f"{address[:200]} holds no {wanted}; refer to one that does.")
    if wanted is None and len(files) != 1:
        raise Problem("invalid", f"{address[:200]} holds {len(files)} files; add /files/ and the name of one.")
    return [Reference(file.key, file.path) for file in files]
