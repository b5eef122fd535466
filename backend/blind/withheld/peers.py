"""The same realities by engines that nobody here wrote: what is amiss, written into their copy of the drawing."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from backend.blind.withheld.causes import Cause
from backend.blind.withheld.linkage import GRAVITY, Linkage, document

ENGINES = ("mujoco", "exudyn")
CAMERA = frozenset(
    {"camera_scale", "camera_rotation", "camera_tilt", "lens_distortion", "frame_rate_error", "time_offset",
     "rolling_shutter", "late_release", "tracker_drift", "wobble"}
)  # fmt: skip
ADDED = frozenset(
    {"viscous_friction", "coulomb_friction", "pin_friction", "effort_offset", "torsion_spring", "joint_stop",
     "linear_drag"}
)  # fmt: skip
REDRAWN = frozenset({"mass_error", "inertia_error", "center_of_mass_error", "gravity_tilt"})
GRID_S = 5e-3


@dataclass(frozen=True)
class PeerPath:
    """Markers as an engine moved them; held at both ends."""

    time_s: np.ndarray
    splines: list[CubicSpline]

    def markers(self, time_s: np.ndarray) -> np.ndarray:
        """(rows, times, markers), complex [m]."""
        inside = np.clip(time_s, 0.0, self.time_s[-1])
        both = np.array([spline(t) for spline, t in zip(self.splines, inside, strict=True)])
        return both[..., 0] + 1j * both[..., 1]


def knows(causes: Sequence[Cause]) -> bool:
    """Whether the engines can imitate all of these."""
    return all(cause.kind in CAMERA | ADDED | REDRAWN for cause in causes)


def peer_path(
    engine: str, linkage: Linkage, causes: Sequence[Cause], starts: np.ndarray, duration_s: float
) -> PeerPath:
    """The markers of every start (rows, movers) by "mujoco" or "exudyn"; ImportError where it is not installed."""
    drawn = amiss(linkage, causes)
    duration_s = GRID_S * float(np.ceil(duration_s / GRID_S))
    splines, time_s = [], np.zeros(0)
    for start in starts:
        places = {linkage.pins[j].id: float(q) for j, q in zip(linkage.movers, start, strict=True)}
        motion = _run(engine, drawn, duration_s, places)
        time_s = motion.time_s
        p = np.stack([motion.marker_position_m[id] for id, _, _ in linkage.markers], 1)
        splines.append(CubicSpline(time_s, np.stack([p[..., 0], p[..., 2]], -1)))
    return PeerPath(time_s, splines)


def _run(engine: str, drawn: dict[str, Any], duration_s: float, places: dict[str, float]) -> Any:
    if engine == "mujoco":
        from backend.blind.mujoco_engine import simulate_mujoco

        return simulate_mujoco(drawn, duration_s, 2e-4, output_step_s=GRID_S, initial_joint_positions=places)
    from backend.blind.exudyn_engine import simulate_exudyn

    rubs = any(effect["kind"] in ("coulomb_friction", "pin_friction", "joint_stop") for effect in drawn["effects"])
    # Its error at 0.5 ms is as large as a camera's noise on a lively rig, so smooth motions are extrapolated.
    return simulate_exudyn(
        drawn,
        duration_s,
        5e-4,
        output_step_s=GRID_S,
        initial_joint_positions=places,
        extrapolated=not rubs,
        friction_creep=1e-3,
    )


def amiss(linkage: Linkage, causes: Sequence[Cause]) -> dict[str, Any]:
    """mechanism.json's content with what is amiss drawn into it, for an engine's eyes alone."""
    drawn = copy.deepcopy(document(linkage))
    bodies = {body["id"]: body for body in drawn["bodies"]}
    for i, cause in enumerate(causes):
        size = dict(cause.parameters)
        if cause.kind in ADDED:
            if cause.kind == "torsion_spring":
                stiffness, turned = (change.value for change in cause.changes)
                size["rest_rad"] = float(np.real(turned)) / float(np.real(stiffness))
            entry = {"id": f"amiss{i}", "kind": cause.kind, "on": list(cause.on), "parameters": size}
            drawn["effects"].append(entry)
        elif cause.kind == "gravity_tilt":
            pitch = size["pitch_rad"]
            drawn["gravity_m_per_s2"] = [GRAVITY * np.sin(pitch), 0.0, -GRAVITY * np.cos(pitch)]
        elif cause.kind in REDRAWN:
            inertial = bodies[cause.on[0]]["inertial"]
            if cause.kind == "center_of_mass_error":
                offset = complex(cause.changes[0].value)
                x, y, z = inertial["center_of_mass_m"]
                inertial["center_of_mass_m"] = [x + offset.real, y + offset.imag, z]
                continue
            factor = 1 + size["relative"]
            if cause.kind == "mass_error":
                inertial["mass_kg"] *= factor
            inertial["inertia_kg_m2"] = {k: v * factor for k, v in inertial["inertia_kg_m2"].items()}
    return drawn
