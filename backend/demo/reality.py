"""A reality that is not ours: Exudyn moves the linkage with friction the drawing lacks, and a camera films it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from backend.blind.camera import Camera, stage
from backend.blind.exudyn_engine import simulate_exudyn
from backend.blind.render import Look, render_clip
from backend.mechanism.effect import Effect
from backend.mechanism.marker import Marker
from backend.mechanism.mechanism import Mechanism

FRAMES_PER_S = 240.0
HELD_S = 0.1  # the linkage is held still, so that its start can be measured
MOVING_S = 1.1
STEPS_PER_FRAME = 40  # of Exudyn, whose friction takes its side once a step: 10 put the motion 5 µm off, this 1.5
LOOK = Look(dot_radius_m=0.0026, ring_radius_m=0.0042, bar_width_m=0.009)  # markers stand 10 mm apart
WIDTH_PX, HEIGHT_PX = 960, 540

TRUTH = {
    "coulomb_friction:A.friction_torque_n_m": 4.0e-4,
    "viscous_friction:D.damping_n_m_s_per_rad": 1.0e-4,
}
LOAD_N = 0.15
BARS = (("A", "B"), ("B", "C"), ("C", "D"))


def with_load_and_pivots(drawn: Mechanism) -> Mechanism:
    """The drawing with a line to pull the coupler down by (slack), and dots on the two fixed pivots."""
    load = {"force_n": 0.0, "direction": [0.0, 0.0, -1.0], "point_m": [0.045, 0.0, 0.0025]}
    line = Effect(id="load", kind="applied_force", on=("coupler",), parameters=load)
    pivots = tuple(
        Marker(id=joint.id, body=joint.body_a, position_m=joint.frame_a.position_m)
        for joint in drawn.joints
        if drawn.body(joint.body_a).fixed
    )
    return drawn.model_copy(update={"effects": (*drawn.effects, line), "markers": (*drawn.markers, *pivots)})


def real_motion(drawn: Mechanism, load_n: float) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Times of the frames [s] and where each marker really is (frames, 3) [m], held still before the release."""
    document = drawn.model_dump(mode="json", exclude_none=True)
    for effect in document["effects"]:
        if effect["id"] == "load":
            effect["parameters"]["force_n"] = load_n
    for name, value in TRUTH.items():
        kind, _, rest = name.partition(":")
        joint, _, parameter = rest.partition(".")
        document["effects"].append(
            {"id": f"true_{kind}", "kind": kind, "on": [joint], "parameters": {parameter: value}}
        )
    frame_s = 1.0 / FRAMES_PER_S
    motion = simulate_exudyn(document, MOVING_S, frame_s / STEPS_PER_FRAME, output_step_s=frame_s)
    still = round(HELD_S * FRAMES_PER_S)
    places = {
        marker: np.concatenate([np.repeat(p[:1], still, axis=0), p]) for marker, p in motion.marker_position_m.items()
    }
    return np.arange(still + len(motion.time_s)) * frame_s, places


def filmed(
    path: Path,
    times_s: np.ndarray,
    places: dict[str, np.ndarray],
    camera_for: dict[str, np.ndarray],
    progress: Callable[[int, int], None],
) -> Path:
    """Film a motion; returns the bed file, with the lens and the dots' heights as someone would measure them.

    camera_for: the motion that the camera must have in view, so that all clips share one camera.
    """
    camera, bed = stage(
        camera_for, x_axis=(1.0, 0.0, 0.0), y_axis=(0.0, 0.0, 1.0), width_px=WIDTH_PX, height_px=HEIGHT_PX
    )
    render_clip(path, times_s, places, BARS, camera, bed, LOOK, progress=progress)
    sheet = json.loads(path.with_suffix(".bed.json").read_text(encoding="utf-8"))
    sheet["lens"] = {"focal_px": Camera.focal_px}
    sheet["marker_height_m"] = {marker: float(bed.from_world(p[0])[2]) for marker, p in places.items()}
    path.with_suffix(".bed.json").write_text(json.dumps(sheet, indent=1) + "\n", encoding="utf-8")
    return path.with_suffix(".bed.json")
