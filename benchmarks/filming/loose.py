"""The scissor of the paper's synthetic test for the camera: ten cells, every pin loose, held still, then let go.

MuJoCo moves it, pins rolling and sliding in their holes; nothing of ours does.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from backend.blind.mujoco_engine import simulate_mujoco
from backend.blind.poses import rotation_matrix
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.read import parse_mechanism
from benchmarks.filming.linkages import DOT_HEIGHT_M, Bar, Filmed, scissor

CELLS, BAR_M, ANGLE_DEG = 10, 0.06, math.degrees(0.9)
HELD_S, MUJOCO_S, SAMPLE_S = 0.15, 2e-5, 2e-4  # blows last a fraction of a millisecond


def drawn(play_m: float, damping_n_m_s_per_rad: float) -> tuple[Mechanism, list[Bar]]:
    """The scissor with play and viscous friction at every pin, and its bars."""
    mechanism, bars, _ = scissor(CELLS, BAR_M, ANGLE_DEG)
    document = mechanism.model_dump(mode="json", exclude_none=True)
    pins = [joint["id"] for joint in document["joints"]]
    drag = {"damping_n_m_s_per_rad": damping_n_m_s_per_rad}
    document["effects"] = [
        *(effect for effect in document["effects"] if effect["id"] == "spring"),
        {"id": "drag", "kind": "viscous_friction", "on": pins, "parameters": drag},
        {"id": "play", "kind": "clearance", "on": pins, "parameters": {"radial_m": play_m}},
    ]
    return parse_mechanism(document), bars


def loose_scissor(
    play_m: float, damping_n_m_s_per_rad: float, release_s: float, duration_s: float, kept: Path
) -> Filmed:
    """Held at its drawn pose until `release_s`, then opened by its spring for `duration_s`; kept in a file.

    Bars end where their own bodies do, up to the play beside the dot of the bar that they are pinned to.
    """
    mechanism, bars = drawn(play_m, damping_n_m_s_per_rad)
    ends = [(bar.id, side, x) for bar in bars for side, x in (("start", 0.0), ("end", BAR_M))]
    if not kept.exists():
        run = simulate_mujoco(mechanism, duration_s, MUJOCO_S, output_step_s=SAMPLE_S)
        marked = [run.marker_position_m[marker.id] for marker in mechanism.markers]
        free = [
            run.position_m[body] + rotation_matrix(run.quaternion_wxyz[body]) @ np.array([x, 0.0, 0.0])
            for body, _, x in ends
        ]
        kept.parent.mkdir(parents=True, exist_ok=True)
        np.savez(kept, time_s=run.time_s, world=np.stack(marked + free, 1))
    with np.load(kept) as file:
        time_s, world = file["time_s"], file["world"]
    world[..., 2] = DOT_HEIGHT_M
    before = np.arange(-round(HELD_S / SAMPLE_S), 0) * SAMPLE_S
    world = np.concatenate([np.repeat(world[:1], len(before), 0), world])
    path = CubicSpline(release_s + np.concatenate([before, time_s]), world)
    names = tuple(m.id for m in mechanism.markers) + tuple(f"{body} {side}" for body, side, _ in ends)
    return Filmed(mechanism, tuple((bar, f"{bar.id} start", f"{bar.id} end") for bar in bars), path, names)
