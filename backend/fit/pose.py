"""Find the pose that explains what was seen at the release: Gauss-Newton along the mechanism's free motions.

The drawn pose may be half a turn away, so the search walks: short steps, closing the loops and taking the free
motions anew at each. A mechanism of which too little is seen keeps the rest as drawn (minimum norm).
"""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from backend.fit.measured import Measured
from backend.fit.prediction import look
from backend.fit.release import ChannelStart, held_still, moving
from backend.mechanism.study import Release
from backend.model.model import Model
from backend.model.state import Pose, drawn_pose
from backend.model.system import System, system
from backend.simulate import assemble

LONGEST = 0.4  # rad, or mechanism lengths, in one step of the walk
OTHERS = 12  # poses to walk from when the first walk ends where the data are not explained
WELL = 0.05  # rad, or mechanism lengths: rms below which a pose explains what was seen


@dataclass(frozen=True)
class Miss:
    """What is seen off a pose: where (`joint:j1`, `marker:tip`), and by how much in its unit (m or rad)."""

    at: str
    by: float
    unit: str

    def __str__(self) -> str:
        what, _, id = self.at.partition(":")
        return f'{what} "{id}" by ' + (f"{1e3 * self.by:.3g} mm" if self.unit == "m" else f"{self.by:.3g} rad")


@dataclass(frozen=True)
class Found:
    """A start: closed reference pose, its free motions, rates along them, and whole turns of each column.

    rms: of what is seen off the pose, in rad or mechanism lengths. worst: what of it is farthest off.
    """

    reference: Pose
    motions: Float[np.ndarray, "slots 6 mobility"]
    rates: Float[np.ndarray, " mobility"]
    turns: Float[np.ndarray, " columns"]
    rms: float
    worst: Miss


@dataclass(frozen=True)
class Target:
    """What was seen at the release, one entry a channel; angle marks columns that repeat every turn.

    loose: what the channels share and is not asked, such as where an origin lies: directions of misses (k, d).
    """

    at: tuple[str, ...]
    column: Int[np.ndarray, " k"]
    start: tuple[ChannelStart, ...]
    angle: np.ndarray
    size: Float[np.ndarray, " k"]
    loose: Float[np.ndarray, "k d"] | None = None

    @property
    def value(self) -> np.ndarray:
        """What each channel showed [m or rad] (k,)."""
        return np.array([s.value for s in self.start])

    @property
    def rate(self) -> np.ndarray:
        """How fast each channel changed [m/s or rad/s] (k,)."""
        return np.array([s.rate for s in self.start])

    def miss(self, seen: np.ndarray) -> np.ndarray:
        """What each channel showed beyond what is seen of a pose; angles within half a turn [m or rad] (k,)."""
        miss = self.value - seen[self.column]
        return np.where(self.angle, (miss + np.pi) % (2 * np.pi) - np.pi, miss)

    def worst(self, seen: np.ndarray) -> Miss:
        """The marker or joint that is seen farthest off, for its size; a marker over all its coordinates."""
        miss, places = self.miss(seen), np.array(self.at)
        shares = {at: float(np.linalg.norm((miss / self.size)[places == at])) for at in self.at}
        at = max(shares, key=lambda at: shares[at])
        its = places == at
        return Miss(at, float(np.linalg.norm(miss[its])), "rad" if self.angle[its].any() else "m")

    def without(self, at: str) -> Target:
        """What is left when one marker or joint is not asked."""
        kept = np.array([place != at for place in self.at])
        start = tuple(s for s, keep in zip(self.start, kept, strict=True) if keep)
        at_others = tuple(place for place in self.at if place != at)
        return Target(at_others, self.column[kept], start, self.angle[kept], self.size[kept])

    def asked(self, off: np.ndarray) -> np.ndarray:
        """Misses, or their slopes (k, ...), without what is loose."""
        return off if self.loose is None else off - self.loose @ np.linalg.lstsq(self.loose, off)[0]


