"""A clip of the sample pendulum, filmed by the renderer that knows nothing of the tracker."""

import json
from pathlib import Path

import numpy as np

from backend.blind.camera import Camera, stage
from backend.blind.render import Look, render_clip

FRAMES_PER_S, FRAMES, STILL = 60.0, 60, 12
LOOK = Look(dot_radius_m=0.006, ring_radius_m=0.009, bar_width_m=0.014)
REACH = {"middle": 0.1, "bob": 0.2}


def film_pendulum(path: Path) -> tuple[list[dict], dict[str, tuple[float, float]]]:
    """Write a second of a swing.

    Returns the bed's marks (id, x_m, y_m, x_px, y_px), and where each dot is in the first frame [px].
    """
    since = np.maximum(np.arange(FRAMES) - STILL, 0) / FRAMES_PER_S
    angle = np.radians(30.0) * np.cos(8.0 * since)
    places = {
        marker: np.stack([reach * np.sin(angle), np.full(FRAMES, -0.004), -reach * np.cos(angle)], 1)
        for marker, reach in REACH.items()
    }
    camera, bed = stage(places, x_axis=(1.0, 0.0, 0.0), y_axis=(0.0, 0.0, 1.0), width_px=640, height_px=360)
    times = np.arange(FRAMES) / FRAMES_PER_S
    render_clip(path, times, places, (("middle", "bob"),), camera, bed, LOOK, progress=lambda done, total: None)
    assert isinstance(camera, Camera)
    marks = json.loads(path.with_suffix(".bed.json").read_text(encoding="utf-8"))["marks"]
    return marks, {id: tuple(camera.project(bed.from_world(p[0])).tolist()) for id, p in places.items()}
