"""A study ready for questions: its experiments with their noise, under one family of the library."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Bool, Float

from backend.diagnose.bumps import bumps
from backend.diagnose.calibration import Misplaced, cameras_of, with_cameras
from backend.diagnose.candidate import Candidate
from backend.diagnose.kept import Kept
from backend.diagnose.library import PLAYS, RUBBING, Library
from backend.diagnose.noise import Noise, estimate
from backend.diagnose.overrides import laid_out, set_somewhere, whole
from backend.diagnose.probe import AT_ONCE, Probe, with_drives
from backend.diagnose.settled import lying
from backend.fit.free import FreeParameter
from backend.fit.measured import AXES
from backend.fit.prediction import addresses_of
from backend.mechanism.constraints import drawn, size_m
from backend.mechanism.effect import Effect
from backend.mechanism.joint import WITHOUT_COORDINATE
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.mobility import rank_at
from backend.mechanism.study import Study
from backend.model.build import build
from backend.model.model import Address, Model
from backend.simulate.record import BASE, series_of

UNKNOWN = "unknown@"  # ids of the drives that stand for what is not in the library
WAVES = (12, 48)  # fewest and most bumps in time of an unknown drive
FLOOR = (2048, 4096)  # steps and samples: most records fit in one frame, and room costs next to nothing
FEW_WAVES = (4, 8, 12, 16, 24, 32, 48)  # of which each is a program of its own
PER_TIME = 1.6  # natural times between bumps
ALL_WAVES = 512  # joints times bumps
FREE = 2  # numbers of causes, beside the start and the tolerances: a fit of so many should take one round of slopes
ALIKE = 0.2  # of the sum of squares that a motion leaves
SAME = 1e-3
"""Where a law has to account for all that causes do, the error of slopes about a motion that is ALIKE weighs more than
what laws and causes differ by."""
Item = TypeVar("Item")
Made = TypeVar("Made")


@dataclass(frozen=True)
class Choice:
    """What is free: some candidates, beside the study's tolerances and its cameras' numbers. Columns of `ties` follow
    `parameters`.
    """

    candidates: tuple[Candidate, ...]
    parameters: tuple[FreeParameter, ...]
    ties: Float[np.ndarray, "all few"]
    prior_sd: Float[np.ndarray, " few"]

    @property
    def settled_m(self) -> float:
        """How far from the middle of their holes loose pins may lie before the release."""
        return max((c.settled_m for c in self.candidates), default=0.0)

    @property
    def loose(self) -> tuple[str, ...]:
        """Joints whose pins are loose by one of the candidates."""
        return tuple(dict.fromkeys(on for c in self.candidates if c.kind in PLAYS for on in c.on))

    @property
    def rubs(self) -> bool:
        """Whether loose pins rub by a coefficient that is sought."""
        return any(c.kind in PLAYS and p.parameter == RUBBING for c in self.candidates for p in c.parameters)

    @property
    def name(self) -> str:
        """Names of the candidates."""
        return " + ".join(c.name for c in self.candidates) or "nothing"

    @property
    def own(self) -> int:
        """How many numbers belong to the candidates; they come first."""
        return sum(len(c.parameters) for c in self.candidates)

    @property
    def sizes(self) -> Bool[np.ndarray, " own"]:
        """Which of the candidates' numbers say how much there is of them."""
        return np.array([size for c in self.candidates for size in c.sizes], bool)

    @property
    def start(self) -> np.ndarray:
        """As drawn."""
        return np.array([p.start for p in self.parameters])


