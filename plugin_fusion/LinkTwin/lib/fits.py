"""How a pin sits in its hole, from the cylindrical faces of the two parts about a joint's axis."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from .placement import Placement, Vector, cross, dot, length, minus, unit

FULL_TURN = math.radians(300.0)  # a hole with a keyway is still a hole, a fillet or a slot's end is none
TILT = math.sin(math.radians(0.5))
SAME_CM = 1e-4  # 1 µm
LOOSEST = 0.2  # of the pin's radius: more play than this is a pin passing through a window


@dataclass(frozen=True)
class Cylinder:
    """A pin or hole: a point on its axis, the axis, and how far it reaches from the point [cm]."""

    sense: str
    radius: float
    point: Vector
    axis: Vector
    low: float
    high: float
    sweep: float = 0.0

    def seen_from(self, X_AB: Placement) -> Cylinder:
        """The same cylinder, given in B, in A."""
        return replace(self, point=X_AB.point(self.point), axis=X_AB.direction(self.axis))


def cylinders(faces: Sequence[Mapping]) -> list[Cylinder]:
    """The pins and holes among the cylindrical faces of a component, split faces put together."""
    kept: list[Cylinder] = []
    for face in faces:
        span = face["high_cm"] - face["low_cm"]
        if face["sense"] not in ("pin", "hole") or not (span > 0.0 and face["radius_cm"] > 0.0):
            continue
        sweep = face["area_cm2"] / (face["radius_cm"] * span)
        new = Cylinder(
            face["sense"],
            face["radius_cm"],
            tuple(face["origin_cm"]),
            unit(face["axis"]),
            face["low_cm"],
            face["high_cm"],
            sweep,
        )
        for at, old in enumerate(kept):
            if _same(old, new):
                kept[at] = replace(old, sweep=old.sweep + sweep)
                break
        else:
            kept.append(new)
    return [cylinder for cylinder in kept if cylinder.sweep >= FULL_TURN]


def fit(a: Sequence[Cylinder], b: Sequence[Cylinder], anchor: Vector, axis: Vector) -> dict | None:
    """The `fit` block of a joint whose parts have these cylinders, all in one frame; None where no pair fits.

    Of the pairs of a pin on one part and a hole on the other about the axis, the tightest counts, over the length
    that it bears in all its holes.
    """
    pairs = []
    for pins, holes in ((a, b), (b, a)):
        for pin in pins:
            for hole in holes:
                if pin.sense == "pin" and hole.sense == "hole" and _bears(pin, hole, anchor, axis):
                    pairs.append((hole.radius - pin.radius, pin.radius, hole.radius, _overlap(pin, hole, anchor, axis)))
    if not pairs:
        return None
    clearance, pin, hole, _ = min(pairs)
    bearing = math.fsum(
        pair[3] for pair in pairs if abs(pair[0] - clearance) < SAME_CM and abs(pair[1] - pin) < SAME_CM
    )
    lengths = {
        "pin_diameter_m": 2.0 * pin,
        "hole_diameter_m": 2.0 * hole,
        "bearing_length_m": bearing,
        "radial_clearance_m": clearance,
    }
    # To the picometre: 0.405 - 0.4 is 0.0050000000000000044.
    return {**{name: round(value * 1e-2, 12) for name, value in lengths.items()}, "source": "drawn"}


def _same(a: Cylinder, b: Cylinder) -> bool:
    return (
        a.sense == b.sense
        and abs(a.radius - b.radius) < SAME_CM
        and length(cross(a.axis, b.axis)) < SAME_CM
        and _off_axis(b.point, a.point, a.axis) < SAME_CM
        and all(abs(x - y) < SAME_CM for x, y in zip(_span(a, a.point, a.axis), _span(b, a.point, a.axis)))
    )


def _bears(pin: Cylinder, hole: Cylinder, anchor: Vector, axis: Vector) -> bool:
    play = hole.radius - pin.radius
    return (
        -1e-9 <= play <= LOOSEST * pin.radius
        and all(length(cross(each.axis, axis)) < TILT for each in (pin, hole))
        and all(_off_axis(each.point, anchor, axis) < play + SAME_CM for each in (pin, hole))
        and _overlap(pin, hole, anchor, axis) > 0.0
    )


def _off_axis(point: Vector, anchor: Vector, axis: Vector) -> float:
    return length(cross(minus(point, anchor), axis))


def _span(cylinder: Cylinder, anchor: Vector, axis: Vector) -> tuple:
    start, way = dot(minus(cylinder.point, anchor), axis), dot(cylinder.axis, axis)
    return tuple(sorted((start + way * cylinder.low, start + way * cylinder.high)))


def _overlap(a: Cylinder, b: Cylinder, anchor: Vector, axis: Vector) -> float:
    (low_a, high_a), (low_b, high_b) = _span(a, anchor, axis), _span(b, anchor, axis)
    return min(high_a, high_b) - max(low_a, low_b)
