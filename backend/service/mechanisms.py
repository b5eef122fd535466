"""Mechanisms that people store: mechanism.json with its meshes."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from backend.mechanism.drawing_error import DrawingError
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.read import decode, parse_mechanism
from backend.service.intake.folder import safe_path, take_folder
from backend.service.problems import Problem
from backend.service.records import Thing
from backend.service.service import Service
from backend.service.things import delete_thing, file_of, find_thing, keep_thing

DRAWING = "mechanism.json"
MOST_TOLD = 100  # of the names that a summary tells
PARTS = ("bodies", "joints", "effects", "markers")


def store_mechanism(
    service: Service, owner: str, files: Mapping[str, Path], name: str | None = None, repeat_key: str | None = None
) -> Thing:
    """Check and keep a mechanism.

    files: path in the folder -> file on this machine; one is mechanism.json, the others its meshes.
    Raises Problem: every fault of the drawing stands in its `faults`.
    """
    taken = take_folder(files, service.settings)
    if DRAWING not in taken:
        raise Problem("invalid", f"There is no {DRAWING} among the files; send it beside its meshes.")
    drawn = read_drawing(service, taken[DRAWING])
    return keep_thing(service, owner, "mechanism", name or drawn.name, taken, summary_of(drawn, taken), repeat_key)


def store_mechanism_document(
    service: Service, owner: str, text: bytes, name: str | None = None, repeat_key: str | None = None
) -> Thing:
    """Check and keep a mechanism.json alone, without meshes."""
    with tempfile.TemporaryDirectory(dir=service.settings.scratch) as folder:
        path = Path(folder) / DRAWING
        path.write_bytes(text)
        return store_mechanism(service, owner, {DRAWING: path}, name, repeat_key)


def read_drawing(service: Service, path: Path) -> Mechanism:
    """The drawing in a file; Problem with all its faults."""
    return parse_drawing(service, path.read_bytes())


def parse_drawing(service: Service, text: bytes) -> Mechanism:
    """The drawing in the bytes of a mechanism.json; Problem with all its faults."""
    if len(text) > service.settings.largest_document:
        raise Problem(
            "too-large", f"{DRAWING} has {len(text)} bytes, above the limit of {service.settings.largest_document}."
        )
    try:
        document = decode(text.decode("utf-8-sig"), DRAWING)
        refuse_too_many_parts(service, document)
        drawn = parse_mechanism(document, DRAWING)
    except UnicodeDecodeError:
        raise Problem("invalid", f"{DRAWING} is not UTF-8 text; save it as UTF-8.") from None
    except DrawingError as error:
        raise faulty(error) from None
    if not (drawn.name.strip() and drawn.name.isprintable()):
        raise Problem("invalid", f"The drawing's name {drawn.name[:60]!r} cannot be printed; write it plainly.")
    for body in drawn.bodies:
        for mesh in body.meshes:
            safe_path(mesh.uri)
    return drawn


def refuse_too_many_parts(service: Service, document: Any) -> None:
    """Problem `too-large` before models of a million parts are made."""
    if not isinstance(document, Mapping):
        return
    counts = {part: len(document[part]) for part in PARTS if isinstance(document.get(part), list)}
    if sum(counts.values()) > service.settings.most_parts:
        told = ", ".join(f"{count} {part}" for part, count in counts.items())
        raise Problem(
            "too-large",
            f"The drawing has {told}, above the limit of {service.settings.most_parts} parts; leave some out.",
        )


def faulty(error: DrawingError) -> Problem:
    """A drawing's faults as a problem."""
    source = f"{error.source} " if error.source else "The input "
    count = len(error.problems)
    said = f"{source}has {count} {'fault' if count == 1 else 'faults'}; each is listed with its remedy."
    return Problem("invalid", said, error.problems[:100])


def summary_of(drawn: Mechanism, files: Mapping[str, Any]) -> dict[str, Any]:
    """What a list shows of a drawing."""
    uris = {mesh.uri for body in drawn.bodies for mesh in body.meshes}
    return {
        "name": drawn.name,
        "bodies": len(drawn.bodies),
        "joints": len(drawn.joints),
        "markers": [marker.id for marker in drawn.markers][:MOST_TOLD],
        "effects": len(drawn.effects),
        "missing_meshes": sorted(uris - set(files))[:MOST_TOLD],
    }


def load_mechanism(service: Service, owner: str, id: str) -> Mechanism:
    """The drawing of a stored mechanism."""
    thing = find_thing(service, owner, "mechanism", id)
    return parse_drawing(service, service.storage.read(file_of(service, thing.id, DRAWING).key))


def delete_mechanism(service: Service, owner: str, id: str) -> None:
    """Drop a mechanism and its files."""
    delete_thing(service, owner, "mechanism", id)
