"""Joints that the cylinders of an assembly suggest: a pin of one part in a hole of another."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from cad_export.assembly import CadPart
from cad_export.axis import Axis, full_cylinders
from cad_export.fits import Fit, overlap
from cad_export.joints import GAP_MM, TILT_DEG

COAXIAL_DEG = 0.5  # a pin that leans more than this is taken for another feature
LOOSEST = 1.25  # hole over pin: a wider hole is there to let something pass


@dataclass(frozen=True)
class Proposal:
    """A joint that nobody declared yet.

    part_a carries the pin, part_b the hole; the axes are in each part's own coordinates.
    off_mm, tilt_deg: of the pin from the middle of its hole, as placed.
    declared: id and type of the joint that the drawing has there already; it wins.
    """

    id: str
    type: Literal["revolute", "prismatic", "fixed"]
    part_a: str
    part_b: str
    axis_a: Axis
    axis_b: Axis
    fit: Fit
    off_mm: float = 0.0
    tilt_deg: float = 0.0
    declared: tuple[str, str] | None = None

    @property
    def play_mm(self) -> float:
        """Radial clearance; 0 or less is a press fit."""
        return self.fit.radial_clearance_mm or 0.0

    @property
    def remark(self) -> str:
        """What to look at before confirming; empty where nothing is odd."""
        if self.declared:
            id, type = self.declared
            return f'declared as {type} "{id}"' + ("" if type == self.type else f", which wins over {self.type}")
        if self.tilt_deg > TILT_DEG:
            return f"leans by {self.tilt_deg:.3g}°: place the parts so that they meet"
        if self.type == "fixed":
            return "a press fit" if self.play_mm <= 0.0 else "its axes are not parallel: nothing can move"
        if self.type == "prismatic":
            return "two parallel pins: it slides and cannot turn"
        return f"stands {self.off_mm:.3g} mm off the middle" if self.off_mm > GAP_MM else ""

    def sentence(self) -> str:
        """The proposal in one line."""
        pin, hole = self.fit.pin_diameter_mm, self.fit.hole_diameter_mm
        said = f"{self.id}: {self.type}, pin {pin:g} mm of {self.part_a} in hole {hole:g} mm of {self.part_b}"
        return f"{said}, play {self.play_mm:.4g} mm" + (f"; {self.remark}" if self.remark else "")

    def json(self) -> dict[str, object]:
        """The proposal as a report lists it."""
        return {
            "id": self.id,
            "type": self.type,
            "body_a": self.part_a,
            "body_b": self.part_b,
            "fit": self.fit.json(),
            "off_m": round(self.off_mm * 1e-3, 12),
            "tilt_deg": self.tilt_deg,
            "declared": self.declared and self.declared[0],
            "remark": self.remark,
        }


@dataclass(frozen=True)
class _Feature:
    """A pin or hole: on its part, and as it stands in the world."""

    part: str
    own: Axis
    stands: Axis


@dataclass(frozen=True)
class _Pair:
    pin: _Feature
    hole: _Feature
    fit: Fit
    off_mm: float
    tilt_deg: float


def proposals(
    parts: Mapping[str, CadPart], body_of: Mapping[str, str], declared: Mapping[frozenset[str], tuple[str, str]]
) -> list[Proposal]:
    """One joint for every two bodies whose pin and hole share an axis and a stretch of it.

    body_of: the body of each part.  declared: id and type of a joint already drawn between two bodies.
    Two parallel pins between the same bodies let them slide alone, two that are askew nothing, and neither does a
    press fit. Not seen: holes that are no cylinders (B-splines), slots, and two holes whose pin is not drawn.
    """
    between: dict[frozenset[str], list[_Pair]] = defaultdict(list)
    for pair in _pairs(_features(parts)):
        bodies = frozenset((body_of[pair.pin.part], body_of[pair.hole.part]))
        if len(bodies) == 2:
            between[bodies].append(pair)
    found: list[Proposal] = []
    ends = [path.rsplit("/", 1)[-1] for path in parts]
    for bodies, pairs in between.items():
        best = min(pairs, key=lambda pair: (pair.fit.radial_clearance_mm, -(pair.fit.bearing_length_mm or 0.0)))
        pin, hole = best.pin.part, best.hole.part
        names = [path if ends.count(end := path.rsplit("/", 1)[-1]) > 1 else end for path in (pin, hole)]
        joint = Proposal("-".join(names), _type(pairs), pin, hole, best.pin.own, best.hole.own, best.fit)
        found.append(replace(joint, off_mm=best.off_mm, tilt_deg=best.tilt_deg, declared=declared.get(bodies)))
    return _numbered(found)


def _type(pairs: list[_Pair]) -> Literal["revolute", "prismatic", "fixed"]:
    first, *others = (pair.pin.stands for pair in pairs)
    if any((pair.fit.radial_clearance_mm or 0.0) <= 0.0 for pair in pairs):
        return "fixed"
    lean_deg = max((_tilt_deg(first, other) for other in others), default=0.0)
    if lean_deg > COAXIAL_DEG:
        return "fixed"
    widest_mm = max(pair.fit.hole_diameter_mm or 0.0 for pair in pairs)
    return "prismatic" if max((_off_mm(first, other) for other in others), default=0.0) > widest_mm else "revolute"


def _features(parts: Mapping[str, CadPart]) -> list[_Feature]:
    """Pins and holes of all parts; occurrences of one solid are looked at once."""
    known: dict[object, list[Axis]] = {}
    found = []
    for path, part in parts.items():
        if part.solid_key not in known:
            known[part.solid_key] = [axis for axis, _, _ in full_cylinders(part.shape)]
        found += [_Feature(path, axis, axis.in_frame(part.X_WP)) for axis in known[part.solid_key]]
    return found


def _pairs(features: list[_Feature]) -> list[_Pair]:
    """Every pin in a hole of another part: one axis, a common stretch, and sizes that can be a bearing."""
    pins = [one for one in features if one.own.cylinder and one.own.cylinder.sense == "pin"]
    holes = [one for one in features if one.own.cylinder and one.own.cylinder.sense == "hole"]
    if not pins or not holes:
        return []
    found = []
    for row, column in np.argwhere(_near(pins, holes)):
        pin, hole = pins[row], holes[column]
        fit = Fit(_diameter(pin), _diameter(hole), overlap(pin.stands, hole.stands))
        if pin.part != hole.part and (fit.bearing_length_mm or 0.0) > GAP_MM:
            found.append(_Pair(pin, hole, fit, _off_mm(pin.stands, hole.stands), _tilt_deg(pin.stands, hole.stands)))
    return found


def _near(pins: list[_Feature], holes: list[_Feature]) -> np.ndarray:
    """Which pins stand within which holes; all at once, since a long scissor has thousands of pairs."""
    p, u = (np.array([getattr(one.stands, name) for one in pins]) for name in ("point_mm", "direction"))
    q, w = (np.array([getattr(one.stands, name) for one in holes]) for name in ("point_mm", "direction"))
    thick, wide = (np.array([_diameter(one) for one in of]) for of in (pins, holes))
    apart = q[None] - p[:, None]
    apart = apart - np.einsum("ijk,ik->ij", apart, u)[..., None] * u[:, None]
    play_mm = 0.5 * (wide[None] - thick[:, None])
    coaxial = np.linalg.norm(np.cross(u[:, None], w[None]), axis=-1) < np.sin(np.radians(COAXIAL_DEG))
    inside = np.linalg.norm(apart, axis=-1) <= np.maximum(play_mm, 0.0) + GAP_MM
    # A press fit is a little thicker than its hole; a pin that is much thicker is another feature.
    sizes = (wide[None] <= LOOSEST * thick[:, None]) & (thick[:, None] <= 1.01 * wide[None])
    return coaxial & inside & sizes


def _diameter(feature: _Feature) -> float:
    return feature.own.cylinder.diameter_mm if feature.own.cylinder else 0.0


def _off_mm(a: Axis, b: Axis) -> float:
    """From the middle of b to the line a."""
    apart: Float[np.ndarray, "3"] = np.asarray(b.point_mm) - np.asarray(a.point_mm)
    return float(np.linalg.norm(np.cross(a.direction, apart)))


def _tilt_deg(a: Axis, b: Axis) -> float:
    return float(np.degrees(np.arcsin(min(1.0, np.linalg.norm(np.cross(a.direction, b.direction))))))


def _numbered(found: list[Proposal]) -> list[Proposal]:
    """The same with ids that occur once."""
    seen: dict[str, int] = defaultdict(int)
    told = []
    for one in found:
        seen[one.id] += 1
        told.append(one if seen[one.id] == 1 else replace(one, id=f"{one.id}-{seen[one.id]}"))
    return told
