"""Mechanisms whose jam is known from theory, each as small as it can be."""

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from backend.mechanism.mechanism import Mechanism
from backend.mechanism.read import parse_mechanism
from tests.mechanisms import (
    WEIGHTLESS,
    Z,
    bar,
    body,
    document,
    drawing,
    effect,
    pendulum,
    slider_crank,
    sliding_mass,
)

BAR_M, DRAWER_M, PULL_N = 0.2, 0.1, 10.0


def held_bar(share: float, friction: float = 0.6, pin_radius_m: float = 0.02) -> Mechanism:
    """A bar on a rubbing pin, leaning from upright by a share of the angle to which its friction holds it.

    The pin carries m g, so friction holds μ r m g against the weight's m g (L / 2) sin θ: sin θ = 2 μ r / L.
    """
    critical = np.arcsin(2 * friction * pin_radius_m / BAR_M)
    rub = effect("rub", "pin_friction", ["pin"], friction_coefficient=friction)
    drawn = document(pendulum(np.pi - share * critical, BAR_M, 0.1, [rub]))
    drawn["joints"][0]["fit"]["pin_diameter_m"] = 2 * pin_radius_m
    return parse_mechanism(drawn)


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


def weak_block(pull_n: float, friction_n: float = 2.0) -> Mechanism:
    """A block on a rail that rubs, pulled along it."""
    rub = effect("rub", "coulomb_friction", ["rail"], friction_force_n=friction_n)
    pull = effect("pull", "applied_force", ["block"], force_n=pull_n, direction=[1, 0, 0])
    return sliding_mass([rub, pull])


def stopped_block(pull_n: float = 2.0, at_m: float = 0.05) -> Mechanism:
    """A block on a rail, pulled against the end of its travel."""
    end = effect("end", "joint_stop", ["rail"], upper=at_m)
    pull = effect("pull", "applied_force", ["block"], force_n=pull_n, direction=[1, 0, 0])
    return sliding_mass([end, pull])


def toggle(angle: float = 0.0, push_n: float = 5.0, drag: float = 0.0, **extra: Any) -> Mechanism:
    """A four-bar whose crank and coupler lie `angle` from stretched, pushed along them at the rocker's knee."""
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


def flywheel(angle: float = 0.4, friction: float = 0.0) -> Mechanism:
    """A slider-crank that its piston's push drives through dead centres by the crank's momentum."""
    push = effect("push", "applied_force", ["block"], force_n=2.0, direction=[-1, 0, 0])
    rub = effect("rub", "coulomb_friction", ["main"], friction_torque_n_m=friction)
    drawn = document(slider_crank(angle, effects=[push, rub]))
    drawn["gravity_m_per_s2"] = [0, 0, 0]
    return parse_mechanism(drawn)


def sagging_latch(play: float, post_gap: float = 5e-4) -> Mechanism:
    """A bar that swings past a post 0.5 mm below its end: on a pin with more play than that it hangs too low."""
    radius, start = 5e-3, -0.3
    tip = (BAR_M * np.sin(start), -BAR_M * np.cos(start), 0.0)
    link = bar("link", (0, 0, 0), tip, 0.1)
    low = -(BAR_M + 2 * radius + post_gap)
    post = effect(
        "post",
        "link_contact",
        ["ground", "link"],
        radius_a_m=radius,
        radius_b_m=radius,
        start_a_m=[0, low, -0.05],
        end_a_m=[0, low, 0.05],
        start_b_m=[0, 0, 0],
        end_b_m=[BAR_M, 0, 0],
    )
    loose = effect("loose", "clearance", ["pin"], radial_m=play, stiffness_n_per_m=1e10)
    slow = effect("slow", "viscous_friction", ["pin"], damping_n_m_s_per_rad=0.05)
    push = effect("push", "applied_torque", ["link"], torque_n_m=0.03, axis=[0, 0, 1])
    pins = [("pin", "revolute", "ground", "link", (0, 0, 0), Z)]
    return drawing("sagging latch", [link], pins, [loose, slow, push, post])


def blocked_block(pull_n: float = 2.0, at_m: float = 0.05) -> Mechanism:
    """A block on a rail, pulled against a post that stands in its way."""
    radius = 0.01
    post = effect(
        "post",
        "link_contact",
        ["ground", "block"],
        radius_a_m=radius,
        radius_b_m=radius,
        start_a_m=[at_m + 2 * radius, 0, -0.05],
        end_a_m=[at_m + 2 * radius, 0, 0.05],
        start_b_m=[-0.02, 0, 0],
        end_b_m=[0, 0, 0],
    )
    pull = effect("pull", "applied_force", ["block"], force_n=pull_n, direction=[1, 0, 0])
    return sliding_mass([post, pull])
