"""Tables that can be read, and whose first samples no pose of the drawing explains: told with the likely slip."""

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from backend.fit.unexplained import unexplained
from backend.mechanism.study import Experiment, Release, Study
from tests.mechanisms import Z, bar, drawing

TIME = np.arange(40) / 100
RELEASE_S = 0.2
ARM, FOREARM = 0.2, 0.15
POINTS = {"shoulder": ("arm", 0.05), "near": ("arm", 0.16), "elbow": ("forearm", 0.03), "hand": ("forearm", 0.14)}
ANGLES = {"e1": (0.5, 0.7), "e2": (-0.9, 1.1)}
LIFT = {"shoulder": 0.01, "near": 0.0, "elbow": 0.02, "hand": 0.01}  # along z, so that the plane is seen


@pytest.fixture(scope="module")
def arm():
    """Two bars, drawn stretched along x, that turn about z."""
    bars = [bar("arm", (0, 0, 0), (ARM, 0, 0)), bar("forearm", (ARM, 0, 0), (ARM + FOREARM, 0, 0))]
    pins = [("j1", "revolute", "ground", "arm", (0, 0, 0), Z), ("j2", "revolute", "arm", "forearm", (ARM, 0, 0), Z)]
    markers = [(id, part, (at + ARM * (part == "forearm"), 0, LIFT[id])) for id, (part, at) in POINTS.items()]
    return drawing("arm", bars, pins, markers=markers)


def tables(angles, scale=1.0):
    """Markers with a tenth of a millimetre of noise, and what the joints read."""
    rng = np.random.default_rng(1)
    first, second = (Rotation.from_euler("z", turn) for turn in (angles[0], sum(angles)))
    tracks = []
    for id, (part, at) in POINTS.items():
        lift = (0, 0, LIFT[id])
        place = (
            first.apply((at, 0, 0)) if part == "arm" else first.apply((ARM, 0, 0)) + second.apply((at, 0, 0))
        ) + lift
        seen = scale * place + 1e-4 * rng.standard_normal((TIME.size, 3))
        tracks.append(pd.DataFrame(seen, columns=["x_m", "y_m", "z_m"]).assign(time_s=TIME, marker=id, sigma_m=np.nan))
    reads = [
        pd.DataFrame({"time_s": TIME, "joint": id, "q": q + 1e-3 * rng.standard_normal(TIME.size), "sigma": np.nan})
        for id, q in zip(("j1", "j2"), angles, strict=True)
    ]
    return pd.concat(tracks, ignore_index=True), pd.concat(reads, ignore_index=True)


def told(arm, change=lambda tracks, reads: (tracks, reads)):
    """What is said of both experiments once their tables were changed."""
    shots = []
    for id, angles in ANGLES.items():
        tracks, reads = change(*tables(angles))
        shots.append(Experiment(id, "fit", Release(time_s=RELEASE_S), tracks=tracks, joint_positions=reads))
    refused, warned = unexplained(Study(arm, tuple(shots)))
    assert refused == []
    return warned


def renamed(tracks, **names):
    return tracks.assign(marker=tracks["marker"].replace(names))


SLIPS = {
    "a sign": (
        lambda t, r: (t, r.assign(q=r["q"].where(r["joint"] == "j1", -r["q"]))),
        "check its sign, which the joint's axis gives",
    ),
    "a zero": (lambda t, r: (t, r.assign(q=r["q"] + 0.4 * (r["joint"] == "j2"))), "check its zero, which is the drawn"),
    "names": (
        lambda t, r: (renamed(t, near="hand", hand="near"), r),
        'With "hand" and "near" in each other\'s place all are explained: check their names',
    ),
    "an origin": (
        lambda t, r: (t.assign(y_m=t["y_m"] + 0.3), r),
        "All are explained but for one shift (+300 mm in y_m)",
    ),
    "axes": (
        lambda t, r: (t.assign(y_m=t["z_m"], z_m=-t["y_m"]), r.assign(q=np.nan)),
        "With x_m, -z_m, y_m for x_m, y_m, z_m all are explained",
    ),
    "a marker that was lost": (
        lambda t, r: (t.assign(**{x: t[x].where(t["marker"] != "hand", 0.01) for x in ("x_m", "y_m", "z_m")}), r),
        'All but marker "hand" are explained, which is seen',
    ),
    "lengths": (
        lambda t, r: (t.assign(x_m=1.5 * t["x_m"], y_m=1.5 * t["y_m"]), r),
        "Check lengths, the names of markers, and axes, origin and unit",
    ),
}


def test_nothing_is_said_of_a_study_that_the_drawing_explains(arm):
    assert told(arm) == []


def test_a_camera_off_by_two_percent_is_no_slip(arm):
    assert told(arm, lambda t, r: (t.assign(x_m=1.02 * t["x_m"] + 0.001, y_m=1.02 * t["y_m"]), r)) == []


@pytest.mark.parametrize("slip", SLIPS)
def test_a_slip_is_told_with_what_would_explain_it(arm, slip):
    change, said = SLIPS[slip]
    (sentence,) = told(arm, change)
    assert sentence.startswith("experiment 'e1': no pose of the drawing explains its first samples, ")
    assert said in sentence
    assert "Nor does one explain those of 'e2' (" in sentence


def test_what_a_fit_would_refuse_is_refused(arm):
    tracks, _ = tables((0.5, 0.7))
    shot = Experiment("e1", "fit", Release(time_s=0.2), tracks=tracks.assign(x_m=0.1, y_m=0.1, z_m=0.0))
    refused, warned = unexplained(Study(arm, (shot,)))
    assert warned == []
    assert refused[0].startswith("experiment 'e1', marker:")
    assert "Give sigma in the data" in refused[0]
