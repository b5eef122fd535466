"""What a fit needs to go on after it was killed: its stages so far, on disk after every accepted step.

A fit of one study with one set of options runs through the same stages every time. Stages that ended are read back
instead of searched again; the one that was cut off goes on from its last accepted step.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np

from backend.fit.solve import Iteration, Solution
from backend.mechanism.study import Study

FILE = "fit.checkpoint.json"
FORMAT = 2


@dataclass
class Stage:
    """One search of a fit. spread: the misfit that weighs its samples. end: how it ended, None while it runs."""

    spread: float
    history: list[Iteration] = field(default_factory=list)
    end: Solution | None = None

    def add(self, iteration: Iteration) -> Iteration:
        """Note an accepted step, counted on from those noted before."""
        self.history.append(replace(iteration, iteration=len(self.history)))
        return self.history[-1]


class Checkpoint:
    """The stages of one fit, in order, and the file that keeps them (none for path None).

    digest: of all that decides the course of the fit; a file with another one is not continued. Searches that go at
    the same time have a branch each, in the same file.
    """

    def __init__(self, path: Path | None, digest: str, stages: Sequence[Stage] = (), trunk: Checkpoint | None = None):
        self.path, self.digest = path, digest
        self._known, self.stages = list(stages), []
        self._trunk, self._branches, self._lock = trunk, [], Lock()

    @classmethod
    def resume(cls, path: Path, digest: str) -> Checkpoint:
        """Read what was kept; ValueError with the remedy where there is nothing, or that of another fit."""
        try:
            kept = json.loads(path.read_text(encoding="utf-8"))
        except FileNotFoundError:
            raise ValueError(
                f"{path} does not exist, so there is no fit to resume: start it without --resume, or name the --out "
                "of the fit that was cut off."
            ) from None
        except json.JSONDecodeError as error:
            raise ValueError(f"{path} cannot be read ({error}): start again without --resume.") from None
        if kept.get("format") != FORMAT:
            raise ValueError(
                f"{path} was written by another version of linktwin: start again without --resume, or resume with "
                "that version."
            )
        if kept.get("digest") != digest:
            raise ValueError(
                f"{path} belongs to another fit: the study, what is free or an option has changed since. "
                "Resume with those it was started with, or start again without --resume."
            )
        made = cls(path, digest, [_stage(s) for s in kept["stages"]])
        made._branches += [cls(None, digest, [_stage(s) for s in stages], made) for stages in kept["branches"]]
        return made

    def branch(self, k: int) -> Checkpoint:
        """That of the kth of several searches; asked for in their order."""
        if k == len(self._branches):
            self._branches.append(Checkpoint(None, self.digest, trunk=self))
        return self._branches[k]

    def known(self) -> Stage | None:
        """The stage that comes next, if it was kept."""
        at = len(self.stages)
        if at == len(self._known):
            return None
        self.stages.append(self._known[at])
        return self.stages[-1]

    def begin(self, spread: float) -> Stage:
        """A stage that was not begun before."""
        self.stages.append(Stage(spread))
        self._known.append(self.stages[-1])
        return self.stages[-1]

    def write(self) -> None:
        """Replace the file by what is known now; a reader sees the old one or the new one, never a part."""
        if self._trunk is not None:
            self._trunk.write()
        if self.path is None:
            return
        with self._lock:
            told = {
                "format": FORMAT, "digest": self.digest, "stages": [_told(s) for s in self._known],
                "branches": [[_told(s) for s in branch._known] for branch in self._branches],
            }  # fmt: skip
            part = self.path.with_name(self.path.name + ".part")
            part.parent.mkdir(parents=True, exist_ok=True)
            with part.open("w", encoding="utf-8") as file:
                json.dump(told, file)
                file.flush()
                os.fsync(file.fileno())
            os.replace(part, self.path)

    def remove(self) -> None:
        """The fit is finished: nothing is left to resume."""
        if self.path is not None:
            self.path.unlink(missing_ok=True)


def digest(study: Study, free: Sequence[str], options: Mapping[str, Any]) -> str:
    """A fingerprint of everything that decides the course of a fit; where files lie does not."""
    stated = {
        "mechanism": study.mechanism.model_dump(mode="json"),
        "tolerances": [t.model_dump(mode="json") for t in study.tolerances],
        "experiments": [(e.id, e.use, e.release.model_dump(mode="json"), e.overrides) for e in study.experiments],
        "free": list(free),
        "options": dict(options),
    }
    made = hashlib.sha256(json.dumps(stated, sort_keys=True).encode())
    for e in study.experiments:
        for name in ("tracks", "joint_positions", "inputs", "joint_efforts"):
            table = getattr(e, name)
            if table is not None:
                made.update(f"{e.id} {name}\n{table.to_csv(index=False)}".encode())
        if e.camera is not None:
            made.update(f"{e.id} camera\n".encode() + e.camera.read_bytes())
    return made.hexdigest()


def _told(stage: Stage) -> dict[str, Any]:
    steps = [[i.objective, i.gradient_norm, i.parameters.tolist()] for i in stage.history]
    end = None
    if (s := stage.end) is not None:
        end = {
            "x": s.x.tolist(), "objective": s.objective, "status": s.status, "message": s.message,
            "at_bound": s.at_bound, "evaluations": s.evaluations,
        }  # fmt: skip
    return {"spread": stage.spread, "history": steps, "end": end}


def _stage(told: Mapping[str, Any]) -> Stage:
    steps = [Iteration(i, o, g, np.array(x, float)) for i, (o, g, x) in enumerate(told["history"])]
    end, none = None, np.zeros(0)
    if (e := told["end"]) is not None:
        # Residuals are made again where they are needed, at the end of the fit.
        end = Solution(
            np.array(e["x"], float), none, np.zeros((0, 0)), none, e["objective"], e["status"], e["message"],
            tuple(e["at_bound"]), tuple(steps), e["evaluations"],
        )  # fmt: skip
    return Stage(told["spread"], steps, end)
