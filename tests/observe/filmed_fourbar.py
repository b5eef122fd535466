"""A four-bar in closed form before a camera in closed form: what calibration from bars is checked against."""

from dataclasses import dataclass

import numpy as np

from backend.mechanism.mechanism import Mechanism
from backend.mechanism.read import parse_mechanism

SIZE = (1280, 720)
DRAWN = (0.16, 0.06, 0.17, 0.12, 0.08, 0.05)  # ground, crank, coupler, rocker; the knee in the coupler's axes [m]
BASE = np.array([-0.10, -0.03])
MARKERS = ("pivot", "crankpin", "knee", "rockerpin", "post")
TAGS = [(-0.28, -0.15), (0.0, -0.16), (0.28, -0.15), (0.29, 0.0), (0.28, 0.15), (0.0, 0.155), (-0.28, 0.15), (-0.29, 0)]


def fourbar(angle, lengths_m=DRAWN):
    """Bed coordinates (frame, marker, 2) [m] of the markers at crank angles [rad]."""
    ground, radius, coupler, rocker, *knee = lengths_m
    turn = np.exp(1j * np.asarray(angle, float))
    crank = radius * turn
    reach = ground - crank
    far = np.abs(reach)
    between = np.arccos((coupler**2 + far**2 - rocker**2) / (2 * coupler * far))
    along = reach / far * np.exp(1j * between)
    places = [0 * turn, crank, crank + along * complex(*knee), crank + coupler * along, ground + 0 * turn]
    return BASE + np.stack([np.stack([p.real, p.imag], -1) for p in places], 1)


def drawing() -> Mechanism:
    """The four-bar as drawn at a crank angle of 1 rad: bodies without mass data, for their lengths alone."""
    at = dict(zip(MARKERS, fourbar([1.0])[0].tolist(), strict=True))
    still = {"position_m": [0.0, 0.0, 0.0], "quaternion_wxyz": [1.0, 0.0, 0.0, 0.0]}
    inertia = {"xx": 1e-5, "yy": 1e-5, "zz": 1e-5, "xy": 0.0, "xz": 0.0, "yz": 0.0}
    inertial = {"mass_kg": 0.05, "center_of_mass_m": [0.0, 0.0, 0.0], "inertia_kg_m2": inertia}
    bars = [{"id": n, "pose": still, "inertial": inertial} for n in ("crank", "coupler", "rocker")]
    ends = (("ground", "crank"), ("crank", "coupler"), ("coupler", "rocker"), ("rocker", "ground"))
    pins = [(n, a, b) for n, (a, b) in zip(("pivot", "crankpin", "rockerpin", "post"), ends, strict=True)]
    frames = [{"position_m": [*at[n], 0.0], "quaternion_wxyz": [1.0, 0.0, 0.0, 0.0]} for n, _, _ in pins]
    carried = zip(MARKERS, ("ground", "crank", "coupler", "coupler", "ground"), strict=True)
    return parse_mechanism(
        {
            "schema_version": "1.0", "name": "fourbar", "gravity_m_per_s2": [0.0, 0.0, -9.81], "effects": [],
            "bodies": [{"id": "ground", "fixed": True, "pose": still}, *bars],
            "joints": [
                {"id": f"j-{n}", "type": "revolute", "body_a": a, "body_b": b, "frame_a": at_pin, "frame_b": at_pin}
                for (n, a, b), at_pin in zip(pins, frames, strict=True)
            ],
            "markers": [{"id": n, "body": body, "position_m": [*at[n], 0.0]} for n, body in carried],
        }
    )  # fmt: skip


@dataclass(frozen=True)
class Eye:
    """A camera written without the project's own: Brown's k1 and k2, tilted, its optical centre off the middle."""

    focal_px: float = 1000.0
    centre_px: tuple[float, float] = (639.5, 359.5)
    k1: float = 0.0
    k2: float = 0.0
    height_m: float = 0.55
    tilt_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    look_at_m: tuple[float, float] = (0.0, 0.0)

    @property
    def axes(self):
        """Rows: right, down, ahead."""
        (ca, cb, cc), (sa, sb, sc) = np.cos(self.tilt_rad), np.sin(self.tilt_rad)
        x = np.array([[1, 0, 0], [0, ca, -sa], [0, sa, ca]])
        y = np.array([[cb, 0, sb], [0, 1, 0], [-sb, 0, cb]])
        z = np.array([[cc, -sc, 0], [sc, cc, 0], [0, 0, 1]])
        return z @ y @ x @ np.diag([1.0, -1.0, -1.0])

    @property
    def position_m(self):
        return np.array([*self.look_at_m, 0.0]) - self.height_m * self.axes[2]

    def pixels(self, p):
        """Of points (..., 3) [m]."""
        q = (np.asarray(p) - self.position_m) @ self.axes.T
        xy = q[..., :2] / q[..., 2:]
        r2 = (xy**2).sum(-1, keepdims=True)
        return np.array(self.centre_px) + self.focal_px * xy * (1 + self.k1 * r2 + self.k2 * r2**2)


def raised(xy, heights_m):
    """Points (frame, marker, 3) at their heights."""
    return np.concatenate([xy, np.broadcast_to(heights_m, xy.shape[:-1])[..., None]], -1)


def random_eye(rng, width=1280):
    """A phone held above the bed by hand: as different from another as the prior says."""
    focal = 0.78 * width * (1 + 0.15 * rng.standard_normal())
    return Eye(
        focal_px=focal, centre_px=tuple(np.array([639.5, 359.5]) + 0.01 * width * rng.standard_normal(2)),
        k1=0.1 * rng.standard_normal(), k2=0.05 * rng.standard_normal(), height_m=0.62 * focal / width,
        tilt_rad=tuple(np.deg2rad([4.0, 4.0, 2.0]) * rng.standard_normal(3)),
        look_at_m=tuple(0.01 * rng.standard_normal(2)),
    )  # fmt: skip
