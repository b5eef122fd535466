"""Links that may meet, found in the drawing: what a `link_contact` on "all" stands for.

A link is a body with mass, moving or fixed, that joints hold in two places.  Its capsule reaches between the two that
are farthest apart, in a planar mechanism at the height of its centre of mass.  Two links may meet unless both are
fixed, a joint connects them, they lie in different layers of a planar mechanism, or they overlap as drawn: such a pair
evidently passes in depth.
"""

from __future__ import annotations

from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from backend.mechanism.constraints import drawn
from backend.mechanism.drawing_error import DrawingError
from backend.mechanism.effect import Effect
from backend.mechanism.mechanism import FOUND, Mechanism
from backend.mechanism.mobility import joint_axes, plane_normal
from backend.mechanism.part import Part

MOST_PAIRS = 200  # each costs 10 µs a step
SUNK = 0.01  # of the radii: what links drawn in touch may overlap by rounding
SHORTEST_M = 1e-9


class FoundContacts(Part):
    """Pairs of links that a `link_contact` on "all" stands for; `overlapping` ones were left out."""

    effect: str
    pairs: tuple[tuple[str, str], ...]
    overlapping: tuple[tuple[str, str], ...]
    shapeless: tuple[str, ...] = ()
    """Fixed bodies that nothing meets: drawn without mass, or held in one place only."""


class Link(NamedTuple):
    """A link's capsule [m] and, in a planar mechanism, its layer."""

    id: str
    fixed: bool
    ends: np.ndarray
    """(2, 3) in body axes."""
    ends_W: np.ndarray
    radius: float
    height: float
    thickness: float


def found_contacts(mechanism: Mechanism) -> tuple[FoundContacts, ...]:
    """What each `link_contact` on "all" stands for.  DrawingError where the pairs are too many."""
    return tuple(_found(mechanism, effect)[0] for effect in mechanism.effects if _finds(effect))


def contacts_declared(mechanism: Mechanism) -> Mechanism:
    """The drawing with every found pair as a `link_contact` of its own, `ID@first-second`."""
    if not any(map(_finds, mechanism.effects)):
        return mechanism
    effects = [one for e in mechanism.effects for one in (_declared(mechanism, e) if _finds(e) else (e,))]
    return mechanism.model_copy(update={"effects": tuple(effects)})


def _finds(effect: Effect) -> bool:
    return effect.kind == FOUND and effect.on == "all"


def _declared(mechanism: Mechanism, effect: Effect) -> list[Effect]:
    found, links = _found(mechanism, effect)
    made = []
    for pair in found.pairs:
        parameters = dict(effect.parameters)
        for side, link in zip("ab", (links[id] for id in pair), strict=True):
            start, end = (tuple(map(float, p)) for p in link.ends)
            parameters |= {f"start_{side}_m": start, f"end_{side}_m": end, f"radius_{side}_m": link.radius}
        made.append(
            effect.model_copy(update={"id": f"{effect.id}@{'-'.join(pair)}", "on": pair, "parameters": parameters})
        )
    return made


def _found(mechanism: Mechanism, effect: Effect) -> tuple[FoundContacts, dict[str, Link]]:
    links = _links(mechanism, effect)
    joined = {frozenset((joint.body_a, joint.body_b)) for joint in mechanism.joints}
    pairs, overlapping = [], []
    for a, b in combinations(links, 2):
        # Half of their thickness: a link of the next layer is a whole one away.
        layers_apart = abs(a.height - b.height) >= 0.25 * (a.thickness + b.thickness)
        if (a.fixed and b.fixed) or {a.id, b.id} in joined or layers_apart:
            continue
        sunk = _distance(a.ends_W, b.ends_W) < (1.0 - SUNK) * (a.radius + b.radius)
        (overlapping if sunk else pairs).append((a.id, b.id))
    if len(pairs) > MOST_PAIRS:
        raise DrawingError(
            f'effect "{effect.id}": {len(pairs)} pairs of links may meet, more than {MOST_PAIRS}; draw the links in '
            "their layers, or name the pairs that do meet, each in a link_contact of its own"
        )
    by_id = {link.id: link for link in links}
    shapeless = tuple(body.id for body in mechanism.bodies if body.fixed and body.id not in by_id)
    found = FoundContacts(effect=effect.id, pairs=tuple(pairs), overlapping=tuple(overlapping), shapeless=shapeless)
    return found, by_id


def _links(mechanism: Mechanism, effect: Effect) -> list[Link]:
    poses = {body.id: (np.array(body.pose.position_m), body.pose.rotation()) for body in mechanism.bodies}
    joints = list(mechanism.joints)
    normal = plane_normal(joints, joint_axes(mechanism, joints, drawn(mechanism)))
    given = [
        np.asarray(effect.parameters[name], float) for name in ("radius_a_m", "radius_b_m") if name in effect.parameters
    ]
    links = []
    for body in mechanism.bodies:
        R, inertial = poses[body.id][1], body.inertial
        if inertial is None or not 0.0 < inertial.mass_kg < np.inf:
            continue
        n = None if normal is None else R.T @ normal
        c = np.array(inertial.center_of_mass_m)
        held = [
            np.array(frame.position_m)
            for joint in mechanism.joints
            for id, frame in ((joint.body_a, joint.frame_a), (joint.body_b, joint.frame_b))
            if id == body.id
        ]
        if n is not None:
            held = [p + n * (n @ (c - p)) for p in held]
        ends = np.array(max(combinations(held, 2), key=_length, default=np.zeros((2, 3))))
        if _length(ends) < SHORTEST_M:
            continue
        # The mean square of the material's distance from its middle plane is t²/12 for a plate of thickness t.
        spread = inertial.inertia_kg_m2.matrix() / inertial.mass_kg
        spread = 0.5 * np.trace(spread) * np.eye(3) - spread
        along = (ends[1] - ends[0]) / _length(ends)
        across = np.linalg.svd(along[None])[2][1] if n is None else np.cross(n, along)
        thickness = np.inf if n is None else float(np.sqrt(12 * max(n @ spread @ n, 0.0)))
        height = 0.0 if n is None else float(normal @ (poses[body.id][0] + R @ c))
        radius = given[0] if given else np.sqrt(3 * max(across @ spread @ across, 0.0))  # half the breadth of a bar
        links.append(Link(body.id, body.fixed, ends, poses[body.id][0] + ends @ R.T, float(radius), height, thickness))
    return links


def _length(ends: Any) -> float:
    return float(np.linalg.norm(ends[1] - ends[0]))


def _distance(one: np.ndarray, other: np.ndarray) -> float:
    """Between two segments, (2, 3) each: where they cross, else from an end [m]."""
    least = min(_from_point(p, axis) for points, axis in ((one, other), (other, one)) for p in points)
    u, v, w = one[1] - one[0], other[1] - other[0], other[0] - one[0]
    n = np.cross(u, v)
    if (square := float(n @ n)) < 1e-12 * float((u @ u) * (v @ v)):
        return least
    s, t = np.cross(w, v) @ n / square, np.cross(w, u) @ n / square
    return abs(float(w @ n)) / square**0.5 if 0.0 < s < 1.0 and 0.0 < t < 1.0 else least


def _from_point(p: np.ndarray, axis: np.ndarray) -> float:
    along = axis[1] - axis[0]
    share = np.clip((p - axis[0]) @ along / (along @ along), 0.0, 1.0)
    return float(np.linalg.norm(p - axis[0] - share * along))
