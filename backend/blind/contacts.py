"""What touches what: loose pins in their holes, links against each other, bodies on the bed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from backend.blind.drawing import Drawing, DrawnBody, DrawnJoint

PARALLEL = 1e-6  # rad: axes drawn with seven digits
DEAD = 1e-3  # restitution below which a blow is inelastic
DEAD_BLOW = 4.0  # its damping over critical, for the free bodies that meet: a linkage behind them adds mass
PAD = 0.5 * np.sqrt(3.0)  # of the radius of gyration: a quarter of a uniform bar's length


@dataclass(frozen=True)
class Play:
    """A pin's freedom in its hole [m], and how the wall answers.

    stiffness [N/m]: infinite where the wall is rigid.  restitution: speed after a blow over the speed before it.
    """

    radial: float
    friction: float
    stiffness: float
    restitution: float


@dataclass(frozen=True)
class Capsules:
    """A stick with round ends in each of two bodies (points and radius in body axes [m]), and how they touch."""

    id: str
    a: int
    b: int
    ends_A: np.ndarray
    ends_B: np.ndarray
    radius_a: float
    radius_b: float
    friction: float
    stiffness: float
    restitution: float


@dataclass(frozen=True)
class Pads:
    """Two pads under a body: points in body axes (2, 3), the bed's normal in W, and the limit of each one's rub [N]."""

    body: int
    points: np.ndarray
    normal: np.ndarray
    force: float


def drawn_play(fit: Mapping[str, Any]) -> float | None:
    """Radial clearance that the drawing states, else half of hole minus pin; None where it says neither [m]."""
    stated, pin, hole = (fit.get(name) for name in ("radial_clearance_m", "pin_diameter_m", "hole_diameter_m"))
    if stated is not None:
        return float(stated)
    return None if pin is None or hole is None else 0.5 * (float(hole) - float(pin))


def play(joint: DrawnJoint, effect: Mapping[str, Any]) -> Play | None:
    """The play that a clearance gives a joint; None where it is zero."""
    given = effect.get("parameters", {})
    radial = given.get("radial_m", joint.drawn_play)
    if radial is None:
        raise ValueError(
            f'effect "{effect["id"]}": joint "{joint.id}" has no fit to take the play from; '
            "give radial_m, or the diameters of pin and hole in the joint's fit"
        )
    if given.get("shape", "circle") != "circle":
        raise ValueError(f'effect "{effect["id"]}": the peers know round holes only; remove shape, or write "circle"')
    if joint.play:
        raise ValueError(f'effect "{effect["id"]}": joint "{joint.id}" is loose already; give it one clearance')
    if not radial:
        return None
    friction = float(given.get("friction_coefficient", 0.0))
    return Play(float(radial), friction, _stiffness(given), float(given.get("restitution", 0.0)))


def _stiffness(given: Mapping[str, Any]) -> float:
    stated = given.get("stiffness_n_per_m")
    return np.inf if stated is None else float(stated)


def capsules(effect: Mapping[str, Any], index: Mapping[str, int]) -> Capsules:
    """A link contact on two bodies."""
    given, on = effect.get("parameters", {}), effect["on"]
    if len(on) != 2 or isinstance(on, str):
        raise ValueError(f'effect "{effect["id"]}": link_contact stands between two bodies; write on: ["a", "b"]')
    wanted = [f"{what}_{side}_m" for what in ("start", "end", "radius") for side in "ab"]
    if missing := [name for name in wanted if given.get(name) is None]:
        raise ValueError(f'effect "{effect["id"]}" lacks {", ".join(missing)}; give each capsule its ends and radius')
    ends = {side: np.array([given[f"start_{side}_m"], given[f"end_{side}_m"]], float) for side in "ab"}
    return Capsules(
        id=effect["id"],
        a=index[on[0]],
        b=index[on[1]],
        ends_A=ends["a"],
        ends_B=ends["b"],
        radius_a=float(given["radius_a_m"]),
        radius_b=float(given["radius_b_m"]),
        friction=float(given.get("friction_coefficient", 0.0)),
        stiffness=_stiffness(given),
        restitution=float(given.get("restitution", 0.0)),
    )


def pads(drawing: Drawing, i: int, effect: Mapping[str, Any]) -> Pads:
    """The pads of a body that slides on the bed under its own weight across it.

    They stand (√3/2) ρ to either side of the centre of mass along the body's length, ρ its radius of gyration about the
    bed's normal: a uniform bar's stand at its quarter points.
    """
    body, normal = drawing.bodies[i], bed_normal(drawing, effect["id"])
    n = body.R_WB.T @ normal
    gyration = np.sqrt(max(n @ body.inertia @ n, 0.0) / body.mass) if body.mass else 0.0
    along = PAD * gyration * _length_direction(drawing, i, n)
    weight = body.mass * abs(float(drawing.gravity @ normal))
    friction = float(effect.get("parameters", {}).get("friction_coefficient", 0.0))
    return Pads(i, np.array([body.p_BC + along, body.p_BC - along]), normal, 0.5 * friction * weight)


def bed_normal(drawing: Drawing, effect: str) -> np.ndarray:
    """The common direction of the axes about which joints turn; gravity's where none turns.

    ValueError where the axes differ.
    """
    axes = [drawing.bodies[j.a].R_WB @ j.R_AF[:, 2] for j in drawing.joints if j.turns]
    if not axes:
        return drawing.gravity / max(float(np.linalg.norm(drawing.gravity)), 1e-300)
    if max(float(np.linalg.norm(np.cross(axes[0], axis))) for axis in axes) > PARALLEL:
        raise ValueError(f'effect "{effect}": the joints turn about different axes, so no bed lies across all of them')
    return axes[0]


def _length_direction(drawing: Drawing, i: int, n: np.ndarray) -> np.ndarray:
    """Unit vector in body axes, across n, along which the body's joints are spread."""
    body, flat = drawing.bodies[i], np.eye(3) - np.outer(n, n)
    points = [j.p_AF for j in drawing.joints if j.a == i] + [j.p_BF for j in drawing.joints if j.b == i]
    spread = np.array([flat @ p for p in points]).reshape(-1, 3)
    if len(spread) < 2 or np.ptp(spread, axis=0).max() < 1e-9:
        spread = np.array([*spread, flat @ body.p_BC])
    centred = spread - spread.mean(0)
    if np.abs(centred).max() > 1e-9:
        return np.linalg.svd(centred)[2][0]
    # No joint tells: a long body turns most easily about its length.
    across = np.linalg.svd(n[None])[2][1:]
    least = np.linalg.eigh(across @ body.inertia @ across.T)[1][:, 0]
    return across.T @ least