def find_start(model: Model, data: Measured, release: Release) -> Found:
    """The start of an experiment from its own first samples alone (see `release`)."""
    target = target_of(model, data, release)
    made, drawn = as_drawn(model)
    best = walk(model, made, drawn, target)
    rng = np.random.default_rng(0)
    for _ in range(OTHERS):
        if best[0] < WELL:
            break
        elsewhere = drawn
        for _ in range(4):
            motions = assemble.free_motions(made, elsewhere)
            kick = rng.uniform(-1.0, 1.0, motions.shape[-1])
            there = _closed(made, elsewhere, jnp.asarray(motions @ kick))
            if _is_placed(there):  # so far at once, a chain in space may not be closed again
                elsewhere = there
        found = walk(model, made, elsewhere, target)
        best = min(best, found, key=lambda f: f[0])
    rms, pose, motions = best
    if not np.isfinite(rms):
        raise ValueError(
            f"No pose to start from is found: the search from the drawn pose and {OTHERS} others was lost each time. "
            "Draw the mechanism nearer to the pose in which it is let go, or check the samples about the release."
        )
    seen, slope = (np.asarray(a) for a in look(model, pose, jnp.asarray(motions)))
    rates = _least(slope[target.column] / target.size[:, None], target.rate / target.size)
    turns = np.zeros(seen.size + len(model.topology.joint_ids))
    gap = target.value - seen[target.column]
    turns[target.column[target.angle]] = 2 * np.pi * np.round(gap[target.angle] / (2 * np.pi))
    return Found(pose, motions, np.zeros_like(rates) if release.at_rest else rates, turns, rms, target.worst(seen))


def target_of(model: Model, data: Measured, release: Release) -> Target:
    """What an experiment's first samples show of where it begins; ValueError where they show nothing of it."""
    joints, points = len(model.topology.joint_ids), 3 * len(model.marker_ids)
    posing = [i for i, c in enumerate(data.channels) if c.column < joints + points]
    if not posing:
        raise ValueError("Joint efforts alone do not say where the mechanism starts. Add tracks or joint_positions.")
    starts = []
    for i in posing:
        rows = data.of(i)
        series = data.time_s[rows], data.value[rows], data.sigma[rows], data.release_s
        starts.append(held_still(*series) if release.at_rest else moving(*series, release.window_s))
    column = np.array([data.channels[i].column for i in posing], int)
    turning = np.array([t != "prismatic" for t in model.topology.joint_types], bool)
    angle = np.array([c < joints and turning[c] for c in column], bool)
    size = np.where(angle, 1.0, model.scale.length_m)
    return Target(tuple(data.channels[i].at for i in posing), column, tuple(starts), angle, size)


def as_drawn(model: Model) -> tuple[System, Pose]:
    """The system, and the drawn pose with its loops closed, where searches begin; ValueError where they cannot be."""
    made, drawn = _drawn(model)
    if not _is_placed(drawn):
        raise ValueError("The drawn pose, from which the start is sought, cannot be closed: see linktwin check.")
    return made, drawn


@jax.jit
def _drawn(model):
    made = system(model)
    return made, assemble.closed(made, drawn_pose(model, made))


@jax.jit
def _closed(made, pose, moved):
    return assemble.closed(made, pose, moved)


def _is_placed(pose: Pose) -> bool:
    """Whether every body has a place and an attitude; bodies about one point keep the former without the latter."""
    return bool(np.isfinite(pose.position).all() and np.isfinite(pose.quaternion).all())


def walk(model: Model, made, pose: Pose, target: Target, steps: int = 60) -> tuple[float, Pose, np.ndarray]:
    """The rms miss where the walk from a pose ends (infinite: lost), the pose there and its free motions."""
    for _ in range(steps):
        motions = assemble.free_motions(made, pose)
        seen, slope = (np.asarray(a) for a in look(model, pose, jnp.asarray(motions)))
        if not (np.isfinite(seen[target.column]).all() and np.isfinite(slope[target.column]).all()):
            return np.inf, pose, motions
        miss = target.asked(target.miss(seen) / target.size)
        step = _least(target.asked(slope[target.column] / target.size[:, None]), miss)
        longest = np.abs(step).max(initial=0.0)
        if longest < 1e-10:
            break
        there = _closed(made, pose, jnp.asarray(motions @ (step * min(1.0, LONGEST / longest))))
        if not _is_placed(there):
            break
        pose = there
    return float(np.sqrt(np.mean(miss**2))), pose, motions


def _least(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.linalg.lstsq(A, b, rcond=1e-6)[0]
