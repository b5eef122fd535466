"""A drawing or a study with all that it names, as the zip that the service takes."""

from __future__ import annotations

import json
import re
import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from backend.mechanism.drawing_error import DrawingError
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.read import decode, read_mechanism, read_study_file
from backend.mechanism.study import NAMED, StudyFile

DRAWING, STUDY = "mechanism.json", "study.json"
PLAIN = re.compile(r"\w[\w.-]*(/\w[\w.-]*)*")  # a path inside its folder, whoever reads it
IN_MEMORY = 16 * 2**20


def drawing_files(path: Path) -> dict[str, Path]:
    """mechanism.json and those of its meshes that are there, by their path in the folder.  Raises DrawingError."""
    return {DRAWING: path, **_meshes(read_mechanism(path), path.parent, "")}


def study_files(study: Path | StudyFile, folder: Path) -> dict[str, Path | bytes]:
    """study.json and all that it names, by path; what lies outside its folder is moved in, and named so.

    folder: what its paths are relative to.  Raises DrawingError.
    """
    file, source = (study, STUDY) if isinstance(study, StudyFile) else (read_study_file(study), str(study))
    told = file.model_dump(mode="json", exclude_none=True)
    taken: dict[str, Path | bytes] = {STUDY: b""}

    def take(uri: str, otherwise: str) -> str:
        place = folder / uri
        if not place.is_file():
            raise DrawingError(f'names "{uri}", which is no file; put it there, or correct the name', source)
        plain = PLAIN.fullmatch(uri) is not None and uri.casefold() not in (STUDY, DRAWING)
        name = uri if plain and taken.get(uri, place) == place else otherwise
        taken[name] = place
        return name

    drawing = folder / file.mechanism
    told["mechanism"] = take(file.mechanism, DRAWING)
    taken.update(_meshes(read_mechanism(drawing), drawing.parent, told["mechanism"].rpartition("/")[0]))
    for number, experiment in enumerate(told["experiments"], start=1):
        for field in NAMED:
            if (uri := experiment.get(field)) is not None:
                experiment[field] = take(uri, f"experiment_{number}_{field}{Path(uri).suffix}")
    return {**taken, STUDY: json.dumps(told, indent=1, ensure_ascii=False).encode()}


def told(given: Any) -> Any:
    """What a JSON file holds, where one is named; else what was given.  Raises DrawingError for one that is no JSON."""
    if not isinstance(given, str | Path):
        return given
    try:
        return decode(Path(given).read_text(encoding="utf-8-sig"), str(given))
    except UnicodeDecodeError:
        raise DrawingError("is not UTF-8 text; save it as UTF-8", str(given)) from None


def bed_told(given: Any) -> Any:
    """The same of a bed; the camera that it names is put in its place, found from the folder of the bed's file."""
    bed = told(given)
    if isinstance(bed, Mapping) and isinstance(bed.get("camera"), str):
        folder = Path(given).parent if isinstance(given, str | Path) else Path()
        return {**bed, "camera": told(folder / bed["camera"])}
    return bed


@contextmanager
def packed(files: Mapping[str, Path | bytes]) -> Iterator[IO[bytes]]:
    """A zip of the files, ready to be read; a large one lies on disk."""
    with tempfile.SpooledTemporaryFile(IN_MEMORY) as stream:
        with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED, strict_timestamps=False) as archive:
            for path, file in files.items():
                if isinstance(file, bytes):
                    archive.writestr(path, file)
                else:
                    archive.write(file, path)
        stream.seek(0)
        yield stream


def _meshes(drawn: Mechanism, folder: Path, inside: str) -> dict[str, Path]:
    """Those that are there; which are missing, the service says."""
    uris = {mesh.uri for body in drawn.bodies for mesh in body.meshes}
    below = f"{inside}/" if inside else ""
    return {below + uri: folder / uri for uri in sorted(uris) if PLAIN.fullmatch(uri) and (folder / uri).is_file()}
