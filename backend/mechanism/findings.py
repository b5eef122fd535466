"""What stands out in the numbers of a drawing that can be read: ends, fits and springs that contradict the pose, and
numbers that no linkage has, most of which are another unit's."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from backend.mechanism.apart import at_each_place
from backend.mechanism.body import Body, Inertial
from backend.mechanism.effect_findings import effect_findings
from backend.mechanism.joint import WITHOUT_COORDINATE, Fit, Joint
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.ratios import times
from backend.mechanism.turns import TURN

AIR_KG_PER_M3 = 1.2  # a frame of thin bars, spread over the box that has its moments, is heavier than that
DENSEST_KG_PER_M3 = 1e9  # mass in g beside inertia in kg m² is 3e7 times too dense; a plate drawn thin stays below
THINNEST = 1e-2  # of its length: what is drawn as a plate or a line counts as so thick
LARGE_M, TINY = 10.0, 1.0 / 300.0  # a span, and the share of it that a body's radius of gyration may have
STRONG_M_PER_S2 = 1e3
FAR_MARKER = 10.0  # times the size: a long pointer is a few
WIDE_PLAY = 0.05  # of the size: half a millimetre in a mechanism as small as a matchbox is less
MANY_TURNS = 2.0
MOST = 1e100  # m²: farther apart, products of distances are infinite


def part_findings(mechanism: Mechanism, q: Mapping[str, float], size_m: float) -> list[str]:
    """Warnings that each name a part, its number and the remedy. q: of every joint that has one, as drawn."""
    # A balanced rotor's joint stands at its centre of mass: what is drawn reaches as far as its matter does.
    extent = max([size_m, *(float(_edges(body.moving_inertial())[-1]) for body in mechanism.moving_bodies())])
    return [
        *(sentence for joint in mechanism.joints for sentence in _of_joint(joint, q, extent)),
        *_of_effects(mechanism, q, extent),
        *_of_springs(mechanism, extent),
        *effect_findings(mechanism),
        *(sentence for body in mechanism.moving_bodies() for sentence in _of_body(mechanism, body, size_m)),
        *_of_markers(mechanism, extent),
        *gravity_findings(mechanism),
    ]


def _of_joint(joint: Joint, q: Mapping[str, float], size_m: float) -> Iterator[str]:
    where = f'joint "{joint.id}"'
    if (limits := joint.limits) is not None and joint.type not in WITHOUT_COORDINATE:
        low = -math.inf if limits.lower is None else limits.lower
        high = math.inf if limits.upper is None else limits.upper
        if not low - 1e-9 <= q[joint.id] <= high + 1e-9:
            unit = "m" if joint.type == "prismatic" else "rad"
            yield (
                f"{where} is drawn at {q[joint.id]:.4g} {unit}, outside its limits {low:g} to {high:g}; "
                "correct the limits or the pose"
            )
        yield from _many_turns(where, joint, limits.lower, limits.upper)
    if joint.fit is not None:
        yield from _of_fit(where, joint.fit, size_m)


def _of_fit(where: str, fit: Fit, size_m: float) -> Iterator[str]:
    if fit.pin_diameter_m and fit.hole_diameter_m and fit.radial_clearance_m:
        half = 0.5 * (fit.hole_diameter_m - fit.pin_diameter_m)
        if abs(half - fit.radial_clearance_m) > 1e-3 * fit.radial_clearance_m + 1e-9:
            yield (
                f"{where}: radial_clearance_m is {1e3 * fit.radial_clearance_m:.4g} mm, but "
                f"hole and pin leave {1e3 * half:.4g} mm; the former is used: correct one of them"
            )
    if (wide := max(fit.pin_diameter_m or 0.0, fit.hole_diameter_m or 0.0)) > size_m:
        yield f"{where}: its pin or hole is {wide:g} m wide, the mechanism {size_m:.3g} m; diameters are in m"
    elif (play := fit.clearance_m() or 0.0) > WIDE_PLAY * size_m:
        yield f"{where}: {_wide_play(play, size_m)}"


def _of_effects(mechanism: Mechanism, q: Mapping[str, float], size_m: float) -> Iterator[str]:
    stands = [e for e in mechanism.effects if e.kind in ("joint_stop", "torsion_spring", "clearance")]
    for effect, one in ((e, one) for e in stands for one in at_each_place(mechanism, e)):
        joint, given = mechanism.joint(one.on[0]), one.parameters
        where = f'effect "{effect.id}"'
        if effect.kind == "clearance":
            if isinstance(play := given.get("radial_m"), float) and play > WIDE_PLAY * size_m:
                yield f"{where}: {_wide_play(play, size_m)}"
            continue
        here, unit = q[joint.id], "m" if joint.type == "prismatic" else "rad"
        low, high, rest = (given.get(name) for name in ("lower", "upper", "rest_rad"))
        if effect.kind == "torsion_spring":
            if isinstance(rest, float) and abs(rest - here) > 0.5 * TURN:
                yield (
                    f'{where} is slack at {rest:.4g} rad and joint "{joint.id}" begins at {here:.4g} rad: it is wound '
                    f"by {abs(rest - here) / TURN:.3g} turns; where they are not meant, write rest_rad in rad and "
                    "within half a turn, or give the joint limits about the turn that it begins in"
                )
            continue
        below = isinstance(low, float) and here < low - 1e-9
        if below or (isinstance(high, float) and here > high + 1e-9):
            end, which = (low, "lower") if below else (high, "upper")
            yield (
                f'{where}: joint "{joint.id}" is drawn at {here:.4g} {unit}, beyond the {which} end {end:g} {unit}; '
                "correct the end or the pose"
            )
        yield from _many_turns(where, joint, low, high)


def _of_springs(mechanism: Mechanism, size_m: float) -> Iterator[str]:
    """Springs without a length as drawn, and so without a direction; one that is slack there needs none."""
    ground = [body.id for body in mechanism.bodies if body.fixed]
    for effect in mechanism.effects:
        given = effect.parameters
        if effect.kind != "extension_spring" or not (given.get("free_length_m") or given.get("preload_n")):
            continue
        bodies = [mechanism.body(id) for id in [*effect.on, *ground][:2]]
        a, b = (body.pose.place(np.array(given[f"anchor_{side}_m"])) for body, side in zip(bodies, "ab", strict=True))
        if np.linalg.norm(a - b) <= 1e-6 * size_m:
            point = ", ".join(f"{round(x, 9) + 0.0:.4g}" for x in a)
            yield (
                f'effect "{effect.id}": both its ends are drawn at one point, [{point}] m of the world, where its '
                "force has no direction; anchor_a_m is in the first body's axes, anchor_b_m in the second's"
            )


def _of_markers(mechanism: Mechanism, size_m: float) -> Iterator[str]:
    for marker in mechanism.markers:
        body = mechanism.body(marker.body)
        if not body.fixed and (away := _reach(mechanism, body, marker.position_m)) > FAR_MARKER * size_m:
            yield (
                f'marker "{marker.id}" is drawn {away:.4g} m from a joint of its body "{body.id}", '
                f"{times(away / size_m)} times the mechanism's size, {size_m:.3g} m; position_m is in m, from the "
                "body's origin"
            )


def _many_turns(where: str, joint: Joint, *ends: object) -> Iterator[str]:
    far = max((abs(end) for end in ends if isinstance(end, float)), default=0.0)
    if joint.type != "prismatic" and far > MANY_TURNS * TURN:
        yield f"{where}: an end of travel is at {far:g} rad, {far / TURN:.3g} turns; it is in rad"


def _wide_play(play: float, size_m: float) -> str:
    return (
        f"a play of {play:g} m is more than {WIDE_PLAY:.0%} of the mechanism's size, {size_m:.3g} m; it is in m, from "
        "the middle to one side"
    )


def _of_body(mechanism: Mechanism, body: Body, size_m: float) -> Iterator[str]:
    inertial, where = body.moving_inertial(), f'body "{body.id}"'
    edges = _edges(inertial)
    with np.errstate(over="ignore", divide="ignore"):
        density = float(inertial.mass_kg / np.prod(edges))
    if not AIR_KG_PER_M3 <= density <= DENSEST_KG_PER_M3:
        matter = "lighter than air" if density < AIR_KG_PER_M3 else "denser than any matter"
        yield (
            f"{where}: its mass {inertial.mass_kg:.3g} kg and its inertia are those of a solid block {edges[2]:.3g} x "
            f"{edges[1]:.3g} x {edges[0]:.3g} m, {matter}; mass is in kg, inertia in kg m² (1 g mm² is 1e-9)"
        )
    elif size_m > LARGE_M and edges[2] < TINY * (reach := _reach(mechanism, body, inertial.center_of_mass_m)):
        yield (
            f"{where}: its mass and inertia are those of a solid block {1e3 * edges[2]:.3g} mm long, but its joints "
            f"and its centre of mass are {reach:.3g} m apart; lengths are in m"
        )


def _edges(inertial: Inertial) -> np.ndarray:
    """Of the solid block with this mass and these principal moments, ascending [m]."""
    with np.errstate(over="ignore"):
        moments = np.minimum(np.array(inertial.inertia_kg_m2.principal_moments()) / inertial.mass_kg, MOST)
    spread = np.sort(0.5 * np.sum(moments) - moments)  # mean squares of the matter's distance from its middle
    return np.sqrt(12.0 * np.maximum(spread, THINNEST**2 * spread[-1]))


def _reach(mechanism: Mechanism, body: Body, point: tuple[float, float, float]) -> float:
    """From a point of a body to the farthest of its joints [m]."""
    frames = [
        frame.position_m
        for joint in mechanism.joints
        for id, frame in ((joint.body_a, joint.frame_a), (joint.body_b, joint.frame_b))
        if id == body.id
    ]
    return max((math.dist(point, at) for at in frames), default=0.0)


def gravity_findings(mechanism: Mechanism) -> Iterator[str]:
    """A warning where gravity is that of no planet."""
    if (g := math.hypot(*mechanism.gravity_m_per_s2)) > STRONG_M_PER_S2:
        yield f"gravity_m_per_s2 is {g:.4g} m/s², {times(g / 9.80665)} times the earth's; write it in m/s²"
