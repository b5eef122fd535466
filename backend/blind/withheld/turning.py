"""Friction that falls with speed, at other hinges than the true one.

It has no slope where nothing is amiss, so that such rivals are not found to first order. Where a hinge always turns at
a fixed ratio to the true one, as in a scissor, the same friction there, as much smaller as it turns faster, does the
same but for how far bristles give, which nobody who looks at a motion knows; the kind alike at all hinges is fitted
where all turn so. Where it hardly shows, friction of one size may do as well, and is fitted too. Beside other dry
friction, which the excess at rest would raise with it, no such rival is named.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from backend.blind.withheld.causes import Cause, Rig, named, places
from backend.blind.withheld.detectability import ALIKE, Distance, Rival, Witness, projected, whitened
from backend.blind.withheld.laws import Change, Laws, changed
from backend.blind.withheld.motion import Stuck, move

KIND, PLAIN = "stribeck_friction", "coulomb_friction"
FIELDS = ("coulomb", "stribeck_excess", "stribeck_rate")
PROPORTIONAL = 1e-3  # of a hinge's largest rate, by which it may leave the ratio
UNSEEN = 0.3  # of what the data would show; beside a bar of another length ratios are not quite fixed
STEP = 0.02  # of the logarithm of a number
PLAINLY = 1e4  # d² of a truth that friction of one size is not fitted to: a twentieth of it is past what is alike


def with_other_hinges(
    far: Distance,
    witness: Witness,
    rig: Rig,
    truth: Cause,
    rest: Laws,
    clean: np.ndarray,
    record_of: Callable[[Laws], np.ndarray],
) -> Distance:
    """A truth's distance with the same friction at other hinges, and at all of them, among the rivals.

    rest: laws (one row) without the truth. clean: records with both. record_of: clean records of a row of laws.
    """
    if truth.kind != KIND or rest.has("coulomb", "rub", "bump"):
        return far
    (own,) = {change.index for change in truth.changes if change.index is not None}
    within = max(PROPORTIONAL, UNSEEN * float(np.sqrt(ALIKE / max(far.d2, ALIKE))))
    turns = ratios(witness, rig, changed(rest, truth.changes), own, within)
    torque, excess, rate = (next(abs(c.value) for c in truth.changes if c.field == field) for field in FIELDS)

    def left_by(numbers: Sequence[float], at: Sequence[int]) -> float:
        return _left_by(witness, rest, clean, record_of, numbers, at)

    found = _and(far, [(_rival(rig, KIND, (i,)), 0.0) for i in turns if i != own])
    hinges = places(rig.linkage, "hinge")
    all_turn = len(turns) == len(hinges) > 1
    if far.d2 < PLAINLY:
        left = left_by((torque * (1.0 + 0.5 * excess),), (own,))
        alike = [(i,) for i in turns] + ([tuple(hinges)] if all_turn else [])
        found = _and(found, [(_rival(rig, PLAIN, at), left) for at in alike])
    if not all_turn:
        return found
    ratio = np.array([turns[i] for i in hinges])
    left = left_by((torque / ratio.sum(), excess, rate * (ratio @ ratio) / ratio.sum()), hinges)
    return _and(found, [(_rival(rig, KIND, hinges), left)])


def _and(far: Distance, rivals: Sequence[tuple[Rival, float]]) -> Distance:
    """With these rivals and what each leaves."""
    more, left = [rival for rival, _ in rivals], [left for _, left in rivals]
    return Distance(far.d2, (*far.rivals, *more), (*far.remainders, *left))


def ratios(witness: Witness, rig: Rig, laws: Laws, own: int, within: float = PROPORTIONAL) -> dict[int, float]:
    """Of each hinge that turns at a fixed ratio to the true one, within this share of its largest rate, that ratio."""
    count = len(witness.starts)
    motion = move(rig.linkage, laws.repeated(count), witness.starts, witness.record.duration_s)
    n = motion.plant.n
    rates = motion.state[..., n : 2 * n] @ motion.plant.tree.turned.T
    true = rates[..., own].ravel()
    found = {}
    for i in places(rig.linkage, "hinge"):
        rate = rates[..., i].ravel()
        ratio = float(rate @ true / max(true @ true, 1e-300))
        if ratio and np.abs(rate - ratio * true).max() < within * np.abs(rate).max():
            found[i] = abs(ratio)
    return found


def _rival(rig: Rig, kind: str, hinges: Sequence[int]) -> Rival:
    """It names a place only where it stands at one."""
    at = [named(rig.linkage, "hinge", i) for i in hinges]
    places_ = at[0][1] if len(at) == 1 else ()
    return Rival(kind, tuple(id for on, _ in at for id in on), places_, (), False)


def _left_by(
    witness: Witness,
    rest: Laws,
    clean: np.ndarray,
    record_of: Callable[[Laws], np.ndarray],
    numbers: Sequence[float],
    hinges: Sequence[int],
) -> float:
    """d² that friction alike at these hinges leaves after one step of Gauss-Newton from these numbers: its torque and,
    where given, its excess at rest and its speed. A motion with crisp friction takes seconds.
    """
    _, along_start, _ = witness.slopes(rest, witness.starts, [])
    true = whitened(clean, witness.noise)

    def miss(logs: np.ndarray) -> np.ndarray:
        told = zip(FIELDS, np.exp(logs), strict=False)
        changes = [Change(field, i, value, sized=field == FIELDS[0]) for field, value in told for i in hinges]
        return projected(true - whitened(record_of(changed(rest, changes)), witness.noise), along_start)

    begin = np.log(np.asarray(numbers))
    left = np.inf
    try:
        r = miss(begin)
        if (left := float(r @ r)) < ALIKE:
            return left
        J = np.stack([miss(begin + STEP * e) - r for e in np.eye(begin.size)], 1) / STEP
        r = miss(begin - np.clip(np.linalg.lstsq(J, r, rcond=1e-12)[0], -1.0, 1.0))
        return min(left, float(r @ r))
    except Stuck:  # the true case is sound, whatever becomes of a rival
        return left
