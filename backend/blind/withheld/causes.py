"""What may be amiss: kinds that the file format names, each with its places, sizes and the numbers it changes.

Sizes are shares of the rig's own torque, rate, mass and length, so that a large rig and a small one are equally hard.
A size of 1 of a friction would hold the rig against its own weight.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from backend.blind.withheld.laws import Change
from backend.blind.withheld.linkage import GRAVITY, Linkage

Rng = np.random.Generator
AIR_KG_PER_M3 = 1.225  # ISO 2533
FAINT = 0.2  # of a kind's lowest telling size: what is drawn goes down to where it can just be seen
OF_ONE_MAKE = {"viscous_friction": True, "coulomb_friction": True, "pin_friction": False, "clearance": False,
              "linear_drag": True}  # fmt: skip
"""What may be alike at all hinges or links, and whether they share a single one's size among them, lest all together
hold the rig against its own weight.
"""
SHARE_OF_ONE_MAKE = 0.4  # of the draws of such a kind
STOP_DEPTH_RAD = 6e-3  # how far a blow with the rig's own energy enters a stop


@dataclass(frozen=True)
class Cause:
    """One thing amiss.  on, parameters: as gap.json would name it; places: where a finder may say it lies.

    parameters: only those whose meaning the file format fixes, so that an interval can be held against them.
    """

    kind: str
    on: tuple[str, ...]
    places: tuple[str, ...]
    parameters: Mapping[str, float]
    changes: tuple[Change, ...]


@dataclass(frozen=True)
class Rig:
    """The scales of a linkage, and what its ideal motion does: reach (joints, 2), starts (joints, 2) [rad or m]."""

    linkage: Linkage
    reach: np.ndarray
    starts: np.ndarray

    @property
    def mass(self) -> float:
        """Of everything that moves [kg]."""
        return sum(link.mass for link in self.linkage.links)

    @property
    def rate(self) -> float:
        """Of a pendulum of the rig's size [rad/s]."""
        return float(np.sqrt(GRAVITY / self.linkage.size))

    @property
    def torque(self) -> float:
        """A quarter of the weight at the rig's size [N m]."""
        return 0.25 * self.mass * GRAVITY * self.linkage.size

    def effort(self, j: int) -> float:
        """Torque, or the force that does as much at a slide [N m or N]."""
        return self.torque if self.turns(j) else self.torque / (0.5 * self.linkage.size)

    def stride(self, j: int) -> float:
        """A radian, or what a slide moves meanwhile [rad or m]."""
        return 1.0 if self.turns(j) else 0.5 * self.linkage.size

    def turns(self, j: int) -> bool:
        """Whether pin j is a hinge."""
        return self.linkage.pins[j].slide is None


Builder = Callable[[Rig, int, float, Rng], "tuple[Mapping[str, float], list[Change]] | None"]


@dataclass(frozen=True)
class Kind:
    """A kind of cause.  at: hinge, joint, link, bar, spring, marker, world or camera; low, high: of its size.

    build: parameters and changes for a rig, a place, a size (its sign included) and a generator of what else varies;
    None where the place does not suit.
    """

    name: str
    at: str
    low: float
    high: float
    build: Builder
    signed: bool = False
    known: bool = True


KINDS: dict[str, Kind] = {}


def kind(name: str, at: str, low: float, high: float, *, signed: bool = False, known: bool = True):
    """Enter a builder under its name."""

    def enter(build: Builder) -> Builder:
        KINDS[name] = Kind(name, at, low, high, build, signed, known)
        return build

    return enter


def places(linkage: Linkage, at: str) -> list[int]:
    """The indices a kind may stand at."""
    pins, links = linkage.pins, linkage.links
    match at:
        case "hinge":
            return [j for j, pin in enumerate(pins) if pin.slide is None]
        case "joint":
            return list(range(len(pins)))
        case "link":
            return list(range(len(links)))
        case "bar":
            return [k for k, link in enumerate(links) if link.straight]
        case "spring":
            return list(range(len(linkage.springs)))
        case "marker":
            return list(range(len(linkage.markers)))
    return [0]


def named(linkage: Linkage, at: str, i: int) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """`on` and the acceptable places of a cause at index i."""
    match at:
        case "hinge" | "joint":
            return (linkage.pins[i].id,), (f"joint:{linkage.pins[i].id}",)
        case "link" | "bar":
            return (linkage.links[i].id,), (f"body:{linkage.links[i].id}",)
        case "spring":
            return (linkage.springs[i].id,), (f"effect:{linkage.springs[i].id}",)
        case "marker":
            id = linkage.markers[i][0]
            return (id,), (f"marker:{id}",)
    return (at,), (at,)


def cause(rig: Rig, name: str, i: int, size: float, rng: Rng) -> Cause | None:
    """A cause of a given size; None where the place does not suit."""
    made = KINDS[name].build(rig, i, size, rng)
    if made is None:
        return None
    on, where = named(rig.linkage, KINDS[name].at, i)
    parameters, changes = made
    return Cause(name, on, where, dict(parameters), tuple(changes))


def cause_everywhere(rig: Rig, name: str, size: float, rng: Rng) -> Cause | None:
    """A cause that is alike at all hinges or links of a rig; None where it has but one."""
    k = KINDS[name]
    at = [i for i in places(rig.linkage, k.at) if k.at != "joint" or rig.turns(i)]
    each = size / len(at) if OF_ONE_MAKE[name] and at else size
    made = [one for i in at if (one := cause(rig, name, i, each, rng))]
    if len(made) < 2:
        return None
    on, where = (tuple(id for one in made for id in ids(one)) for ids in (lambda c: c.on, lambda c: c.places))
    return Cause(name, on, where, made[0].parameters, tuple(change for one in made for change in one.changes))


def scaled(one: Cause, share: float) -> Cause:
    """The same cause, weaker or stronger."""
    changes = tuple(replace(c, value=c.value * share) if c.sized else c for c in one.changes)
    return replace(one, parameters={k: v * share for k, v in one.parameters.items()}, changes=changes)


def drawn_cause(rig: Rig, name: str, rng: Rng) -> Cause | None:
    """A cause of a kind at a random place, or at all of them, with a log-uniform size; None where the rig has no place
    for it.
    """
    k = KINDS[name]
    at = places(rig.linkage, k.at)
    if name in OF_ONE_MAKE and rng.random() < SHARE_OF_ONE_MAKE:
        size = float(np.exp(rng.uniform(np.log(k.low * FAINT), np.log(k.high))))
        if made := cause_everywhere(rig, name, size, rng):
            return made
    for i in rng.permutation(at) if at else ():
        size = float(np.exp(rng.uniform(np.log(k.low * FAINT), np.log(k.high))))
        size *= float(rng.choice([-1, 1])) if k.signed else 1.0
        if made := cause(rig, name, int(i), size, rng):
            return made
    return None
