"""Mechanisms that are filmed, and how they move: MuJoCo integrates them, nothing of ours does."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline

from backend.blind.mujoco_engine import simulate_mujoco
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.read import parse_mechanism

BAR_KG_PER_M, DOT_HEIGHT_M = 0.15, 0.012
LAYERS_M = (0.004, 0.009)  # tops of the lower and the upper bars above the bed
SAMPLE_S = 1e-3

Point = tuple[float, float]


@dataclass(frozen=True)
class Bar:
    """A bar from one point to another as drawn [m], in the lower (0) or the upper (1) layer."""

    id: str
    start: Point
    end: Point
    layer: int = 0


@dataclass(frozen=True)
class Filmed:
    """A mechanism, its bars, and where everything is at any time.

    points: names, in the order of `path`; markers come first.  bars: (bar, the points at its start and its end).
    """

    mechanism: Mechanism
    bars: tuple[tuple[Bar, str, str], ...]
    path: CubicSpline
    points: tuple[str, ...]

    @property
    def markers(self) -> list[str]:
        """Names, in the order of `at`."""
        return [m.id for m in self.mechanism.markers]

    def at(self, time_s: Float[np.ndarray, "*t"]) -> Float[np.ndarray, "*t marker 3"]:
        """World positions of the markers [m]."""
        return self.path(np.asarray(time_s))[..., : len(self.mechanism.markers), :]


def linkage(
    name: str,
    bars: Sequence[Bar],
    pins: Sequence[tuple[str, str, str, Point]],
    effects: Sequence[dict],
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.80665),
) -> Mechanism:
    """Bars in the xy plane, pinned about z; a marker on every pin that moves and on every free end."""
    bodies: list[dict] = [{"id": "ground", "fixed": True}]
    frame: dict[str, tuple[np.ndarray, float]] = {"ground": (np.zeros(2), 0.0)}
    for bar in bars:
        a, b = np.array(bar.start), np.array(bar.end)
        length, angle = float(np.hypot(*(b - a))), math.atan2(*(b - a)[::-1])
        mass = BAR_KG_PER_M * length
        about = mass * length**2 / 12
        frame[bar.id] = (a, angle)
        bodies.append(
            {
                "id": bar.id,
                "pose": {"position_m": [*a.tolist(), 0.0], "quaternion_wxyz": _about_z(angle)},
                "inertial": {
                    "mass_kg": mass,
                    "center_of_mass_m": [length / 2, 0, 0],
                    "inertia_kg_m2": {"xx": 0.01 * about, "yy": about, "zz": about},
                },
            }
        )

    def local(body: str, at: Point) -> list[float]:
        origin, angle = frame[body]
        c, s = math.cos(angle), math.sin(angle)
        return [*(np.array([[c, s], [-s, c]]) @ (np.array(at) - origin)).tolist(), 0.0]

    joints, markers = [], {}
    for id, body_a, body_b, at in pins:
        ends = {
            f"frame_{k}": {"position_m": local(body, at), "quaternion_wxyz": _about_z(-frame[body][1])}
            for k, body in (("a", body_a), ("b", body_b))
        }
        joints.append({"id": id, "type": "revolute", "body_a": body_a, "body_b": body_b, **ends})
        markers[id] = (body_b if body_a == "ground" else body_a, at)
    pinned = [np.array(at) for *_, at in pins]
    for bar in bars:
        for end, at in (("start", bar.start), ("end", bar.end)):
            if min(np.hypot(*(p - at)) for p in pinned) > 1e-6:
                markers[f"{bar.id}_{end}"] = (bar.id, at)
    return parse_mechanism(
        {
            "schema_version": "1.0",
            "name": name,
            "gravity_m_per_s2": list(gravity),
            "bodies": bodies,
            "joints": joints,
            "effects": list(effects),
            "markers": [
                {"id": id, "body": body, "position_m": [*local(body, at)[:2], DOT_HEIGHT_M]}
                for id, (body, at) in markers.items()
            ],
        }
    )


def scissor(cells: int = 10, bar_m: float = 0.06, angle_deg: float = 62.0, x_m: float = -0.27) -> tuple:
    """A scissor that a spring across its first end opens: the mechanism, its bars, and starting rates."""
    c, s = (0.5 * bar_m * f(math.radians(angle_deg)) for f in (math.cos, math.sin))
    bars, pins = [], []
    for i in range(cells):
        x = x_m + 2 * c * i
        bars += [Bar(f"a{i}", (x, -s), (x + 2 * c, s), 0), Bar(f"b{i}", (x, s), (x + 2 * c, -s), 1)]
        pins.append((f"mid{i}", f"a{i}", f"b{i}", (x + c, 0.0)))
        if i:
            pins.append((f"top{i}", f"a{i - 1}", f"b{i}", (x, s)))
            pins.append((f"low{i}", f"b{i - 1}", f"a{i}", (x, -s)))
    pins.append(("root", "ground", "a0", (x_m, -s)))
    pull = {
        "anchor_a_m": [0, 0, 0],
        "anchor_b_m": [0, 0, 0],
        "stiffness_n_per_m": 250.0,
        "free_length_m": 0.9 * s,
        "damping_n_s_per_m": 0.0,
    }
    effects = [
        {"id": "spring", "kind": "extension_spring", "on": ["a0", "b0"], "parameters": pull},
        {"id": "rub", "kind": "viscous_friction", "on": "all", "parameters": {"damping_n_m_s_per_rad": 3e-4}},
    ]
    return linkage(f"scissor of {cells} cells", bars, pins, effects), bars, {}


def fourbar() -> tuple:
    """A crank of 50 mm that turns at 24 rad/s, its coupler 150 mm long."""
    a, d = (-0.12, -0.04), (0.08, -0.04)
    b = (a[0] + 0.05, a[1])
    reach, rocker = 0.15, 0.11
    span = d[0] - b[0]
    along = (reach**2 - rocker**2 + span**2) / (2 * span)
    c = (b[0] + along, b[1] + math.sqrt(reach**2 - along**2))
    bars = [Bar("crank", a, b, 1), Bar("coupler", b, c, 0), Bar("rocker", d, c, 1)]
    pins = [("A", "ground", "crank", a), ("B", "crank", "coupler", b), ("C", "coupler", "rocker", c)]
    pins.append(("D", "ground", "rocker", d))
    return linkage("four-bar", bars, pins, []), bars, {"A": 24.0}


def double_pendulum() -> tuple:
    """Two bars that swing in the picture's plane under a part of gravity, as on a leaning table."""
    a, b, c = (0.0, 0.06), (-0.10, 0.07), (-0.18, 0.03)
    bars = [Bar("upper", a, b, 0), Bar("lower", b, c, 1)]
    pins = [("shoulder", "ground", "upper", a), ("knee", "upper", "lower", b)]
    return linkage("double pendulum", bars, pins, [], (0.0, -6.9, -6.9)), bars, {}


