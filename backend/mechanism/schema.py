"""The JSON Schemas of the file formats: `python -m backend.mechanism.schema` writes them to docs/schema."""

from __future__ import annotations

import json
from pathlib import Path

from backend.mechanism.ensemble_report import EnsembleReport
from backend.mechanism.fit_report import FitReport
from backend.mechanism.gap_report import GapReport
from backend.mechanism.jam_report import JamReport
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.study import StudyFile

FORMATS = {
    "mechanism": Mechanism,
    "study": StudyFile,
    "fit": FitReport,
    "jam": JamReport,
    "gap": GapReport,
    "jam_ensemble": EnsembleReport,
}
FOLDER = Path(__file__).parents[2] / "docs" / "schema"


def schemas() -> dict[str, str]:
    """File name -> JSON Schema (draft 2020-12) of each format, as text."""
    return {
        f"{name}.schema.json": json.dumps(
            {"$schema": "https://json-schema.org/draft/2020-12/schema", **model.model_json_schema()},
            indent=1,
            ensure_ascii=False,
        )
        + "\n"
        for name, model in FORMATS.items()
    }


if __name__ == "__main__":
    FOLDER.mkdir(parents=True, exist_ok=True)
    for file, text in schemas().items():
        (FOLDER / file).write_text(text, encoding="utf-8")
