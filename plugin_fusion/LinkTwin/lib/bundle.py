"""An export on disk: OUT/mechanism.json, OUT/meshes/*.stl, and OUT/raw/ with what Fusion said."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from . import stl
from .mechanism import export
from .names import file_names


@dataclass(frozen=True)
class Saved:
    """Where an export lies. mechanism: None where problems kept it from being written."""

    name: str
    folder: Path
    mechanism: Path | None
    counts: Mapping[str, int]
    warnings: Sequence[str]
    problems: Sequence[str]


def new_folder(parent: Path, name: str) -> Path:
    """A new folder for an export, named after the design; OSError where it cannot be made."""
    parent = Path(parent)
    parent.mkdir(parents=True, exist_ok=True)
    (stem,) = file_names([name], "")
    number = 1
    while True:
        folder = parent / (stem if number == 1 else f"{stem}-{number}")
        try:
            folder.mkdir()
        except FileExistsError:
            number += 1
            continue
        (folder / "raw").mkdir()
        return folder


def save_snapshot(snapshot: Mapping, folder: Path) -> None:
    """Write OUT/raw/snapshot.json, from which everything else can be made again."""
    _write(Path(folder) / "raw" / "snapshot.json", snapshot)


def save(folder: Path) -> Saved:
    """Turn OUT/raw/snapshot.json and its meshes into a mechanism; the same files come of the same snapshot."""
    folder = Path(folder)
    snapshot = json.loads((folder / "raw" / "snapshot.json").read_text(encoding="utf-8"))
    made = export(snapshot, lambda name: stl.read(folder / "raw" / name))
    _write(folder / "raw" / "readings.json", made.readings)
    counts = {part: len(made.document[part]) for part in ("bodies", "joints", "markers")}
    if made.problems:
        return Saved(made.document["name"], folder, None, counts, made.warnings, made.problems)
    (folder / "meshes").mkdir(exist_ok=True)
    for uri, groups in made.meshes.items():
        stl.write(folder / uri, groups)
    _write(folder / "mechanism.json", made.document)
    return Saved(made.document["name"], folder, folder / "mechanism.json", counts, made.warnings, ())


def summary(saved: Saved) -> dict:
    """What a person is shown of an export, as plain data for the palette."""
    counted = ", ".join(f"{count} {part}" for part, count in saved.counts.items())
    told = len(saved.warnings)
    remarks = f"; {told} {'remark' if told == 1 else 'remarks'}" if told else ""
    return {
        "name": saved.name,
        "text": f"Saved in {saved.folder}",
        "summary": counted + remarks,
        "folder": str(saved.folder),
        "warnings": list(saved.warnings),
        "problems": list(saved.problems),
        "share": None,
    }


def _write(path: Path, document: Mapping) -> None:
    text = json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")