LINKAGES = {"scissor": scissor, "four-bar": fourbar, "double pendulum": double_pendulum}


def filmed(kind: str, duration_s: float, cells: int = 10, kept: Path | None = None) -> Filmed:
    """A linkage of LINKAGES and its motion for this long, a little earlier and later too; `kept`: where to keep it."""
    mechanism, bars, rates = scissor(cells) if kind == "scissor" else LINKAGES[kind]()
    if kept is None or not kept.exists():
        run = simulate_mujoco(
            mechanism, duration_s + 0.05, 1e-4, output_step_s=SAMPLE_S, initial_joint_velocities=rates or None
        )
        time_s, world = run.time_s, np.stack([run.marker_position_m[m.id] for m in mechanism.markers], 1)
        if kept is not None:
            kept.parent.mkdir(parents=True, exist_ok=True)
            np.savez(kept, time_s=time_s, world=world)
    else:
        with np.load(kept) as file:
            time_s, world = file["time_s"], file["world"]
    world[..., 2] = DOT_HEIGHT_M
    names = [m.id for m in mechanism.markers]
    return Filmed(mechanism, _ends(names, world[0, :, :2], bars), CubicSpline(time_s - 0.01, world), tuple(names))


def _ends(names: list[str], at: np.ndarray, bars: Sequence[Bar]) -> tuple[tuple[Bar, str, str], ...]:
    """Each bar with the markers that lie at its ends."""
    nearest = [[names[int(np.hypot(*(at - p).T).argmin())] for p in (bar.start, bar.end)] for bar in bars]
    return tuple((bar, a, b) for bar, (a, b) in zip(bars, nearest, strict=True))


def _about_z(angle: float) -> list[float]:
    return [math.cos(0.5 * angle), 0.0, 0.0, math.sin(0.5 * angle)]
