"""An upright four-bar with friction at its crank, integrated in one coordinate by SciPy, before a tilted camera.

Nothing here is the project's: one equation of motion for the crank's angle (Lagrange), its inertia and its weight from
the bars' closed-form places, and pixels from a camera written out.
"""

import numpy as np
import pandas as pd
from scipy.integrate import solve_ivp

from backend.mechanism.read import parse_mechanism
from backend.mechanism.study import Experiment, Release
from backend.observe.bed import read_bed
from backend.observe.camera import Camera, Deviations, write_camera
from backend.observe.camera_in_clip import camera_in_clip
from tests.observe.filmed_fourbar import MARKERS, SIZE, TAGS, Eye, drawing, fourbar, raised

DAMPING, GRAVITY = 4e-3, 9.81  # viscous, at the crank's pivot [N m s/rad]
BARS = {"crank": (0, 1, 0.08), "coupler": (1, 3, 0.12), "rocker": (3, 4, 0.10)}  # ends, among the markers; mass [kg]
HEIGHT_M, DOT_PX = 0.012, 0.2  # plain dots; at 0.05 px the error of a step, 0.01% of the friction, would show
TRUE_EYE = Eye(1000.0, (643.0, 357.0), k1=-0.10, k2=0.02, height_m=0.55, tilt_rad=(0.10, -0.07, 0.02))
LENS_SD = np.array([1.5, 1.5, 1.0, 1.0, 2e-3, 4e-3, 1e-4, 1e-4, 0.0])  # what a board leaves open


def rig():
    """The four-bar as drawn at a crank angle of 1 rad, with slender bars, its weight along -y."""
    document = drawing().model_dump(mode="json", exclude_none=True)
    document["gravity_m_per_s2"] = [0.0, -GRAVITY, 0.0]
    at = fourbar([1.0])[0]
    for body in document["bodies"][1:]:
        a, b, mass = BARS[body["id"]]
        x, y = at[b] - at[a]
        middle, k = (at[a] + at[b]) / 2, mass / 12
        inertia = {"xx": k * y**2 + 1e-6, "yy": k * x**2 + 1e-6, "zz": k * (x**2 + y**2), "xy": -k * x * y}
        inertia |= {"xz": 0.0, "yz": 0.0}
        body["inertial"] = {"mass_kg": mass, "center_of_mass_m": [*middle.tolist(), 0.0], "inertia_kg_m2": inertia}
    return parse_mechanism(document)


def inertia_and_energy(angle):
    """Generalised inertia [kg m^2] and potential energy [J] at crank angles, from places alone."""
    h = 1e-5
    now, up, down = (fourbar(np.atleast_1d(angle) + d) for d in (0.0, h, -h))
    rate = (up - down) / (2 * h)
    inertia, energy = 0.0, 0.0
    for a, b, mass in BARS.values():
        length2 = np.sum((now[:, b] - now[:, a]) ** 2, 1)
        turn2 = np.sum((rate[:, b] - rate[:, a]) ** 2, 1) / length2
        inertia = inertia + mass * np.sum(((rate[:, a] + rate[:, b]) / 2) ** 2, 1) + mass * length2 / 12 * turn2
        energy = energy + mass * GRAVITY * (now[:, a, 1] + now[:, b, 1]) / 2
    return inertia, energy


def swing(time_s, angle, damping=DAMPING):
    """Crank angle from rest: M a'' + M' a'^2 / 2 + V' = - damping a'."""

    def slope(_, state):
        h = 1e-4
        M, V = inertia_and_energy(state[0] + np.array([-h, 0.0, h]))
        M_slope, V_slope = (M[2] - M[0]) / (2 * h), (V[2] - V[0]) / (2 * h)
        return [state[1], (-damping * state[1] - M_slope * state[1] ** 2 / 2 - V_slope) / M[1]]

    return solve_ivp(slope, (0, time_s[-1] + 1e-9), [angle, 0.0], t_eval=time_s, rtol=1e-9, atol=1e-11).y[0]


