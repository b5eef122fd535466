"""A job as a command line: its inputs laid out in a folder, and the arguments of `linktwin`."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from backend.service.mechanisms import DRAWING
from backend.service.problems import Problem
from backend.service.service import Service
from backend.service.studies import STUDY
from backend.service.things import files_of

CHECKPOINTS = ("fit.checkpoint.json", "diagnosis.kept.jsonl", "jam.kept.jsonl")
WATCHED = "watching.jpg"  # what `linktwin track` is looking at


def arguments(service: Service, request: dict[str, Any], inputs: Path, out: Path, resume: bool) -> list[str]:
    """Lay out what the job works on under `inputs`; the arguments that make `linktwin` write to `out`.

    request: a JobRequest as JSON.  resume: go on from a checkpoint that lies in `out`.
    Raises Problem where an input was deleted meanwhile.
    """
    return [*BUILDERS[request["kind"]](service, request, inputs, resume), f"--out={out}", "--json"]


def _simulate(service: Service, request: dict[str, Any], inputs: Path, resume: bool) -> list[str]:
    drawing = _bring(service, request["mechanism"], inputs / "mechanism") / DRAWING
    options = _options(request, duration_s="duration", step_s="step", solve="solve", threshold="threshold")
    return ["simulate", str(drawing), *options]


def _jam(service: Service, request: dict[str, Any], inputs: Path, resume: bool) -> list[str]:
    if request.get("study"):
        subject = _bring(service, request["study"], inputs / "study") / STUDY
    else:
        subject = _bring(service, request["mechanism"], inputs / "mechanism") / DRAWING
    options = _options(request, duration_s="duration", step_s="step", samples="samples", seed="seed")
    options += [f"--vary={spec}" for spec in request["vary"]]
    return ["jam", str(subject), *options, *_flags(resume=resume)]


def _fit(service: Service, request: dict[str, Any], inputs: Path, resume: bool) -> list[str]:
    study = _bring(service, request["study"], inputs / "study") / STUDY
    options = _options(request, optimiser="optimiser", loss="loss", noise="noise", starts="starts", step_s="step")
    options += [f"--free={spec}" for spec in request["free"]]
    return ["fit", str(study), *options, *_flags(sparse=request["sparse"], resume=resume)]


def _diagnose(service: Service, request: dict[str, Any], inputs: Path, resume: bool) -> list[str]:
    study = _bring(service, request["study"], inputs / "study") / STUDY
    options = _options(request, tolerance_mm="tolerance", minutes="minutes")
    options += [f"--without={kind}" for kind in request["without"]]
    return ["diagnose", str(study), *options, *_flags(resume=resume)]


def _track(service: Service, request: dict[str, Any], inputs: Path, resume: bool) -> list[str]:
    clip = _bring(service, request["video"], inputs / "video")
    drawing = _bring(service, request["mechanism"], inputs / "mechanism") / DRAWING
    (film,) = clip.iterdir()
    options = [f"--mechanism={drawing}"]
    for field in ("bed", "clicks", "targets"):
        if request.get(field):
            path = inputs / f"{field}.json"
            path.write_text(json.dumps(request[field]), encoding="utf-8")
            options.append(f"--{field}={path}")
    options += _options(request, from_s="from", to_s="to", filmed_per_s="filmed-at", coast_s="coast")
    return ["track", str(film), *options, *_flags(keep_truncated=request["keep_truncated"])]


BUILDERS: dict[str, Callable[[Service, dict[str, Any], Path, bool], list[str]]] = {
    "simulate": _simulate, "jam": _jam, "fit": _fit, "diagnose": _diagnose, "track": _track,
}  # fmt: skip


def _bring(service: Service, id: str, folder: Path) -> Path:
    files = files_of(service, id)
    if not files:
        raise Problem("not-found", f"What the job works on ({id}) was deleted; store it again and start another job.")
    for file in files:
        service.storage.bring(file.key, folder / file.path)
    return folder


def _options(request: dict[str, Any], **names: str) -> list[str]:
    # One word with its value: a value that begins with a dash cannot become an option.
    return [f"--{option}={request[field]}" for field, option in names.items() if request.get(field) is not None]


def _flags(**given: bool) -> list[str]:
    return [f"--{name.replace('_', '-')}" for name, on in given.items() if on]
