"""The numbers that make a reality differ from its drawing; zero where nothing is amiss.

A cause is a handful of changes to these numbers, so every combination of causes is one more set of numbers, and many
sets move through one integration as the rows of a batch.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from backend.blind.withheld.linkage import Linkage

PER_JOINT = (
    *("viscous", "coulomb", "rub", "stribeck_excess", "stribeck_rate", "stiffness", "offset", "rotor"),
    *("play", "lower", "upper", "stop_stiffness", "bump", "bump_at", "bump_width", "cog", "cog_count", "cog_phase"),
    *("yielding", "yield_width", "wire", "wire_from", "one_way", "kick", "kick_at"),
)
PER_LINK = ("heavier", "inertia", "stretch", "drag", "slow", "slosh", "slosh_rate")
PER_LINK_PLANE = ("centre",)
PER_SPRING = ("stiffer", "preload", "damping")
PER_MARKER = ("wobble", "wobble_hz", "wobble_phase")
PER_MARKER_PLANE = ("shifted", "drift")
ONCE = (
    *("tilt", "delay", "release_rate", "gust_at", "gust_width", "sway_hz", "sway_phase"),
    *("scale", "turn", "pitch", "yaw", "k1", "frame_rate", "time_offset", "readout"),
)
ONCE_PLANE = ("gust", "sway")
UNBOUNDED = {"lower": -np.inf, "upper": np.inf}


@dataclass(frozen=True)
class Change:
    """One number of one joint, link, spring or marker (None: of the whole) that is `value` larger than drawn.

    Complex where the number is a vector of the plane.  sized: whether it shrinks as the cause does.
    """

    field: str
    index: int | None
    value: complex | float
    sized: bool = True


@dataclass(frozen=True)
class Laws:
    """Numbers by name, each (rows, joints), (rows, links), (rows, springs), (rows, markers) or (rows,); SI.

    joints: viscous [N m s/rad], coulomb [N m], rub: pin friction's torque over the reaction [m], stribeck_excess over
    coulomb - 1, stribeck_rate [rad/s], stiffness [N m/rad] about the drawn pose, offset [N m], rotor [kg m²],
    play: radial [m], lower and upper stops [rad], stop_stiffness [N m/rad^1.5]; at a slide N and m take the place of
    N m and rad.
    links: heavier, inertia, stretch: relative; centre [m, link axes]; drag: half density x drag coefficient x width
    [N s²/m³], slow [N s/m].  springs: stiffer (relative), preload [N], damping [N s/m].  markers: shifted [m, link
    axes], drift [m/s].
    whole: tilt of the rig about world y [rad], delay [s], release_rate of the first joint [rad/s]; the camera's
    scale, turn [rad], pitch and yaw [rad], k1 [1/m²]; frame_rate (relative), time_offset [s], readout [s].
    What no library has: see causes.py.
    """

    numbers: dict[str, np.ndarray]

    def __getattr__(self, name: str) -> np.ndarray:
        try:
            return self.__dict__["numbers"][name]
        except KeyError:
            raise AttributeError(name) from None

    @property
    def rows(self) -> int:
        """How many realities."""
        return len(self.numbers["tilt"])

    def has(self, *names: str) -> bool:
        """Whether any row differs from nothing in any of these numbers."""
        return not self._amiss.isdisjoint(names)

    @cached_property
    def _amiss(self) -> frozenset[str]:
        return frozenset(n for n, v in self.numbers.items() if np.any(v != UNBOUNDED.get(n, 0.0)))

    def repeated(self, rows: int) -> Laws:
        """Every row `rows` times over, one after another."""
        return replace(self, numbers={n: np.repeat(v, rows, 0) for n, v in self.numbers.items()})


def as_drawn(linkage: Linkage, rows: int = 1) -> Laws:
    """A reality that is what was drawn."""
    counts = {
        **{n: (len(linkage.pins),) for n in PER_JOINT},
        **{n: (len(linkage.links),) for n in PER_LINK + PER_LINK_PLANE},
        **{n: (len(linkage.springs),) for n in PER_SPRING},
        **{n: (len(linkage.markers),) for n in PER_MARKER + PER_MARKER_PLANE},
        **{n: () for n in ONCE + ONCE_PLANE},
    }
    plane = {*PER_LINK_PLANE, *PER_MARKER_PLANE, *ONCE_PLANE}
    return Laws(
        {
            n: np.full((rows, *shape), UNBOUNDED.get(n, 0.0), dtype=complex if n in plane else float)
            for n, shape in counts.items()
        }
    )


def changed(laws: Laws, changes: Iterable[Change], size: float = 1.0) -> Laws:
    """Every row with the changes made, `size` times as large as stated; nothing at size 0."""
    numbers = dict(laws.numbers)
    for change in changes if size else ():
        value = numbers[change.field].copy()
        at = value[:, change.index] if change.index is not None else value
        old = at.copy()
        new = change.value * (size if change.sized else 1.0)
        at[...] = new if change.field in UNBOUNDED or not change.sized else old + new
        numbers[change.field] = value
    return Laws(numbers)


def stacked(many: Sequence[Laws]) -> Laws:
    """All rows of all of them."""
    return Laws({n: np.concatenate([laws.numbers[n] for laws in many]) for n in many[0].numbers})
