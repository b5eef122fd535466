"""Friction that falls with speed, at other hinges than the true one.

It has no slope where nothing is amiss, so that such rivals are not found to first order. Where a hinge always turns at
a fixed ratio to the true one, as in a scissor, the same friction there, as much smaller as it turns faster, does the
same but for how far bristles give, which nobody who looks at a motion knows; the kind alike at all hinges is fitted
where all turn so. Beside other dry friction, which the excess at rest would raise with it, no such rival is named.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from backend.blind.withheld.causes import Cause, Rig, named, places
from backend.blind.withheld.detectability import ALIKE, Distance, Rival, Witness, projected, whitened
from backend.blind.withheld.laws import Change, Laws, changed
from backend.blind.withheld.motion import Stuck, move

KIND = "stribeck_friction"
PROPORTIONAL = 1e-3  # of a hinge's largest rate, by which it may leave the ratio
UNSEEN = 0.3  # of what the data would show; beside a bar of another length ratios are not quite fixed
STEP = 0.02  # of the logarithm of a number


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
    same = [_rival(rig, (i,)) for i in turns if i != own]
    found = Distance(far.d2, (*far.rivals, *same), (*far.remainders, *(0.0 for _ in same)))
    hinges = places(rig.linkage, "hinge")
    if len(hinges) < 2 or len(turns) < len(hinges):
        return found
    left = _left_by_all(witness, truth, rest, clean, record_of, np.array([turns[i] for i in hinges]), hinges)
    return Distance(found.d2, (*found.rivals, _rival(rig, hinges)), (*found.remainders, left))


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


def _rival(rig: Rig, hinges: Sequence[int]) -> Rival:
    """It names a place only where it stands at one."""
    at = [named(rig.linkage, "hinge", i) for i in hinges]
    places_ = at[0][1] if len(at) == 1 else ()
    return Rival(KIND, tuple(id for on, _ in at for id in on), places_, (), False)


def _left_by_all(
    witness: Witness,
    truth: Cause,
    rest: Laws,
    clean: np.ndarray,
    record_of: Callable[[Laws], np.ndarray],
    turns: np.ndarray,
    hinges: Sequence[int],
) -> float:
    """d² that the kind leaves alike at all hinges, its torque, its excess at rest and its speed after one step of
    Gauss-Newton: a motion with crisp friction takes seconds.
    """
    _, along_start, _ = witness.slopes(rest, witness.starts, [])
    true = whitened(clean, witness.noise)
    fields = ("coulomb", "stribeck_excess", "stribeck_rate")
    torque, excess, rate = (next(c.value for c in truth.changes if c.field == field) for field in fields)

    def miss(logs: np.ndarray) -> np.ndarray:
        numbers = zip(fields, np.exp(logs), strict=True)
        changes = [Change(field, i, value, sized=field == "coulomb") for field, value in numbers for i in hinges]
        return projected(true - whitened(record_of(changed(rest, changes)), witness.noise), along_start)

    begin = np.log(np.abs([torque / turns.sum(), excess, rate * (turns @ turns) / turns.sum()]))
    left = np.inf
    try:
        r = miss(begin)
        if (left := float(r @ r)) < ALIKE:
            return left
        J = np.stack([miss(begin + STEP * e) - r for e in np.eye(3)], 1) / STEP
        r = miss(begin - np.clip(np.linalg.lstsq(J, r, rcond=1e-12)[0], -1.0, 1.0))
        return min(left, float(r @ r))
    except Stuck:  # the true case is sound, whatever becomes of a rival
        return left