def places(angle=1.0, still=6, frames=72, rate=60.0):
    """Frame times and true points (frame, marker, 3): held for a few frames, then let go."""
    time_s = np.arange(frames) / rate
    swung = swing(time_s[still:] - time_s[still], angle)
    return time_s, raised(fourbar(np.r_[np.full(still, angle), swung]), HEIGHT_M), time_s[still]


def lens(rng):
    """A lens as a board would have it: the truth, off by what its covariance says."""
    e = TRUE_EYE
    true = np.array([e.focal_px, e.focal_px, *e.centre_px, e.k1, e.k2, 0, 0, 0])
    covariance = np.diag(LENS_SD**2)
    covariance[0, 1] = covariance[1, 0] = 0.99 * LENS_SD[0] ** 2
    v = true + rng.multivariate_normal(np.zeros(9), covariance)
    names, s = ("k1", "k2", "p1", "p2", "k3"), LENS_SD
    sd = Deviations(focal_px=(s[0], s[1]), centre_px=(s[2], s[3]), **dict(zip(names, s[4:].tolist(), strict=True)))
    return Camera(
        image_size_px=SIZE, focal_px=(v[0], v[1]), centre_px=(v[2], v[3]),
        **dict(zip(names, v[4:].tolist(), strict=True)), sd=sd,
        covariance=tuple(map(tuple, covariance.tolist())), reprojection_rms_px=0.06, views=20, coverage=0.9,
    )  # fmt: skip


def filmed(folder, rng, truth, use="fit", metres=False, k1_off=0.0, dot_px=DOT_PX):
    """An experiment of one clip: noisy pixels, and the camera as calibration and bed tags leave it.

    metres: the tracks hold places on the bed in place of pixels.  k1_off: the file is of another lens.
    """
    time_s, points, release_s = truth
    px = TRUE_EYE.pixels(points) + dot_px * rng.standard_normal((*points.shape[:2], 2))
    tags = TRUE_EYE.pixels(np.c_[TAGS, np.zeros(len(TAGS))]) + 0.1 * rng.standard_normal((len(TAGS), 2))
    marks = [
        {"id": f"tag {k}", "x_m": x, "y_m": y, "x_px": u, "y_px": v}
        for k, ((x, y), (u, v)) in enumerate(zip(TAGS, tags.tolist(), strict=True))
    ]
    heights = dict(zip(MARKERS, (HEIGHT_M + 5e-4 * rng.standard_normal(5)).tolist(), strict=True))
    bed = read_bed({"marks": marks, "marker_height_m": heights, "marker_height_sd_m": 5e-4, "mark_sd_m": 0.0})
    camera = camera_in_clip(lens(rng), bed, MARKERS, px, SIZE)
    camera = camera.model_copy(update={"k1": camera.k1 + k1_off})
    path = write_camera(camera, folder / "camera.json")
    frames = len(time_s)
    tracks = pd.DataFrame(
        {
            "time_s": np.repeat(time_s, 5), "marker": np.tile(MARKERS, frames), "x_m": np.nan, "y_m": np.nan,
            "z_m": np.nan, "sigma_m": np.nan, "x_px": px[..., 0].ravel(), "y_px": px[..., 1].ravel(),
            "cov_xx_px2": dot_px**2, "cov_xy_px2": 0.0, "cov_yy_px2": dot_px**2, "status": "observed",
        }
    )  # fmt: skip
    experiment = Experiment("clip", use, Release(time_s=release_s), tracks=tracks, camera=path)
    if metres:
        from backend.fit.eye import Eye as Calibrated

        drawn = {n: np.zeros(3) for n in MARKERS}
        placed = Calibrated.of(experiment).placed(tracks, drawn).drop(columns=["x_px", "y_px"])
        experiment = Experiment("clip", use, Release(time_s=release_s), tracks=placed, camera=path)
    return experiment
