"""Which slip of a table would explain where an experiment begins: tried one by one on what was seen at the release.

Names of two markers exchanged, one channel with another zero, sign or unit, an origin that lies elsewhere, another axis
that points up: each leaves a table that can be read, and no pose of the drawing that explains it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import combinations, permutations, product

import jax.numpy as jnp
import numpy as np

from backend.fit.pose import Target, as_drawn, walk
from backend.fit.prediction import look
from backend.mechanism.tracks import PLACES
from backend.model.model import Model
from backend.model.state import Pose

STEPS = 25  # of a walk under the right assumption; a wrong one would wander on
MOST_MARKERS = 10  # whose names are exchanged in pairs: forty-five walks
MOST_PLACES = 20
BETTER = 3.0  # times as near as the next
ASIDE = 0.02  # of a shift: the coordinates in which it shows
UNITS = {1000.0: "mm", 100.0: "cm"}


@dataclass(frozen=True)
class Assumption:
    """What would be otherwise in a table, what would then have been seen, and how it is said once that explains all."""

    target: Target
    said: Callable[[np.ndarray], str]


class Slips:
    """Assumptions about what was seen at one release.

    off: how far the farthest marker or joint is off what is seen of a pose, in shares of what counts as far.
    """

    def __init__(self, model: Model, target: Target, found: Pose, off: Callable[[Target, np.ndarray], float]):
        self.model, self.target, self.off = model, target, off
        self.made, drawn = as_drawn(model)
        self.begins = (drawn, found)
        self.joints = len(model.topology.joint_ids)

    def likely(self) -> str | None:
        """The slip that explains all, and far better than others of its make do; None where there is none.  Of several
        turns of the world the smallest counts: a mechanism may turn with it.
        """
        for make in (self._one_alone, self._exchanged, self._shifted):
            told = sorted(found for each in make() if (found := self._explains(each)))
            if told and (len(told) == 1 or BETTER * told[0][0] < told[1][0]):
                return told[0][1]
        return next((found[1] for each in self._turned() if (found := self._explains(each))), None)

    def _explains(self, assumed: Assumption) -> tuple[float, str] | None:
        """How far the farthest is off under an assumption, and how that is said; None where it is far."""
        target = assumed.target
        for begin in self.begins:
            _, pose, motions = walk(self.model, self.made, begin, target, STEPS)
            seen, slope = (np.asarray(a) for a in look(self.model, pose, jnp.asarray(motions)))
            # What can follow anything explains nothing.
            loose = 0 if target.loose is None else target.loose.shape[1]
            told = np.linalg.matrix_rank(target.asked(slope[target.column]), tol=1e-6) + loose < target.column.size
            if np.isfinite(seen).all() and told and (off := self.off(target, seen)) < 1.0:
                return off, assumed.said(seen)
        return None

    @property
    def _markers(self) -> list[str]:
        return [at for at in dict.fromkeys(self.target.at) if at.startswith("marker:")]

    def _one_alone(self) -> Iterator[Assumption]:
        places = list(dict.fromkeys(self.target.at))
        if 2 < len(places) <= MOST_PLACES:
            for at in places:
                yield Assumption(self.target.without(at), lambda seen, at=at: self._alone(at, seen))

    def _alone(self, at: str, seen: np.ndarray) -> str:
        what, _, id = at.partition(":")
        its = [i for i, place in enumerate(self.target.at) if place == at]
        value, told = self.target.value[its], seen[self.target.column[its]]
        if what == "marker":
            apart = 1e3 * float(np.linalg.norm(value - told))
            return (
                f'All but marker "{id}" are explained, which is seen {apart:.3g} mm from where they put it: check its '
                "name, its body and position_m, and that it was tracked"
            )
        (reads,), (put,) = value, told
        unit = "rad" if self.target.angle[its[0]] else "m"
        return f'All but joint "{id}" are explained: {_against(reads, put, unit)}'

    def _exchanged(self) -> Iterator[Assumption]:
        if not 2 <= len(markers := self._markers) <= MOST_MARKERS:
            return
        at = np.array(self.target.at)
        for one, other in combinations(markers, 2):
            if self._axes(one) == self._axes(other):
                order = np.arange(at.size)
                order[at == one], order[at == other] = np.flatnonzero(at == other), np.flatnonzero(at == one)
                start = tuple(self.target.start[i] for i in order)
                names = [f'"{marker.partition(":")[2]}"' for marker in (one, other)]
                yield Assumption(
                    replace(self.target, start=start),
                    lambda seen, names=names: (
                        f"With {names[0]} and {names[1]} in each other's place all are explained: check their names"
                    ),
                )

    def _shifted(self) -> Iterator[Assumption]:
        axes = [self._axis(i) for i in range(len(self.target.at))]
        directions = [[float(axis == each) for axis in axes] for each in sorted({a for a in axes if a is not None})]
        if len(self._markers) > 1:
            loose = np.array(directions).T

            def said(seen: np.ndarray) -> str:
                aside = np.linalg.lstsq(loose, self.target.miss(seen))[0]
                shift = ", ".join(
                    f"{1e3 * by:+.4g} mm in {PLACES[axis]}"
                    for axis, by in zip(sorted({a for a in axes if a is not None}), aside, strict=True)
                    if abs(by) > ASIDE * np.max(np.abs(aside))
                )
                return (
                    f"All are explained but for one shift ({shift}): check where the origin of the tracks lies in the "
                    "drawing's world"
                )

            yield Assumption(replace(self.target, loose=loose), said)

    def _turned(self) -> Iterator[Assumption]:
        """Quarter turns of the world; those that would need a coordinate that was not measured are left out."""
        at = {(place, self._axis(i)): i for i, place in enumerate(self.target.at)}
        ways = product(permutations(range(3)), product((1.0, -1.0), repeat=3))
        turns = [(order, signs, np.eye(3)[list(order)] * np.array(signs)[:, None]) for order, signs in ways]
        for order, signs, turn in sorted(turns, key=lambda way: -np.trace(way[2])):
            if np.linalg.det(turn) < 0.0 or np.array_equal(turn, np.eye(3)):
                continue
            if any((place, order[axis]) not in at for place, axis in at if axis is not None):
                continue
            start = list(self.target.start)
            for (place, axis), i in at.items():
                if axis is not None:
                    source = self.target.start[at[place, order[axis]]]
                    start[i] = replace(source, value=signs[axis] * source.value, rate=signs[axis] * source.rate)
            axes = sorted({axis for _, axis in at if axis is not None})
            columns = ", ".join(f"{'-' if signs[a] < 0 else ''}{PLACES[order[a]]}" for a in axes)
            columns += f" for {', '.join(PLACES[a] for a in axes)}"
            yield Assumption(
                replace(self.target, start=tuple(start)),
                lambda seen, columns=columns: (
                    f"With {columns} all are explained: the tracks have other axes than the drawing's world"
                ),
            )

    def _axes(self, marker: str) -> list[int | None]:
        """Which coordinates of a marker were measured, in the order of the channels."""
        return [self._axis(i) for i, place in enumerate(self.target.at) if place == marker]

    def _axis(self, i: int) -> int | None:
        """Of a marker's channel: along which axis of W; None of a joint's."""
        column = int(self.target.column[i]) - self.joints
        return column % 3 if column >= 0 else None


def _against(reads: float, put: float, unit: str) -> str:
    """What an encoder reads, where the others put its joint, and what that looks like."""
    said = f"it reads {reads:.4g} {unit} where the others put it at {put:.4g} {unit}"
    ratio = reads / put if put else 0.0
    if unit == "m":
        for size, name in UNITS.items():
            if abs(abs(ratio) / size - 1.0) < 0.1:
                return f"{said}; q is in m: divide {name} by {size:.4g}"
    if abs(ratio + 1.0) < 0.1:
        return f"{said}; check its sign, which the joint's axis gives"
    return f"{said}; check its zero, which is the drawn pose, its sign and its unit"
