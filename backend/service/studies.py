"""Studies that people store: study.json, its mechanism and its tables, in one folder of their own."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping
from pathlib import Path
from threading import BoundedSemaphore
from typing import Any

from backend.mechanism.drawing_error import DrawingError
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.read import decode, parse, read_study
from backend.mechanism.study import NAMED, Study, StudyFile
from backend.service.intake.folder import lay_out, safe_path, take_folder
from backend.service.mechanisms import DRAWING, faulty, read_drawing, summary_of
from backend.service.problems import Problem
from backend.service.records import Thing
from backend.service.references import Reference, follow
from backend.service.service import Service
from backend.service.things import keep_thing

STUDY = "study.json"
# Tables are read into memory: one study at a time, so that many uploads at once cannot fill it.
_reading = BoundedSemaphore(1)


def store_study(
    service: Service, owner: str, files: Mapping[str, Path], name: str | None = None, repeat_key: str | None = None
) -> Thing:
    """Check and keep a study.

    files: path in the folder -> file on this machine; study.json and all that it names.  Raises Problem.
    """
    taken = take_folder(files, service.settings)
    if STUDY not in taken:
        deeper = [path for path in taken if path.endswith(f"/{STUDY}")]
        where = f", only {deeper[0]}" if deeper else ""
        raise Problem(
            "invalid", f"There is no {STUDY} at the top of what was sent{where}; send it beside what it names."
        )
    with tempfile.TemporaryDirectory(dir=service.settings.scratch) as scratch:
        folder = lay_out(taken, Path(scratch))
        file, study = _read(service, taken, folder)
    summary = {
        **summary_of(study.mechanism, taken),
        "mechanism": file.mechanism,
        "experiments": [{"id": one.id, "use": one.use} for one in study.experiments][:200],
    }
    return keep_thing(service, owner, "study", name or study.mechanism.name, taken, summary, repeat_key)


def compose_study(
    service: Service, owner: str, document: Mapping[str, Any], name: str | None = None, repeat_key: str | None = None
) -> Thing:
    """Check and keep a study whose files are stored already.

    document: study.json, in which `mechanism` is mechanisms/ID, a video videos/ID, and a table jobs/ID/files/PATH, or
    any file as mechanisms|studies|videos|jobs/ID/files/PATH.  Raises Problem.
    """
    try:
        file = parse(StudyFile, document, STUDY)
    except DrawingError as error:
        raise faulty(error) from None
    told = file.model_dump(mode="json", exclude_none=True)
    with tempfile.TemporaryDirectory(dir=service.settings.scratch) as scratch:
        files = _gather(service, owner, told, Path(scratch))
        path = Path(scratch) / "composed.json"
        path.write_text(json.dumps(told, indent=1, ensure_ascii=False), encoding="utf-8")
        return store_study(service, owner, {**files, STUDY: path}, name, repeat_key)


def _gather(service: Service, owner: str, told: dict[str, Any], scratch: Path) -> dict[str, Path]:
    """Bring what the study refers to, and rewrite its references to paths in its own folder."""
    files: dict[str, Path] = {}

    def take(reference: Reference, path: str) -> str:
        place = scratch / f"{len(files)}"
        service.storage.bring(reference.key, place)
        files[path] = place
        return path

    for reference in follow(service, owner, told["mechanism"], DRAWING):
        take(reference, reference.path)
    told["mechanism"] = DRAWING
    for number, experiment in enumerate(told["experiments"], start=1):
        for field in NAMED:
            if field in experiment:
                reference = follow(service, owner, experiment[field], None)[0]
                suffix = Path(reference.path).suffix
                experiment[field] = take(reference, f"experiment_{number}_{field}{suffix}")
    return files


def _read(service: Service, taken: Mapping[str, Path], folder: Path) -> tuple[StudyFile, Study]:
    with _reading:
        try:
            text = taken[STUDY].read_bytes().decode("utf-8-sig")
            file = parse(StudyFile, decode(text, STUDY), STUDY)
            _refuse_strays(file, taken)
            _drawing(service, file, taken)
            return file, read_study(folder / STUDY)
        except UnicodeDecodeError:
            raise Problem("invalid", f"{STUDY} is not UTF-8 text; save it as UTF-8.") from None
        except DrawingError as error:
            raise faulty(DrawingError([_plain(said, folder) for said in error.problems], STUDY)) from None


def _drawing(service: Service, file: StudyFile, taken: Mapping[str, Path]) -> Mechanism:
    return read_drawing(service, taken[safe_path(file.mechanism)])


def _refuse_strays(file: StudyFile, taken: Mapping[str, Path]) -> None:
    """Problem where the study names a file that was not sent."""
    named = [file.mechanism]
    for experiment in file.experiments:
        named += [uri for field in NAMED if (uri := getattr(experiment, field)) is not None]
    if outside := [uri for uri in named if uri.startswith("../")]:
        raise Problem(
            "invalid",
            f"{STUDY} names {', '.join(outside[:20])}, outside its folder; send it beside {STUDY}, and name it so.",
        )
    if missing := [uri for uri in named if safe_path(uri) not in taken]:
        there = ", ".join(sorted(taken)[:20])
        raise Problem("invalid", f"{STUDY} names {', '.join(missing[:20])}, not among the files sent: {there}.")


def _plain(sentence: str, folder: Path) -> str:
    return sentence.replace(f"{folder}/", "")
