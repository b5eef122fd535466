"""What came of looking for a jam: jam.json."""

from __future__ import annotations

import hashlib
import re
from typing import Annotated, Literal

from pydantic import Field

from backend.mechanism.part import Id, Part, Vector3

LONGEST = 60  # letters of an experiment's id in the name of its folder
FILES = (".json", ".jsonl", ".html")

Cause = Literal["friction_lock", "singularity", "clearance_lock", "stop", "insufficient_drive", "none"]
Numbers = Annotated[tuple[float, ...], Field(strict=False)]
Counts = Annotated[tuple[int, ...], Field(strict=False)]
Vectors = Annotated[tuple[Vector3, ...], Field(strict=False)]
Names = Annotated[tuple[Id, ...], Field(strict=False)]


class Margin(Part):
    """What would free it: the least factor on the drives, the greatest on all friction; null where none does."""

    drive_factor: float | None = None
    friction_factor: float | None = None


class FrictionCone(Part):
    """The friction-cone programme at the pose of rest.

    holds: whether forces within the cones balance the load. friction_needed: least factor on friction that still holds.
    drive_held: greatest factor on the drive that friction still holds; both null where there is none.
    """

    holds: bool
    friction_needed: float | None = None
    drive_held: float | None = None


class ConeAlong(Part):
    """The friction-cone programme along the motion, asked as if it stood still there.

    shortage: friction that is short of holding the load, in parts of the load; 0 where it can, null where no forces do.
    """

    time_s: Numbers
    shortage: Annotated[tuple[float | None, ...], Field(strict=False)]


class JointReaction(Part):
    """Force [N] and torque [N m] on each body, at the joint's place on body_b, world axes, per step."""

    body_a: Id
    body_b: Id
    force_on_a_n: Vectors
    torque_on_a_n_m: Vectors
    force_on_b_n: Vectors
    torque_on_b_n_m: Vectors


class JamReport(Part):
    """jam.json: one motion, first axis of every series is `time_s`.

    onset_s: since when it rests; null where it moves to the end. at: `joint:ID` and `body:ID`, the greatest part
    first. mobility: freedoms less the rank by the spectrum's gap. small_singular_values: freedoms less the singular
    values from 1e-6 up, the published count. driven_singular_value: falls to 0 where the drive loses its lever.
    creep_ratio: largest rate over that at which friction holds. lever: share of the drive that would accelerate a
    frictionless, clearance-free copy at the pose of rest. every: steps between two entries of the series.
    result: `done`, or where and why the motion could not be followed further.
    """

    schema_version: Literal["1.0"] = "1.0"
    mechanism: Id
    experiment: Id | None = None
    jammed: bool
    onset_s: float | None = None
    cause: Cause
    at: Names = ()
    margin: Margin
    sentence: str
    lever: float | None = None
    friction_cone: FrictionCone | None = None
    friction_cone_along: ConeAlong
    step_s: float
    every: int = 1
    time_s: Numbers
    mobility: Counts
    small_singular_values: Counts
    singular_values: Annotated[tuple[Numbers, ...], Field(strict=False)]
    driven_singular_value: Numbers
    creep_ratio: Numbers
    result: str = "done"
    reactions: dict[str, JointReaction]


def run_folder(experiment: str) -> str:
    """Where the report of one experiment lies among those of its study: a folder of its own, whatever its id.

    An id that is no plain name of a folder, or may be that of a file beside it, gets a digest of itself at its end.
    """
    plain = re.sub(r"[^\w.-]+", "_", experiment).lstrip(".")[:LONGEST]
    if plain == experiment and not plain.lower().endswith(FILES):
        return plain
    return f"{plain}-{hashlib.sha256(experiment.encode()).hexdigest()[:8]}".lstrip("-")
