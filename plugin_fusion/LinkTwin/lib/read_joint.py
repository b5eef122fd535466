"""One joint or as-built joint of Fusion as plain data; nothing is interpreted here."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from .islands import ROOT

MOTION_DIRECTIONS = {
    "rotation_axis": "rotationAxisVector",
    "slide_direction": "slideDirectionVector",
    "normal": "normalDirectionVector",
}
MOTION_VALUES = {"rotation_rad": "rotationValue", "slide_cm": "slideValue"}
HELD_LIMITS = {"rotation_limits": "rotationLimits", "slide_limits": "slideLimits"}
AXES = ("primaryAxisVector", "secondaryAxisVector", "thirdAxisVector")  # z, x and y of the triad
OFFSETS = ("offsetZ", "offsetX", "offsetY")  # of a JointOrigin, along them
OTHER_LIMITS = {
    "first slide": "primarySlideLimits",
    "second slide": "secondarySlideLimits",
    "pitch": "pitchLimits",
    "yaw": "yawLimits",
    "roll": "rollLimits",
}


def attempt(read: Callable[[], Any], otherwise: Any = None) -> Any:
    """What reading a property gives, or `otherwise` where Fusion raises: any property of a broken feature may."""
    try:
        return read()
    except Exception:  # Fusion raises RuntimeError, but also others from its bindings
        return otherwise


def read_joint(joint, kind: str) -> dict:
    """A joint's record; only its motion must be readable, and what Fusion raises about that is passed on.

    kind: `joint` or `as_built`.
    """
    motion = joint.jointMotion
    record = {
        "name": attempt(lambda: joint.name) or "joint",
        "kind": kind,
        "type": int(motion.jointType),
        "context": attempt(lambda: _path(joint.assemblyContext), ROOT),
        "one": _end(joint, "occurrenceOne"),
        "two": _end(joint, "occurrenceTwo"),
        "suppressed": bool(attempt(lambda: joint.isSuppressed, False)),
        "locked": bool(attempt(lambda: joint.isLocked, False)),
        "flipped": bool(attempt(lambda: joint.isFlipped, False)),
        "message": attempt(lambda: joint.errorOrWarningMessage) or "",
        "motion_links": attempt(lambda: [_link(link) for link in joint.motionLinks], []),
        "offset_cm": attempt(lambda: float(joint.offset.value), 0.0),
        "angle_rad": attempt(lambda: float(joint.angle.value), 0.0),
        "other_limits": [
            name for name, attribute in OTHER_LIMITS.items() if _limits(attempt(lambda a=attribute: getattr(motion, a)))
        ],
    }
    if kind == "joint":
        record["geometry_one"] = _geometry(attempt(lambda: joint.geometryOrOriginOne))
        record["geometry_two"] = _geometry(attempt(lambda: joint.geometryOrOriginTwo))
    else:
        record["geometry_one"], record["geometry_two"] = None, _geometry(attempt(lambda: joint.geometry))
    for name, attribute in MOTION_DIRECTIONS.items():
        record[name] = attempt(lambda a=attribute: numbers(getattr(motion, a)))
    for name, attribute in MOTION_VALUES.items():
        record[name] = attempt(lambda a=attribute: float(getattr(motion, a)))
    for name, attribute in HELD_LIMITS.items():
        record[name] = _limits(attempt(lambda a=attribute: getattr(motion, a)))
    return record


def numbers(point) -> list:
    """A Point3D or Vector3D as three numbers."""
    return [float(point.x), float(point.y), float(point.z)]


def _path(occurrence) -> str:
    return ROOT if occurrence is None else str(occurrence.fullPathName)


def _end(joint, side: str) -> str | None:
    """The path of an occurrence; ROOT for none, which is the root component, and None where it cannot be read."""
    return attempt(lambda: _path(getattr(joint, side)), None)


def _link(link) -> str:
    return attempt(lambda: str(link.name)) or "motion link"


def _geometry(geometry) -> dict | None:
    """Origin and axes of a JointGeometry or a JointOrigin, in whatever frame Fusion gives them.

    shift_cm: by how much a JointOrigin is drawn away from its JointGeometry, whose origin may or may not hold that.
    """
    if geometry is None:
        return None
    inner = attempt(lambda: geometry.geometry)  # a JointOrigin holds its JointGeometry
    origin = attempt(lambda: numbers(geometry.origin)) or attempt(lambda: numbers(inner.origin))
    if origin is None:
        return None
    vectors = [
        attempt(lambda n=name: numbers(getattr(geometry, n))) or attempt(lambda n=name: numbers(getattr(inner, n)))
        for name in AXES
    ]
    found: dict = {"origin_cm": origin, "vectors": [vector for vector in vectors if vector]}
    offsets = [attempt(lambda n=name: float(getattr(geometry, n).value), 0.0) for name in OFFSETS]
    if any(offsets) and all(vectors):
        found["shift_cm"] = [sum(offset * vector[at] for offset, vector in zip(offsets, vectors)) for at in range(3)]
    return found


def _limits(limits) -> dict | None:
    """The sides that are switched on."""
    if limits is None:
        return None
    sides = {
        "lower": ("isMinimumValueEnabled", "minimumValue"),
        "upper": ("isMaximumValueEnabled", "maximumValue"),
    }
    found = {
        side: attempt(lambda v=value: float(getattr(limits, v)))
        for side, (enabled, value) in sides.items()
        if attempt(lambda e=enabled: bool(getattr(limits, e)), False)
    }
    return {side: value for side, value in found.items() if value is not None} or None