def point_mass(body: DrawnBody, p: np.ndarray, n: np.ndarray) -> float:
    """Mass that a blow across n at a point of a free body meets, where it meets most of the turning [kg]."""
    arm = np.cross(n, p - body.p_BC)
    turning = float(n @ body.inertia @ n)
    return 1.0 / (1.0 / body.mass + (float(arm @ arm) / turning if turning > 0.0 else 0.0))


def pair_mass(bodies: list[tuple[DrawnBody, np.ndarray, np.ndarray]]) -> float:
    """Reduced mass of the bodies that meet in a blow, each with its point and its n; fixed ones do not yield [kg]."""
    yielding = [1.0 / point_mass(body, p, n) for body, p, n in bodies if not body.fixed]
    return 1.0 / sum(yielding) if yielding else 1.0


def hunt_crossley(restitution: float) -> float:
    """c of N = k δ (1 + c δ̇ / v) that returns exactly `restitution` of the approach speed v, whatever mass and k.

    From m v dv = -k δ (1 + c v/v₀) dδ, in and out again: c (1 + e) = ln((1 + c) / (1 - c e)).
    """
    e = restitution
    if e >= 1.0:
        return 0.0
    low, high = 0.0, 1.0 / e * (1.0 - 1e-15)
    for _ in range(200):
        c = 0.5 * (low + high)
        low, high = (c, high) if np.log1p(c) - np.log1p(-c * e) < c * (1.0 + e) else (low, c)
    return 0.5 * (low + high)
