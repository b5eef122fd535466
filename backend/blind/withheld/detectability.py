"""How visible a cause is, and which other known causes would have left the same record.

d² is the squared distance, in standard deviations of the noise, of the records with and without the cause, once the
start poses have been free to absorb what they can.  A rival stays in the truth's class while its best fit leaves a
d² below 9: no method could tell the two apart from these data.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from backend.blind.withheld.causes import KINDS, Cause, Rig, named, places
from backend.blind.withheld.laws import Change, Laws, as_drawn, changed, stacked
from backend.blind.withheld.linkage import Linkage
from backend.blind.withheld.measurement import Noise, seen
from backend.blind.withheld.motion import Motion, Stuck, move
from backend.blind.withheld.plant import Plant

ALIKE = 9.0
NEAR = 0.1  # of d²: a rival whose first-order remainder is larger is not worth a fit
FITTED = 2  # rivals that are fitted, at most
ROUNDS = 3
TANGENT = 1e-4  # of the truth: a step along its own way
# Rivals wherever the truth lies: a hinge at the ground and the link it carries name the same friction or inertia.
EVERYWHERE = (
    "viscous_friction", "coulomb_friction", "effort_offset", "linear_drag", "rotor_inertia", "inertia_error",
    "torsion_spring",
)  # fmt: skip
IN_A_PICTURE = ("marker", "bar")  # what is off by places may be off in a camera: rivals of what is amiss with one
PLANAR = {"center_of_mass_error": "centre", "marker_offset": "shifted", "tracker_drift": "drift"}
# No slope at zero, or more numbers than a rival of one kind should be allowed.
WITHOUT_SLOPE = ("joint_stop", "clearance", "base_motion", "stribeck_friction")
SMALL = 1e-4  # of a kind's lowest telling size: a step along its direction; 1e-3 bends by more than d2 of 4e6 forgives
START_STEP = 1e-4  # rad or m
TOLERANCE = 1e-6  # neighbouring rows take the same steps, so their differences are far more exact
SEEN_ONLY = frozenset(
    ("scale", "turn", "pitch", "yaw", "k1", "frame_rate", "time_offset", "readout", "delay", "shifted", "drift")
)


@dataclass(frozen=True)
class Record:
    """When a camera looked, the same in every experiment: stated times since release and since the beginning [s]."""

    since_release_s: np.ndarray
    elapsed_s: np.ndarray

    @property
    def duration_s(self) -> float:
        """How long a motion must last to fill it, with room for the clock's errors."""
        return float(self.since_release_s[-1] * 1.1 + 0.15)

    def rows(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Both, for so many experiments."""
        return tuple(np.broadcast_to(t, (count, len(t))) for t in (self.since_release_s, self.elapsed_s))  # type: ignore[return-value]


@dataclass(frozen=True)
class Rival:
    """A known cause that might explain a record: its directions, each a set of changes; whether it has two signs."""

    kind: str
    on: tuple[str, ...]
    places: tuple[str, ...]
    directions: tuple[tuple[Change, ...], ...]
    signed: bool


def whitened(clean: np.ndarray, noise: Noise) -> np.ndarray:
    """Complex places (rows, times, markers) as (rows, samples) of unit noise: the first-order correlation undone."""
    first = clean[:, :1] / noise.sigma_m
    later = (clean[:, 1:] - noise.rho * clean[:, :-1]) / (noise.sigma_m * np.sqrt(1 - noise.rho**2))
    flat = np.concatenate([first, later], 1).reshape(len(clean), -1)
    return np.concatenate([flat.real, flat.imag], 1)


def rivals_of(rig: Rig, truth: Sequence[Cause], left_out: Sequence[str] = ()) -> list[Rival]:
    """Known causes that share the truth's kind or its place, act on the links of its joint or the joints of its link,
    or concern the whole, and of a camera all marks and lengths; those that may stand anywhere also at all such places
    at once.  All of them of no truth.
    """
    linkage = rig.linkage
    kinds = {cause.kind for cause in truth}
    near = {place for cause in truth for place in _around(linkage, cause)}
    pictured = "camera" in near
    found = []
    for name, k in KINDS.items():
        if not k.known or name in WITHOUT_SLOPE or name in left_out:
            continue
        for i in places(linkage, k.at):
            on, where = named(linkage, k.at, i)
            close = name in kinds or bool(near & set(where)) or name in EVERYWHERE
            close = close or (pictured and k.at in IN_A_PICTURE)
            if close or not truth or k.at in ("world", "camera", "spring"):
                found.append(Rival(name, on, where, _directions(rig, name, i, own=name in kinds), k.signed))
        if name in EVERYWHERE and truth:
            found += _together(rig, name)
    return found


def _around(linkage: Linkage, cause: Cause) -> set[str]:
    """Its places; beside a joint the links that it joins, whose length a loose pin is; beside a link its joints."""
    around = set(cause.places)
    for j, pin in enumerate(linkage.pins):
        (joint,) = named(linkage, "joint", j)[1]
        links = {place for body in (pin.a, pin.b) if body for place in named(linkage, "link", body - 1)[1]}
        if joint in cause.places:
            around |= links
        elif links & set(cause.places):
            around.add(joint)
    return around


def _together(rig: Rig, name: str) -> list[Rival]:
    """The kind alike at all its hinges, slides or links; it names no place, so that none is right for its sake."""
    k, groups = KINDS[name], dict[bool, list[int]]()
    for i in places(rig.linkage, k.at):
        groups.setdefault(k.at == "joint" and not rig.turns(i), []).append(i)
    found = []
    for group in groups.values():
        if len(group) > 1:
            on = tuple(id for i in group for id in named(rig.linkage, k.at, i)[0])
            ways = [_directions(rig, name, i) for i in group]
            changes = tuple(change for (way,) in ways for change in way)
            found.append(Rival(name, on, (), (changes,), k.signed))
    return found


def _directions(rig: Rig, name: str, i: int, own: bool = False) -> tuple[tuple[Change, ...], ...]:
    """Small changes, one set per number that the cause leaves free. own: of the truth's kind, whose spring may rest
    anywhere, as the truth's does; any other would be an offset with it.
    """
    if name in PLANAR:
        step = 1e-4 * rig.linkage.size
        return tuple((Change(PLANAR[name], i, step * way),) for way in (1 + 0j, 1j))
    if name == "camera_tilt":
        return (Change("pitch", None, 1e-4),), (Change("yaw", None, 1e-4),)
    k = KINDS[name]
    made = k.build(rig, i, SMALL * k.low, np.random.default_rng(0))
    changes = made[1] if made else []
    if own and name == "torsion_spring":
        return tuple((change,) for change in changes)
    return (tuple(changes[:1]),)


class Witness:
    """The drawn linkage, seen by the same camera from the same starts (experiments, movers)."""

    def __init__(self, linkage: Linkage, starts: np.ndarray, record: Record, noise: Noise):
        self.linkage, self.starts, self.record, self.noise = linkage, starts, record, noise

    def slopes(
        self, laws: Laws, starts: np.ndarray, directions: Sequence[tuple[Change, ...]]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Around one row of laws and the starts: the record (experiments, samples), its slopes along the starts
        (experiments, samples, movers) and along the directions (experiments, samples, directions).
        """
        count, movers = starts.shape
        seen_only = [all(change.field in SEEN_ONLY for change in way) for way in directions]
        moving = [changed(laws, way) for way, only in zip(directions, seen_only, strict=True) if not only]
        begins = [starts, *(starts + START_STEP * e for e in np.eye(movers)), *([starts] * len(moving))]
        rows = stacked([laws] * (1 + movers) + moving).repeated(count)
        motion = move(self.linkage, rows, np.concatenate(begins), self.record.duration_s, tolerance=TOLERANCE)
        shown = self._shown(motion, rows).reshape(len(begins), count, -1)
        along = list(shown[1 + movers :])
        # What only the camera and its clock do needs no motion of its own.
        first = [i for i, only in enumerate(seen_only) if only]
        if first:
            rows = stacked([changed(laws, directions[i]) for i in first]).repeated(count)
            state = np.tile(motion.state[:count], (len(first), 1, 1))
            again = Motion(Plant(self.linkage, rows), motion.time_s, state)
            for i, one in zip(first, self._shown(again, rows).reshape(len(first), count, -1), strict=True):
                along.insert(i, one)
        base = shown[0]
        along_start = (shown[1 : 1 + movers] - base) / START_STEP
        along = np.array(along).reshape(len(directions), *base.shape) - base
        return base, np.moveaxis(along_start, 0, -1), np.moveaxis(along, 0, -1)

    def _shown(self, motion: Motion, laws: Laws) -> np.ndarray:
        return whitened(seen(motion, laws, self.linkage.size, *self.record.rows(laws.rows)), self.noise)


def projected(signal: np.ndarray, along_start: np.ndarray) -> np.ndarray:
    """What the start poses cannot absorb of a signal (experiments, samples, ...), flat over experiments."""
    out = []
    for one, J in zip(signal, along_start, strict=True):
        Q, _ = np.linalg.qr(J)
        out.append(one - Q @ (Q.T @ one))
    return np.concatenate(out)


@dataclass(frozen=True)
class Distance:
    """d2 of the truth from nothing; remainders: what each rival leaves of it at its best, rivals in their order."""

    d2: float
    rivals: tuple[Rival, ...]
    remainders: tuple[float, ...]

    @property
    def alike(self) -> list[Rival]:
        """The rivals that these data cannot tell from the truth."""
        return [rival for rival, left in zip(self.rivals, self.remainders, strict=True) if left < ALIKE]


def distance(
    witness: Witness,
    clean: np.ndarray,
    rivals: Sequence[Rival],
    beside: tuple[Laws, np.ndarray] | None = None,
) -> Distance:
    """How far a clean record (experiments, times, markers) is from the drawing's, and from each rival's best.

    beside: laws (one row) and record of all else that is amiss, where one of several causes is in question; its
    rivals are then held to first order.
    """
    laws = beside[0] if beside else as_drawn(witness.linkage)
    ways = [way for rival in rivals for way in rival.directions]
    base, along_start, along = witness.slopes(laws, witness.starts, ways)
    true = whitened(clean, witness.noise)
    # Beside other causes both records have crisp friction, which the slopes' smooth one must not be held against.
    difference = projected(true - (whitened(beside[1], witness.noise) if beside else base), along_start)
    d2 = float(difference @ difference)
    signatures = projected(along, along_start) if ways else np.zeros((len(difference), 0))
    left, found, k = [], [], 0
    for rival in rivals:
        S = signatures[:, k : k + len(rival.directions)]
        k += len(rival.directions)
        a, *_ = np.linalg.lstsq(S, difference, rcond=1e-12)
        wrong_sign = not rival.signed and len(a) == 1 and a[0] < 0
        left.append(d2 if wrong_sign else float(np.sum((difference - S @ a) ** 2)))
        found.append(a)
    for i in np.argsort(left)[: 0 if beside else FITTED]:
        if ALIKE < left[i] < NEAR * d2:
            left[i] = min(left[i], _fitted(witness, true, rivals[i], found[i]))
    return Distance(d2, tuple(rivals), tuple(left))


def confusion(
    witness: Witness, truth: Cause, rivals: Sequence[Rival], rest: Laws, d2: float, others: Sequence[Cause] = ()
) -> Distance:
    """What each rival leaves of a truth that has a slope and is d2 from nothing, beside the rest of what is amiss.

    d2 (1 - C²), C the cosine of the truth's own slope with the rival's after the start poses took their share, where
    nothing is amiss yet and where the whole truth is: a rival must go the truth's way at both ends.  others: of the
    rest, causes whose size nobody knows either; a rival may have them as much larger or smaller as suits it.
    """
    beside = [_slight(other) for other in others if other.kind not in WITHOUT_SLOPE]
    ways = [_slight(truth), *beside, *(way for rival in rivals for way in rival.directions)]
    left = np.zeros(len(rivals))
    for laws in (rest, changed(rest, truth.changes)):
        _, along_start, along = witness.slopes(laws, witness.starts, ways)
        slopes = projected(along, along_start)
        slope, k = slopes[:, 0], 1 + len(beside)
        resized = slopes[:, 1:k]
        for i, rival in enumerate(rivals):
            S = np.concatenate([slopes[:, k : k + len(rival.directions)], resized], 1)
            k += len(rival.directions)
            a, *_ = np.linalg.lstsq(S, slope, rcond=1e-12)
            wrong_sign = not rival.signed and len(rival.directions) == 1 and a[0] < 0
            share = 1.0 if wrong_sign else np.sum((slope - S @ a) ** 2) / max(slope @ slope, 1e-300)
            left[i] = max(left[i], d2 * share)
    return Distance(d2, tuple(rivals), tuple(map(float, left)))


def _fitted(witness: Witness, true: np.ndarray, rival: Rival, a: np.ndarray) -> float:
    """The remainder at the rival's best fit by Gauss-Newton, starts included; infinite where it loses its way."""
    starts, best = witness.starts.copy(), np.inf
    for _ in range(ROUNDS):
        laws = as_drawn(witness.linkage)
        for share, way in zip(a, rival.directions, strict=True):
            laws = changed(laws, [_times(c, share) for c in way])
        try:
            base, along_start, along = witness.slopes(laws, starts, rival.directions)
        except Stuck:
            return best
        r, S = projected(true - base, along_start), projected(along, along_start)
        best = min(best, float(r @ r))
        step, *_ = np.linalg.lstsq(S, r, rcond=1e-12)
        a = a + step
        for e, J in enumerate(along_start):
            rest = true[e] - base[e] - along[e] @ step
            starts[e] = starts[e] + np.linalg.lstsq(J, rest, rcond=1e-12)[0]
        best = min(best, float(np.sum((r - S @ step) ** 2)) if np.all(np.abs(step) < 0.05 * np.abs(a) + 1e-9) else best)
        if not rival.signed and len(a) == 1 and a[0] < 0:
            return best
    return best


def _slight(cause: Cause) -> tuple[Change, ...]:
    """A little more of it."""
    return tuple(_times(change, TANGENT) if change.sized else change for change in cause.changes)


def _times(change: Change, share: float) -> Change:
    return Change(change.field, change.index, change.value * share, change.sized)
