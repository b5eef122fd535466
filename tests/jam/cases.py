"""Mechanisms whose jam is known from theory: one rig of a single bar, a drawer and a toggle.

A rig carries every effect that any of its questions needs, at nothing: one compiled program answers them all.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from backend.mechanism.mechanism import Mechanism
from backend.mechanism.read import parse_mechanism
from tests.mechanisms import WEIGHTLESS, Z, bar, body, document, drawing, effect

BAR_M, BAR_KG, G, DRAWER_M, PULL_N = 0.2, 0.1, 9.81, 0.1, 10.0
FAR_M = 10.0


def rig(
    angle: float,
    rub: float = 0.0,
    dry_n_m: float = 0.0,
    damping: float = 0.0,
    torque_n_m: float = 0.0,
    end_rad: float = 1e3,
    play_m: float | None = None,
    post: tuple[float, float] = (FAR_M, FAR_M),
    pin_radius_m: float = 0.02,
    weight: bool = True,
) -> Mechanism:
    """A bar on one pin, `angle` from hanging down.  end_rad: how far it may turn.  post: where one stands."""
    radius = 5e-3
    tip = (BAR_M * np.sin(angle), -BAR_M * np.cos(angle), 0.0)
    link = bar("link", (0, 0, 0), tip, BAR_KG)
    effects = [
        effect("rub", "pin_friction", ["pin"], friction_coefficient=rub),
        effect("dry", "coulomb_friction", ["pin"], friction_torque_n_m=dry_n_m),
        effect("slow", "viscous_friction", ["pin"], damping_n_m_s_per_rad=damping),
        effect("drive", "applied_torque", ["link"], torque_n_m=torque_n_m, axis=[0, 0, 1]),
        effect("end", "joint_stop", ["pin"], upper=end_rad),
        effect(
            "post",
            "link_contact",
            ["ground", "link"],
            radius_a_m=radius,
            radius_b_m=radius,
            start_a_m=[*post, -0.05],
            end_a_m=[*post, 0.05],
            start_b_m=[0, 0, 0],
            end_b_m=[BAR_M, 0, 0],
        ),
    ]
    if play_m is not None:
        effects.append(effect("loose", "clearance", ["pin"], radial_m=play_m))
    pins = [("pin", "revolute", "ground", "link", (0, 0, 0), Z)]
    gravity = (0, -G, 0) if weight else WEIGHTLESS
    drawn = document(drawing("bar", [link], pins, effects, [("tip", "link", tip)], gravity))
    drawn["joints"][0]["fit"]["pin_diameter_m"] = 2 * pin_radius_m
    return parse_mechanism(drawn)


def held_bar(share: float, friction: float = 0.6, pin_radius_m: float = 0.02) -> Mechanism:
    """A bar on a rubbing pin, leaning from upright by a share of the angle to which its friction holds it.

    The pin carries m g, so friction holds μ r m g against the weight's m g (L / 2) sin θ: sin θ = 2 μ r / L.
    """
    critical = np.arcsin(2 * friction * pin_radius_m / BAR_M)
    return rig(np.pi - share * critical, rub=friction, pin_radius_m=pin_radius_m)


def weak_drive(torque_n_m: float, dry_n_m: float = 0.02) -> Mechanism:
    """A weightless bar turned against dry friction."""
    return rig(0.0, dry_n_m=dry_n_m, torque_n_m=torque_n_m, weight=False)


def stopped(torque_n_m: float = 0.02, end_rad: float = 0.5) -> Mechanism:
    """A weightless bar turned against the end of its travel."""
    return rig(0.0, torque_n_m=torque_n_m, end_rad=end_rad, weight=False)


def blocked(torque_n_m: float = 0.02, at_rad: float = 0.5) -> Mechanism:
    """A weightless bar turned against a post that stands in its way."""
    post = (0.7 * BAR_M * float(np.sin(at_rad)), -0.7 * BAR_M * float(np.cos(at_rad)))
    return rig(0.0, torque_n_m=torque_n_m, post=post, weight=False)


def sagging_latch(play_m: float, gap_m: float = 5e-4) -> Mechanism:
    """A bar that swings past a post 0.5 mm below its end: on a pin with more play than that it hangs too low."""
    post = (0.0, -(BAR_M + 0.01 + gap_m))
    return rig(-0.3, damping=0.05, torque_n_m=0.03, play_m=play_m, post=post)


def drawer(share: float, arm: float = 0.2, gap: float = 1e-5) -> Mechanism:
    """A drawer pulled beside its middle, between a post at the front and one at the back.

    Pushes N of the posts stand against the pull's moment, N L = F a, and friction 2 μ N against the pull F: it wedges
    from μ = L / 2a up.  Friction is a share of that.
    """
    radius, friction = 0.01, share * DRAWER_M / (2 * arm)
    block = body("drawer", (0, 0, 0), Rotation.identity(), 0.1, np.full(3, 2e-4))
    reach, high = 4 * DRAWER_M, 2 * radius + gap
    posts = [
        effect(
            name,
            "link_contact",
            ["ground", "drawer"],
            radius_a_m=radius,
            radius_b_m=radius,
            start_a_m=[x, y, -0.05],
            end_a_m=[x, y, 0.05],
            start_b_m=[-reach, 0, 0],
            end_b_m=[reach, 0, 0],
            friction_coefficient=friction,
        )
        for name, x, y in (("front", DRAWER_M / 2, -high), ("back", -DRAWER_M / 2, high))
    ]
    pull = effect("pull", "applied_force", ["drawer"], force_n=PULL_N, direction=[1, 0, 0], point_m=[0, arm, 0])
    table = ("table", "planar", "ground", "drawer", (0, 0, 0), Z)
    return drawing("drawer", [block], [table], [*posts, pull], gravity=WEIGHTLESS)


def toggle(angle: float = 0.0, push_n: float = 5.0) -> Mechanism:
    """A four-bar whose crank and coupler lie `angle` from stretched, pushed together at the rocker's knee."""
    crank, coupler = 0.1, 0.15
    elbow = crank * np.array([np.cos(angle), np.sin(angle), 0.0])
    knee = np.array([elbow[0] + np.sqrt(coupler**2 - elbow[1] ** 2), 0.0, 0.0])
    foot = np.array([knee[0], -0.2, 0.0])
    parts = [bar("crank", (0, 0, 0), elbow), bar("coupler", elbow, knee), bar("rocker", foot, knee)]
    pins = [
        ("root", "revolute", "ground", "crank", (0, 0, 0), Z),
        ("elbow", "revolute", "crank", "coupler", elbow, Z),
        ("knee", "revolute", "coupler", "rocker", knee, Z),
        ("foot", "revolute", "ground", "rocker", foot, Z),
    ]
    point = [float(np.linalg.norm(knee - foot)), 0.0, 0.0]
    push = effect("push", "applied_force", ["rocker"], force_n=push_n, direction=[-1, 0, 0], point_m=point)
    return drawing("toggle", parts, pins, [push], gravity=WEIGHTLESS)
