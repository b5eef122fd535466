"""Which of its whole turns a joint begins in: a drawing shows an angle, not how often it went round."""

from __future__ import annotations

import math
from typing import Any

from backend.mechanism.apart import at_each_place
from backend.mechanism.joint import WITHOUT_COORDINATE
from backend.mechanism.mechanism import Mechanism

TURN = 2.0 * math.pi


def begins_near(mechanism: Mechanism) -> dict[str, float]:
    """Turning joint -> the angle [rad] that its q begins within half a turn of.

    It is where a prescribed path stands; else the middle of a travel of less than a turn; else what of its travel is
    nearest to 0, so 0 where nothing ends it.
    """
    ends = travels(mechanism)
    paths = {joint: float(given.get("q", 0.0)) for joint, given in _at_joints(mechanism, "prescribed_motion")}
    turning = [j.id for j in mechanism.joints if j.type not in WITHOUT_COORDINATE and j.type != "prismatic"]
    return {joint: paths.get(joint, _within(*ends[joint])) for joint in turning}


def nearest(q: float, near: float) -> float:
    """The same angle, whole turns away, within half a turn of another [rad]."""
    return q + TURN * round((near - q) / TURN)


def travels(mechanism: Mechanism) -> dict[str, tuple[float, float]]:
    """Joint -> its tightest ends, drawn as limits or by `joint_stop` [rad or m]; infinite where open."""
    drawn = [(j.id, j.limits.model_dump(exclude_none=True)) for j in mechanism.joints if j.limits is not None]
    ends = {joint.id: (-math.inf, math.inf) for joint in mechanism.joints}
    for joint, given in (*drawn, *_at_joints(mechanism, "joint_stop")):
        low, high = ends[joint]
        ends[joint] = max(low, given.get("lower", -math.inf)), min(high, given.get("upper", math.inf))
    return ends


def _within(low: float, high: float) -> float:
    if low > high:
        return 0.0
    return low + 0.5 * (high - low) if high - low < TURN else min(max(0.0, low), high)


def _at_joints(mechanism: Mechanism, kind: str) -> list[tuple[str, dict[str, Any]]]:
    effects = [effect for effect in mechanism.effects if effect.kind == kind]
    return [(one.on[0], one.parameters) for effect in effects for one in at_each_place(mechanism, effect)]
