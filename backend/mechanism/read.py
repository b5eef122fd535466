"""Reading and writing drawings and studies."""

from __future__ import annotations

import json
import os
import re
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError

from backend.mechanism.drawing_error import DrawingError, first
from backend.mechanism.fit_report import FitReport
from backend.mechanism.likewise import likewise
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.part import Part
from backend.mechanism.sentences import sentences
from backend.mechanism.study import Experiment, ExperimentFile, Study, StudyFile, study_problems, twice_set
from backend.mechanism.text_file import NotText, read_text
from backend.mechanism.tracks import PLACES, SHOWN, TABLES, read_table
from backend.mechanism.units import far_tracks

VERSION = "1.0"
HALF_LETTER = re.compile(r"\\u[dD][89a-fA-F]")  # letters beyond 65535 come in two halves
LARGEST_BYTES = 64 * 2**20  # a thousand-cell scissor takes 3 MB

OTHER_FILES = {  # by a field that no other kind of file has: what it is, and what to do where another was asked for
    "experiments": ("a study", "give the mechanism.json that it names, or a command that takes studies"),
    "bodies": ("a drawing", "give a study.json that names it as its mechanism, or a command that takes drawings"),
}

Document = TypeVar("Document", bound=Part)


def read_mechanism(path: str | os.PathLike[str]) -> Mechanism:
    """The drawing in a mechanism.json; DrawingError lists all that is wrong with it."""
    return parse_mechanism(_load(Path(path)), source=str(path))


def parse_mechanism(document: Mapping[str, Any], source: str = "mechanism") -> Mechanism:
    """The drawing in an already decoded document; `source` names it in error sentences."""
    return parse(Mechanism, document, source)


def write_mechanism(mechanism: Mechanism, path: str | os.PathLike[str]) -> None:
    """Write a drawing with every digit; fields keep the order of the models."""
    _write(mechanism, Path(path))


def write_study(study: StudyFile, path: str | os.PathLike[str]) -> None:
    """Write a study file; its tables and its mechanism are files of their own."""
    _write(study, Path(path))


def read_study_file(path: str | os.PathLike[str]) -> StudyFile:
    """A study.json alone, without its mechanism and its tables; DrawingError lists all that is wrong with it."""
    return parse(StudyFile, _load(Path(path)), str(path))


def read_fit(path: str | os.PathLike[str]) -> FitReport:
    """What a fit found, from its fit.json; DrawingError lists all that is wrong with it."""
    return parse(FitReport, _load(Path(path)), str(path))


def read_study(path: str | os.PathLike[str], root: str | os.PathLike[str] | None = None) -> Study:
    """A study with its mechanism and all its tables.

    root: when given, no file outside this folder is opened. Raises DrawingError.
    """
    return parse_study(_load(Path(path)), Path(path).parent, source=str(path), root=root)


def is_study(path: str | os.PathLike[str]) -> bool:
    """Whether a file holds a study; DrawingError where it holds no JSON."""
    document = _load(Path(path))
    return isinstance(document, dict) and "experiments" in document


def parse_study(
    document: Mapping[str, Any],
    folder: str | os.PathLike[str],
    source: str = "study",
    root: str | os.PathLike[str] | None = None,
) -> Study:
    """A study from an already decoded document; its paths are relative to `folder`. Raises DrawingError."""
    file = parse(StudyFile, document, source)
    opener = _Folder(Path(folder), None if root is None else Path(root), source)
    mechanism = read_mechanism(opener.path(file.mechanism))
    problems = first(study_problems(file, mechanism))
    experiments: list[Experiment] = []
    faults: list[tuple[str, str]] = []
    for entry in file.experiments:
        try:
            experiments.append(_experiment(entry, mechanism, opener))
        except DrawingError as error:
            origin = f"{error.source}: " if error.source and error.source != source else ""
            faults += [(entry.id, f"{origin}{problem}") for problem in error.problems]
    problems += [f'experiment "{id}": {fault}' for id, fault in likewise(faults)]
    if problems:
        raise DrawingError(problems, source)
    return Study(mechanism, tuple(experiments), file.tolerances, Path(source) if Path(source).is_file() else None)


def parse(model: type[Document], document: Any, source: str) -> Document:
    """Check a decoded document against a model of the contract; DrawingError lists all its problems."""
    if not isinstance(document, Mapping):
        raise DrawingError(f"holds {type(document).__name__}, not an object in braces", source)
    _check_version(document.get("schema_version"), source)
    told = {key for key in OTHER_FILES if isinstance(document.get(key), list)}
    if told and not told & set(model.model_fields):
        key = min(told)
        what, remedy = OTHER_FILES[key]
        raise DrawingError(f"holds {what} with {len(document[key])} {key}; {remedy}", source)
    try:
        return model.model_validate({**document, "schema_version": VERSION})
    except ValidationError as error:
        problems = sentences(error, document)
    except RecursionError:
        problems = ["is nested too deeply; a drawing needs fewer than ten levels"]
    if document["schema_version"] != VERSION:
        problems.append(
            f"the file says version {document['schema_version']}, this reader knows {VERSION}: "
            "update linktwin, or export for the older version"
        )
    raise DrawingError(problems, source)


