"""Lengths that the drawing knows: between dots that keep their distance while the mechanism moves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from jaxtyping import Float

from backend.observe.label import drawn_positions, rotation
from backend.observe.plane import Plane

ON_PIN_M = 1e-5  # a dot so near a pin's axis rides on both of its bars
SHORTEST_M = 0.01  # across the bed; below it a dot's own error is as large as what a length could tell


@dataclass(frozen=True)
class Bar:
    """Two markers (by index) and their distance along the bed [m]."""

    a: int
    b: int
    length_m: float


def known_lengths(mechanism: Any, plane: Plane, markers: Sequence[str]) -> list[Bar]:
    """Pairs of markers on one body, or on its pins where those are square to the bed, as drawn."""
    drawn = drawn_positions(mechanism)
    across = plane.from_world(np.array([drawn[name] for name in markers]).reshape(-1, 3))[:, :2]
    found: dict[tuple[int, int], Bar] = {}
    for riders in _riders(mechanism, plane, markers, across).values():
        for a, b in combinations(sorted(riders), 2):
            length = float(np.hypot(*(across[a] - across[b])))
            if length > SHORTEST_M:
                found[a, b] = Bar(a, b, length)
    return list(found.values())


def _riders(
    mechanism: Any, plane: Plane, markers: Sequence[str], across: Float[np.ndarray, "marker 2"]
) -> dict[str, set[int]]:
    """Which markers each body carries along; all fixed bodies are one."""
    fixed = {body.id: body.fixed for body in mechanism.bodies}
    poses = {body.id: body.pose for body in mechanism.bodies}
    index = {name: k for k, name in enumerate(markers)}
    riders: dict[str, set[int]] = {}

    def ride(body: str, marker: int) -> None:
        riders.setdefault("" if fixed[body] else body, set()).add(marker)

    owner = {index[m.id]: m.body for m in mechanism.markers if m.id in index}
    for marker, body in owner.items():
        ride(body, marker)
    for joint in mechanism.joints:
        pose, frame = poses[joint.body_a], joint.frame_a
        R_WA = rotation(pose.quaternion_wxyz)
        axis = R_WA @ rotation(frame.quaternion_wxyz)[:, 2]
        if joint.type != "revolute" or abs(axis @ plane.axes()[2]) < 1 - 1e-9:
            continue
        pin = plane.from_world(np.array(pose.position_m) + R_WA @ np.array(frame.position_m))[:2]
        for marker, body in owner.items():
            if body in (joint.body_a, joint.body_b) and np.hypot(*(across[marker] - pin)) < ON_PIN_M:
                ride(joint.body_a, marker)
                ride(joint.body_b, marker)
    return riders
