"""Experiments that no pose of the drawing explains: told of before a fit or a diagnosis is begun."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from backend.fit.measured import measured
from backend.fit.pose import Found, Target, find_start, target_of
from backend.fit.prediction import look
from backend.fit.slips import Slips
from backend.mechanism.check import few
from backend.mechanism.constraints import size_m
from backend.mechanism.study import Experiment, Study
from backend.model.build import build
from backend.model.model import Model
from backend.simulate.record import beginning, series_of

FAR_RAD = 0.1  # six degrees: play, bending and the rough zero of an encoder stay below a third of it
FAR = 0.05  # of the mechanism's size: a camera's scale off by 10% is less, seen from the middle
FAR_PART = 0.1  # of a part's typical length, where the mechanism is drawn folded
MOST_BODIES = 40  # of which a search for the start takes seconds


@dataclass(frozen=True)
class Begun:
    """What was seen at the release of an experiment, and the pose that is nearest to it. far_m: what counts as far."""

    id: str
    model: Model
    target: Target
    found: Found
    far_m: float

    def off(self, target: Target, seen: np.ndarray) -> float:
        """How far the farthest marker or joint is off what is seen of a pose, in shares of what counts as far."""
        shares = target.asked(target.miss(seen) / target.size) * target.size
        shares = shares / np.where(target.angle, FAR_RAD, self.far_m)
        places = np.array(target.at)
        return max(float(np.linalg.norm(shares[places == at])) for at in dict.fromkeys(target.at))

    @property
    def unexplained(self) -> bool:
        """Whether the pose leaves something far off."""
        seen = np.asarray(look(self.model, self.found.reference, jnp.asarray(self.found.motions))[0])
        return self.off(self.target, seen) >= 1.0

    def slip(self) -> str:
        """What would explain it, and what to do."""
        found = Slips(self.model, self.target, self.found.reference, self.off).likely()
        if found is not None:
            return found
        if all(at.startswith("joint:") for at in self.target.at):
            return "Check zero (the drawn pose), sign and unit of what the joints read, and the lengths between them"
        return "Check lengths, the names of markers, and axes, origin and unit of the tables"


def unexplained(study: Study) -> tuple[list[str], list[str]]:
    """Why experiments could not be begun, and warnings of those that no pose explains: a sentence each.

    Nothing is said of mechanisms of many bodies, of which the search would take minutes.
    """
    refused: list[str] = []
    if len(study.mechanism.moving_bodies()) > MOST_BODIES:
        return refused, []
    model = build(study.mechanism)
    far_m = max(FAR * size_m(study.mechanism), FAR_PART * float(model.scale.length_m))
    begun: list[Begun] = []
    for experiment in study.experiments:
        if all(t is None for t in (experiment.tracks, experiment.joint_positions, experiment.joint_efforts)):
            continue
        try:
            begun.append(_begun(experiment, model, far_m))
        except ValueError as error:
            where = f"experiment '{experiment.id}'"
            refused.append(str(error) if str(error).startswith(where) else f"{where}: {error}")
    return refused, list(_told([each for each in begun if each.unexplained]))


def _begun(experiment: Experiment, model: Model, far_m: float) -> Begun:
    values = model.overridden(experiment.overrides)
    own = model.with_parameters({a: jnp.asarray(v) for a, v in values.items()}) if values else model
    own = beginning(own, series_of(experiment))
    data = measured(experiment, own)
    found = find_start(own, data, experiment.release)
    return Begun(experiment.id, own, target_of(own, data, experiment.release), found, far_m)


def _told(off: list[Begun]) -> Iterator[str]:
    """One sentence: what is amiss in one experiment is so in the others, mostly."""
    if off:
        first, *others = off
        more = few([f"'{each.id}' ({each.found.worst})" for each in others])
        yield (
            f"experiment '{first.id}': no pose of the drawing explains its first samples, {first.found.worst} the "
            f"farthest off. {first.slip()}" + (f". Nor does one explain those of {more}" if more else "")
        )
