"""A case as a study folder: study.json, mechanism.json and a table of tracks for each experiment, no word of truth."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from backend.blind.withheld.case import Case
from backend.blind.withheld.linkage import document
from backend.mechanism.read import parse_mechanism, write_mechanism, write_study
from backend.mechanism.study import ExperimentFile, Release, StudyFile

HEADER = "time_s,marker,x_m,y_m,z_m,sigma_m"


def write_case(case: Case, folder: Path) -> Path:
    """Write the folder and return the path of its study.json; y_m is empty, for one camera does not see it."""
    folder.mkdir(parents=True, exist_ok=True)
    write_mechanism(parse_mechanism(document(case.linkage)), folder / "mechanism.json")
    experiments = []
    for e, places in enumerate(case.places, 1):
        (folder / f"e{e}.csv").write_text("\n".join([HEADER, *_rows(case, places)]) + "\n")
        use = "fit" if e <= case.fit else "held_out"
        release = Release(time_s=round(case.release_s, 9))
        experiments.append(ExperimentFile(id=f"e{e}", use=use, tracks=f"e{e}.csv", release=release))
    path = folder / "study.json"
    write_study(StudyFile(mechanism="mechanism.json", experiments=tuple(experiments)), path)
    return path


def _rows(case: Case, places: np.ndarray) -> list[str]:
    sigma = f"{case.noise.sigma_m:.6g}" if case.noise.told else ""
    names = [id for id, _, _ in case.linkage.markers]
    return [
        f"{time:.9g},{name},{z.real:.7g},,{z.imag:.7g},{sigma}"
        for time, frame in zip(case.record.elapsed_s, places, strict=True)
        for name, z in zip(names, frame, strict=True)
        if np.isfinite(z)
    ]


def as_json(label: object) -> str:
    """The one spelling of a label that is sealed: keys in order, no spaces."""
    return json.dumps(label, sort_keys=True, separators=(",", ":"))