def _check_version(version: Any, source: str) -> None:
    if version is None:
        raise DrawingError(f'schema_version is missing; add "schema_version": "{VERSION}"', source)
    major, dot, minor = version.partition(".") if isinstance(version, str) else ("", "", "")
    if not (dot and major.isdecimal() and minor.isdecimal()):
        raise DrawingError(f'schema_version is {version!r}; write text such as "{VERSION}"', source)
    if int(major) != int(VERSION.partition(".")[0]):
        raise DrawingError(
            f"schema_version {version} is not supported; this reader knows {VERSION}: "
            "export again, or use the linktwin that wrote it",
            source,
        )


def _experiment(entry: ExperimentFile, mechanism: Mechanism, opener: _Folder) -> Experiment:
    tables: dict[str, Any] = {}
    problems: list[str] = []
    for name in TABLES:
        if (uri := getattr(entry, name)) is not None:
            try:
                tables[name] = read_table(name, opener.path(uri), mechanism)
            except DrawingError as error:
                problems += [f"{uri}: {problem}" for problem in error.problems]
    if "inputs" in tables:
        problems += twice_set(entry, tables["inputs"])
    tracks = tables.get("tracks")
    if entry.camera is None and tracks is not None and "x_px" in tracks and tracks[list(PLACES)].isna().all(axis=None):
        problems.append(
            f"{entry.tracks}: holds no place in metres; name the camera.json of its clip as the experiment's camera, "
            "or track the clip again with the bed file"
        )
    if tracks is not None:
        problems += [f"{entry.tracks}: {problem}" for problem in far_tracks(tracks, mechanism)]
    last = max((float(table["time_s"].max()) for table in tables.values()), default=None)
    if last is not None and entry.release.time_s >= last:
        problems.append(
            f"release.time_s is {entry.release.time_s:g} s, but its last sample is at {last:g} s: "
            "nothing is left to compare; check the clock of the tables"
        )
    camera = None if entry.camera is None else opener.path(entry.camera)
    if camera is not None and not camera.is_file():
        problems.append(f"{entry.camera}: is no file; name the camera.json that linktwin track wrote beside the tracks")
    if problems:
        raise DrawingError(problems)
    video = None if entry.video is None else opener.path(entry.video)
    return Experiment(
        entry.id, entry.use, entry.release, video=video, camera=camera, overrides=entry.overrides, **tables
    )  # fmt: skip


class _Folder:
    """Opens the paths that a study names, and holds them inside `root` when there is one."""

    def __init__(self, folder: Path, root: Path | None, source: str):
        self.folder, self.root, self.source = folder, root and root.resolve(), source

    def path(self, uri: str) -> Path:
        try:
            path = self.folder / uri
            inside = self.root is None or path.resolve().is_relative_to(self.root)
        except (ValueError, OSError, RuntimeError) as error:
            raise DrawingError(f"{uri!r} is not a path ({error})", self.source) from None
        if not inside:
            raise DrawingError(f'path "{uri}" leaves the folder of the study; put the file beside it', self.source)
        return path


def _write(document: Part, path: Path) -> None:
    data = document.model_dump(mode="json", exclude_none=True)
    path.write_text(json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8")


def _load(path: Path) -> Any:
    """Decode a JSON file, refusing what JSON forbids but decoders let pass: NaN and repeated keys."""
    source = str(path)
    try:
        if (size := path.stat().st_size) > LARGEST_BYTES:
            raise DrawingError(
                f"is {size / 2**20:.0f} MB, above the limit of {LARGEST_BYTES // 2**20} MB; "
                "keep meshes in their own files",
                source,
            )
        text = read_text(path)
    except NotText as error:
        raise DrawingError(str(error), source) from None
    except (OSError, ValueError) as error:
        if isinstance(error, DrawingError):
            raise
        reason = getattr(error, "strerror", error)
        raise DrawingError(f"cannot be read ({reason}); check the path and the file", source) from None
    return decode(text, source)


def decode(text: str, source: str) -> Any:
    """Decode JSON text; DrawingError on what is not JSON, on NaN or Infinity, and on repeated keys."""

    def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        found = dict(pairs)
        if len(found) < len(pairs):
            twice = sorted(key for key, count in Counter(key for key, _ in pairs).items() if count > 1)
            more = f" and {len(twice) - SHOWN} more" if len(twice) > SHOWN else ""
            names = ", ".join(map(repr, twice[:SHOWN]))
            raise DrawingError(f"key {names}{more} stands twice in one object; keep one", source)
        return found

    def finite(literal: str) -> Any:
        raise DrawingError(f"holds the number {literal}; every number must be finite", source)

    try:
        document = json.loads(text, object_pairs_hook=once, parse_constant=finite)
        if HALF_LETTER.search(text):
            json.dumps(document, ensure_ascii=False).encode()
        return document
    except json.JSONDecodeError as error:
        raise DrawingError(
            f"is not JSON: {error.msg} at line {error.lineno}, column {error.colno}; correct it there", source
        ) from None
    except UnicodeEncodeError as error:
        half = error.object[error.start]
        raise DrawingError(
            f"holds {half!r}, half of a letter, which no text can; write the name anew", source
        ) from None
    except RecursionError:
        raise DrawingError("is nested too deeply; a drawing needs fewer than ten levels", source) from None
    except DrawingError:
        raise
    except ValueError as error:  # an integer of thousands of digits
        raise DrawingError(
            f"holds a number that cannot be read ({error}); write it with fewer digits", source
        ) from None
