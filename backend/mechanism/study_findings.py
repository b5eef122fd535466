"""What stands out in a study that can be read: drives, tolerances and columns that are likely slips, records that stand
twice, and numbers that are another unit's."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from backend.mechanism.columns import column_findings
from backend.mechanism.effect import kind_named
from backend.mechanism.findings import gravity_findings
from backend.mechanism.joint import WITHOUT_COORDINATE
from backend.mechanism.kinds import EffectKind
from backend.mechanism.likewise import likewise
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.release_findings import GAP, release_findings
from backend.mechanism.rigid import rigid_findings
from backend.mechanism.seen import reach_m
from backend.mechanism.study import Experiment, Study, Tolerance, driven_effects
from backend.mechanism.tracks import PIXELS, PLACES, SHOWN
from backend.mechanism.turns import TURN
from backend.mechanism.units import unit_findings

if TYPE_CHECKING:
    import pandas as pd

MANY_TURNS = 2.0  # to and fro: what swings so far in degrees does in an angle of seven
BREAKS_OFF = 0.1  # of an experiment, without a record of what was a force until then
FEW_ROWS = 10  # below which a record is a list of what was switched, not sampled


def study_findings(study: Study) -> list[str]:
    """Warnings that each name a part, its number and the remedy."""
    return [
        *gravity_findings(study.mechanism),
        *(s for index, t in enumerate(study.tolerances, start=1) for s in _of_tolerance(index, t, study.mechanism)),
        *_of_shared_tables(study),
        *_of_drives_named_like_joints(study),
        *(
            f"experiment '{id}': {sentence}"
            for id, sentence in likewise(
                (experiment.id, sentence)
                for experiment in study.experiments
                for sentence in _of_experiment(experiment, study.mechanism)
            )
        ),
    ]


def _of_tolerance(index: int, tolerance: Tolerance, mechanism: Mechanism) -> Iterator[str]:
    kind = kind_named(tolerance.kind)
    if kind.name.endswith("_error") or kind.acts_on in ("world", "camera", "marker"):
        if loose := _loose(kind, tolerance.sd, mechanism):
            yield f'tolerance {index} ("{kind.name}"): sd is {loose}'
        return
    on = tolerance.on if isinstance(tolerance.on, str) else ", ".join(tolerance.on)
    yield (
        f'tolerance {index} ("{kind.name}" on {on}) is a law of what acts, no error of the drawing: its sd '
        f"{tolerance.sd:g} is not relative, but in the unit of each of its numbers ({_numbers_of(kind)}). To find "
        f"what acts, free it (--free {kind.name}:{on.replace(', ', '+')}) and leave the tolerance out"
    )


def _loose(kind: EffectKind, sd: float, mechanism: Mechanism) -> str | None:
    """Why a spread leaves nothing of what was drawn, in the unit of the number that it is of."""
    spec = next(spec for spec in kind.parameters.values() if not spec.by_name)
    if spec.name == "relative" and sd >= 1.0:
        return f"{sd:g}, {sd:.0%} of what is drawn; write a share: 2% is 0.02"
    if spec.unit == "rad" and sd >= 1.0:
        return f"{sd:g} rad, {np.degrees(sd):.3g} degrees; write rad: a degree is 0.0175"
    if spec.unit == "m" and sd >= (reach := reach_m(mechanism)):
        return f"{sd:g} m, and all parts measure {reach:.3g} m together; write m: 1 mm is 0.001"
    return None


def _numbers_of(kind: EffectKind, shown: int = 3) -> str:
    freed = [f"{spec.name} in {spec.unit}" for spec in kind.parameters.values() if not spec.by_name]
    return ", ".join(freed[:shown]) + (", ..." if len(freed) > shown else "")


def _of_shared_tables(study: Study) -> Iterator[str]:
    """Measurements that stand in several experiments, of which one at least is fitted."""
    alike: dict[tuple[str, bytes], list[Experiment]] = {}
    for experiment in study.experiments:
        for name in ("tracks", "joint_positions"):
            if (table := getattr(experiment, name)) is not None:
                numbers = _values(table).tobytes()
                alike.setdefault((name, numbers), []).append(experiment)
    for (name, _), same in alike.items():
        uses = {experiment.use for experiment in same}
        if len(same) < 2 or "fit" not in uses:
            continue
        void = "what is held out was fitted, and tests nothing" if len(uses) > 1 else "they count as often in the fit"
        who = ", ".join(f"'{experiment.id}' ({experiment.use})" for experiment in same[:SHOWN])
        yield f"experiments {who} have the same {name}: {void}. Give each its own record, or leave out the others"


def _values(table: pd.DataFrame) -> np.ndarray:
    """What was measured; a clock that was set otherwise makes no other record, where enough was measured to tell."""
    numbers = table.select_dtypes("number").drop(columns=["frame"], errors="ignore")
    clock = table["time_s"].to_numpy(float)
    return numbers.assign(time_s=np.round(clock - clock.min(), 6) if clock.size >= FEW_ROWS else clock).to_numpy(float)


def _of_drives_named_like_joints(study: Study) -> Iterator[str]:
    """Drives on record that are called like the joint that they stand at; elsewhere `check` tells of the drawing."""
    driven = driven_effects(study)
    for effect in study.mechanism.effects:
        if effect.id in driven and effect.on == (effect.id,) and kind_named(effect.kind).acts_on == "joint":
            yield (
                f'effect "{effect.id}" is on record and called like its joint: --free {effect.kind}:{effect.id} frees '
                "the drive itself, whose value the record gives, not another at that joint; give it another id"
            )


def _of_experiment(experiment: Experiment, mechanism: Mechanism) -> Iterator[str]:
    tables = [t for t in (experiment.tracks, experiment.joint_positions, experiment.joint_efforts) if t is not None]
    if not tables:
        return
    times = np.unique(np.concatenate([table["time_s"].to_numpy(float) for table in tables]))
    yield from release_findings(experiment, times, mechanism)
    yield from _of_drives(experiment, mechanism, float(times[-1]))
    yield from _of_angles(experiment, mechanism)
    yield from unit_findings(experiment, mechanism)
    if experiment.tracks is not None:
        yield from _of_unseen(experiment.tracks)
        yield from column_findings(experiment.tracks, mechanism)
        yield from rigid_findings(experiment.tracks, mechanism)


def _of_drives(experiment: Experiment, mechanism: Mechanism, last: float) -> Iterator[str]:
    if experiment.inputs is None:
        return
    release = experiment.release.time_s
    for (effect, parameter), rows in experiment.inputs.groupby(["effect", "parameter"], sort=False):  # type: ignore[misc]
        times, values = rows["time_s"].to_numpy(float), rows["value"].to_numpy(float)
        gaps = np.diff(times)
        interval = float(np.median(gaps)) if gaps.size else 0.0
        where = f'the record of effect "{effect}" {parameter}'
        sampled = times.size >= FEW_ROWS and float(np.quantile(gaps, 0.9)) < 2.0 * interval
        if times[0] - release > (GAP * interval if sampled else 0.0):
            yield (
                f"{where} begins at {times[0]:g} s, {times[0] - release:.3g} s after the release at {release:g} s: "
                f"until then its first value, {values[0]:g}, is taken to hold. Record it from the release on, or check "
                "the clock"
            )
        # What is switched off, led to a place, or a list of switchings, may well stay there, and not be logged.
        led = values[-1] == 0.0 or any(e.id == effect and e.kind == "prescribed_motion" for e in mechanism.effects)
        rests = sampled and values[-1] == values[-2] and (led or last - times[-1] < BREAKS_OFF * (last - release))
        if sampled and not rests and last - times[-1] > GAP * interval:
            yield (
                f"{where} ends at {times[-1]:g} s, {last - times[-1]:.3g} s before the last sample at {last:g} s: from "
                f"then on its last value, {values[-1]:g}, is taken to hold. Record it to the end, or cut the tables "
                "there"
            )


def _of_unseen(tracks: pd.DataFrame) -> Iterator[str]:
    """Markers that stand in the table and were measured nowhere, neither in the world nor in the picture."""
    columns = [column for column in (*PLACES, *PIXELS) if column in tracks]
    measured, names = np.any(tracks[columns].notna().to_numpy(), axis=1), tracks["marker"].to_numpy(str)
    for marker in dict.fromkeys(names):
        its = np.flatnonzero(names == marker)
        if not measured[its].any():
            yield f'marker "{marker}" stands in {its.size} rows and was measured in none: track it, or take them out'


def _of_angles(experiment: Experiment, mechanism: Mechanism) -> Iterator[str]:
    """Joints that swing through turns and back. A rotor turns on, and a wild sample is no swing."""
    if experiment.joint_positions is None:
        return
    for id, rows in experiment.joint_positions.groupby("joint", sort=False):
        q = rows["q"].dropna().to_numpy(float)
        if q.size < FEW_ROWS or mechanism.joint(str(id)).type in ("prismatic", *WITHOUT_COORDINATE):
            continue
        q = np.median(np.lib.stride_tricks.sliding_window_view(q, 3), axis=1)
        back, forth = np.max(np.maximum.accumulate(q) - q), np.max(q - np.minimum.accumulate(q))
        if (swing := float(min(back, forth))) > MANY_TURNS * TURN:
            yield (
                f'joint "{id}" turns by {swing:.4g} rad and back, {swing / TURN:.2g} turns; q is in rad: multiply '
                "degrees by 0.0174533"
            )
