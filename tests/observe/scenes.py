"""Motions in closed form, filmed by a renderer that shares nothing with the tracker."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from backend.blind.camera import Bed, Camera
from backend.blind.render import Look, Occluder, render_clip
from backend.mechanism.body import Body
from backend.mechanism.marker import Marker
from backend.mechanism.mechanism import Mechanism

SMALL = Camera(width_px=640, height_px=360)  # 0.5 mm per pixel, 320 x 180 mm of bed
SMALL_BED = Bed({"a": (-0.15, -0.08), "b": (0.15, -0.08), "c": (0.15, 0.08), "d": (-0.15, 0.08)})


def eight(t):
    """Eight dots swinging 40 to 100 mm at 0.7 to 3.5 Hz in the world's xy plane; (time, 3) each [m]."""
    return {
        f"m{k}": np.c_[
            -0.21 + 0.06 * k + 0.02 * np.sin(2 * np.pi * (1 + 0.35 * k) * t + k),
            (-1) ** k * 0.04 + 0.05 * np.sin(2 * np.pi * (0.7 + 0.2 * k) * t + 2 * k),
            0 * t,
        ]
        for k in range(8)
    }


def four(t, height=0.0):
    """Four dots in the small picture: two still, one that swings 80 mm at 1.5 Hz, one on a circle."""
    still = np.ones_like(t)
    return {
        "base": np.c_[-0.10 * still, -0.03 * still, height * still],
        "post": np.c_[0.10 * still, 0.04 * still, height * still],
        "swing": np.c_[0.04 * np.sin(2 * np.pi * 1.5 * t), -0.02 + 0 * t, height * still],
        "wheel": np.c_[0.08 + 0.02 * np.cos(9 * t), -0.03 + 0.02 * np.sin(9 * t), height * still],
    }


@dataclass(frozen=True)
class Clip:
    """A rendered clip, its truth, and the drawing of its first picture."""

    path: Path
    truth: dict
    markers_m: dict
    mechanism: Mechanism

    @property
    def bed(self):
        return {"marks": self.truth["bed_marks"], "plane": self.truth["plane"], "marker_height_m": 0.0}


def drawing(points):
    """Markers at world points, carried by a body that stands elsewhere and is turned by 90 degrees about z."""
    half = float(np.sqrt(0.5))
    pose = {"position_m": (0.02, -0.01, 0.0), "quaternion_wxyz": (half, 0.0, 0.0, half)}
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    markers = []
    for name, p_W in points.items():
        p_B = turn.T @ (np.asarray(p_W) - np.array(pose["position_m"]))
        markers.append(Marker(id=name, body="plate", position_m=tuple(p_B.tolist())))
    return Mechanism(bodies=(Body(id="plate", fixed=True, pose=pose),), markers=tuple(markers))


def film(path, times_s, motion, links=(), camera=SMALL, bed=SMALL_BED, look=None, occluders=()):
    """Render a motion (a function of time) to a clip."""
    markers = motion(np.asarray(times_s))
    truth = render_clip(path, times_s, markers, links, camera, bed, look or Look(), occluders)
    return Clip(Path(path), truth, markers, drawing({name: p[0] for name, p in markers.items()}))


def errors_m(clip, tracks):
    """Measured minus true place on the bed (frame, marker, 2) [m]; NaN where nothing was measured."""
    names = list(clip.markers_m)
    assert list(tracks.marker[: len(names)]) == names
    measured = tracks[["x_m", "y_m"]].to_numpy().reshape(-1, len(names), 2)
    frames = tracks.frame.to_numpy().reshape(-1, len(names))[:, 0]
    return measured - np.stack([clip.markers_m[n][frames, :2] for n in names], 1)


def swaps(clip, tracks):
    """Points that lie nearer to another marker's true place than to their own."""
    names = list(clip.markers_m)
    truth = np.stack([clip.markers_m[n][:, :2] for n in names], 1)
    frames = tracks.frame.to_numpy().reshape(-1, len(names))[:, 0]
    measured = tracks[["x_m", "y_m"]].to_numpy().reshape(-1, len(names), 1, 2)
    away = np.hypot(*(measured - truth[frames][:, None]).transpose(3, 0, 1, 2))
    seen = np.isfinite(away).all(2)
    return int((away[seen].argmin(1) != np.nonzero(seen)[1]).sum())


def card(x, y, half, start_s, end_s):
    """A square card held over the bed."""
    corners = ((x - half, y - half), (x + half, y - half), (x + half, y + half), (x - half, y + half))
    return Occluder(corners, start_s, end_s)