@dataclass
class Subject:
    """Experiments to learn from and to test on. neutral: every parameter of the library as drawn.

    joints: where something unknown may act: a force; of a joint that is told how to move (`told`) a motion beside that.
    axes: along which a base that moves would be seen. Both drive the last columns of every record, in this order.
    coarse: how many of its steps make one of those in which a study is simulated.
    """

    mechanism: Mechanism
    library: Library
    model: Model
    fit: list[Probe]
    held_out: list[Probe]
    noise: Noise
    held_noise: Noise
    step_s: float
    joints: tuple[str, ...]
    told: frozenset[str] = frozenset()
    axes: tuple[str, ...] = ()
    coarse: int = 1
    kept: Kept = field(default_factory=Kept)
    slopes: dict[str, list[tuple[np.ndarray, Any]]] = field(default_factory=dict)
    lengthened: dict[int, list[Probe]] = field(default_factory=dict)

    @cached_property
    def neutral(self) -> np.ndarray:
        """As drawn."""
        return np.array(self.library.neutral)

    @property
    def rough(self) -> list[Probe]:
        """Experiments to learn from, in the steps in which a study is simulated: finer ones tell what a motion misses,
        and slopes about it need none.
        """
        return self.fit if self.coarse == 1 else self.in_longer_steps(self.coarse)

    def in_longer_steps(self, times: int) -> list[Probe]:
        """Experiments to learn from, each step so many of these."""
        if times not in self.lengthened:
            self.lengthened[times] = [p.in_steps(times * self.step_s) for p in self.fit]
        return self.lengthened[times]

    def put_right(self, times: int, errors: Sequence[Float[np.ndarray, " samples"]]) -> Subject:
        """The same subject to learn from in steps so many times as long, with these errors of them put back."""
        fit = [p.put_right(e) for p, e in zip(self.in_longer_steps(times), errors, strict=True)]
        return replace(self, fit=fit, step_s=times * self.step_s, coarse=1, slopes={}, lengthened={})

    def size_of(self, joint: str) -> float:
        """What counts as one of a joint's coordinate: 1 rad, or a mechanism length [m]."""
        sliding = self.mechanism.joint(joint).type == "prismatic"
        return float(self.model.scale.length_m) if sliding else 1.0

    def choose(self, *candidates: Candidate) -> Choice:
        """Free these candidates and the tolerances that none of them takes."""
        count = len(self.library.parameters)
        taken = {i for c in candidates for t in c.takes for i in t}
        rest = [i for i in self.library.nuisances if i not in taken]
        parameters = [p for c in candidates for p in c.parameters] + [self.library.parameters[i] for i in rest]
        ties = [c.ties(count) for c in candidates] + [np.eye(count)[:, [i]] for i in rest]
        sd = np.array([p.prior_sd for p in parameters], float)
        return Choice(tuple(candidates), tuple(parameters), np.concatenate([np.zeros((count, 0)), *ties], 1), sd)

    def chosen(self, probe: Probe, choice: Choice) -> Probe:
        """An experiment with these numbers free."""
        made = probe.choose(choice.ties, self.neutral)
        if choice.settled_m:
            made.lying = choice.settled_m * lying(probe, choice.loose)
        return made

    def alike(self, what: str, r: Float[np.ndarray, " n"], make: Callable[[], Made], within: float = ALIKE) -> Made:
        """Slopes about a motion that leaves r, or about another whose distance from it is less than this share of its
        distance from the data, in squares: to first order they say the same.
        """
        known = self.slopes.setdefault(what, [])
        for left, made in known:
            if left.size == r.size and np.sum((left - r) ** 2) < within * (r @ r):
                return made
        known.append((r, make()))
        return known[-1][1]

    def put_back(self, errors: Sequence[Float[np.ndarray, " samples"]]) -> None:
        """Errors of the step, of the fitted and then of the held-out experiments, into every prediction from now on."""
        for probe, error in zip((*self.fit, *self.held_out), errors, strict=True):
            probe.correction, probe._last = error, None

    def over(self, work: Callable[[Item], Made], items: Sequence[Item]) -> list[Made]:
        """One after the other on each core."""
        with ThreadPoolExecutor(max_workers=min(max(len(items), 1), os.cpu_count() or 1)) as pool:
            return list(pool.map(work, items))


def prepare(
    study: Study,
    library: Library,
    step_s: float,
    noise: tuple[Noise, Noise] | None = None,
    kept: Kept | None = None,
    coarse: int = 1,
) -> Subject:
    """Build the family's model and find where every experiment starts. ValueError names the experiment.

    kept: ends of fits, of a search that may have been cut off. coarse: see `Subject`.
    """
    kept = Kept() if kept is None else kept
    cameras = cameras_of(study)
    pushed, told = _drivable(study), _on_record(study)
    joints = (*pushed, *told)
    drives = [Effect(id=UNKNOWN + j, kind="effort_offset", on=(j,), parameters={}) for j in pushed]
    model = build(study.mechanism, (*library.added, *drives))
    addresses = addresses_of(library.parameters)
    library = with_cameras(library, cameras)
    neutral = np.array(library.neutral)
    turning = {j.id: j.type != "prismatic" for j in study.mechanism.joints}

    given = {e.id: model.overridden(e.overrides) for e in (*study.fit, *study.held_out)}
    known = set_somewhere({a for values in given.values() for a in values}, addresses)

    def probe(experiment) -> Probe:
        own = tuple(tuple(a for a in group if whole(a) not in given[experiment.id]) for group in addresses)
        made = Probe.of(experiment, model, own, step_s)
        made.addresses, made.overrides = addresses, laid_out(made.model, given[experiment.id].keys(), known)
        return made

    fit, held = [probe(e) for e in study.fit], [probe(e) for e in study.held_out]
    axes = tuple(sorted({c.coordinate[0] for p in fit for c in p.data.channels if c.coordinate in AXES}))
    driven: tuple[Address, ...] = (
        *((UNKNOWN + j, "torque_n_m" if turning[j] else "force_n") for j in pushed),
        *told.values(),
        *((BASE, axis) for axis in axes),
    )
    frame = tuple(
        _few_sizes(max(sizes), floor)
        for sizes, floor in zip(zip(*(p.frame for p in (*fit, *held)), strict=True), FLOOR, strict=True)
    )
    waves = int(np.clip(max(p.duration_s for p in fit) / (PER_TIME * model.scale.time_s), *WAVES))
    waves = max(n for n in FEW_WAVES if n <= max(min(waves, ALL_WAVES // max(len(joints), 1)), FEW_WAVES[0]))
    wanted = max(p.unknowns for p in fit) + len(library.nuisances) + FREE
    for p in (*fit, *held):
        p.at_once = AT_ONCE * -(-wanted // AT_ONCE)
        p.misplaced = Misplaced.of(p.data, model, cameras, p.experiment.camera)
        p.loose = any(c.family in PLAYS for c in library.candidates)
        p.neutral, p.bumps = neutral, bumps(frame[0], step_s, p.duration_s, waves)
        setting = p.framed(*frame)
        p.__dict__["setting"] = replace(setting, record=with_drives(setting.record, frame[0], driven))
    if noise is None:
        every = estimate([p.data for p in (*fit, *held)])
        parts = slice(len(fit)), slice(len(fit), None)
        mine, theirs = (Noise(every.sigma[part], every.memory, every.keep[part]) for part in parts)
        noise = mine, theirs
    return Subject(
        study.mechanism, library, model, fit, held, *noise, step_s, joints, frozenset(told), axes, coarse, kept
    )


def _few_sizes(count: int, floor: int) -> int:
    """Rounded up to a power of two, so that studies of one mechanism share compiled programs; steps after the last
    sample are not taken.
    """
    return int(2 ** np.ceil(np.log2(max(count, floor)) - 1e-9))


def _on_record(study: Study) -> dict[str, Address]:
    """Joints whose motion is on record in every experiment, with what the record drives: each may not follow it."""
    series = [{address for address, _, _ in series_of(e)} for e in (*study.fit, *study.held_out)]
    every = set.intersection(*series) if series else set()
    motions = {e.id: e.on for e in study.mechanism.effects if e.kind == "prescribed_motion" and len(e.on) == 1}
    return {motions[effect][0]: (effect, name) for effect, name in sorted(every) if effect in motions}


def _drivable(study: Study) -> tuple[str, ...]:
    """Joints at which an unknown force would show: neither told how to move, nor between two parts that stand still;
    none where all freedoms are told.
    """
    m = study.mechanism
    told = {id for e in m.effects if e.kind == "prescribed_motion" for id in e.on if e.on != "all"}
    if any(e.kind == "prescribed_motion" and e.on == "all" for e in m.effects):
        return ()
    if told and rank_at(m, list(m.joints), drawn(m), size_m(m)).mobility <= len(told):
        return ()
    still = {b.id for b in m.bodies if b.fixed}
    types = ("revolute", "prismatic", "cylindrical", "planar")
    return tuple(
        j.id for j in m.joints
        if j.type in types and j.type not in WITHOUT_COORDINATE and j.id not in told
        and not {j.body_a, j.body_b} <= still
    )  # fmt: skip
