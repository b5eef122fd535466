"""A bar that SciPy moved, seen by a tilted camera whose calibration is off by one standard deviation."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from backend.mechanism.study import Study
from backend.observe.bed import read_bed
from backend.observe.camera import Camera, Deviations, write_camera
from backend.observe.camera_in_clip import camera_in_clip
from tests.observe.filmed_fourbar import SIZE, TAGS, Eye

from .test_diagnosis import COARSE_S, FEW, RUB, drawing, rubbing, study  # noqa: F401 (a fixture)

TRUE_EYE = Eye(1000.0, (643.0, 357.0), k1=-0.10, height_m=0.62, tilt_rad=(0.10, -0.07, 0.02), look_at_m=(0.0, -0.15))
HEIGHT_M, RULER_M = 0.012, 0.003  # of the dots, and how well a ruler knows it
FOCAL_SD, K1_SD = 2.0, 2e-3


def camera_off_by_one_sd(path):
    """The lens and the heights in the file are each one deviation off; the pose follows from tags."""
    sd = np.array([FOCAL_SD, FOCAL_SD, 1.0, 1.0, K1_SD, 0, 0, 0, 0])
    lens = Camera(
        image_size_px=SIZE, focal_px=(1000.0 + FOCAL_SD, 1000.0 + FOCAL_SD), centre_px=TRUE_EYE.centre_px,
        k1=TRUE_EYE.k1 + K1_SD, k2=0.0, p1=0.0, p2=0.0, k3=0.0, views=20, coverage=0.9, reprojection_rms_px=0.06,
        sd=Deviations(focal_px=(sd[0], sd[1]), centre_px=(sd[2], sd[3]), k1=sd[4], k2=0, p1=0, p2=0, k3=0),
        covariance=tuple(map(tuple, np.diag(sd**2).tolist())),
    )  # fmt: skip
    spots = np.array(TAGS) + TRUE_EYE.look_at_m
    marks = [
        {"id": f"tag {k}", "x_m": x, "y_m": y, "x_px": u, "y_px": v}
        for k, ((x, y), (u, v)) in enumerate(
            zip(spots.tolist(), TRUE_EYE.pixels(np.c_[spots, np.zeros(len(spots))]).tolist(), strict=True)
        )
    ]
    heights = {"tip": HEIGHT_M + RULER_M, "mid": HEIGHT_M + RULER_M}
    upright = {"origin_m": [0, 0, 0], "x_axis": [1, 0, 0], "y_axis": [0, 0, 1]}
    bed = read_bed(
        {"marks": marks, "plane": upright, "marker_height_m": heights, "marker_height_sd_m": RULER_M, "mark_sd_m": 0.0}
    )
    return write_camera(camera_in_clip(lens, bed, ("tip", "mid"), np.zeros((0, 2, 2)), SIZE), path)


def filmed(told, camera):
    """The study's places as pixels of the true camera, with the file of the wrong one."""
    made = []
    for e in told.experiments:
        px = TRUE_EYE.pixels(np.c_[e.tracks[["x_m", "z_m"]], np.full(len(e.tracks), HEIGHT_M)])
        seen = e.tracks.assign(x_px=px[:, 0], y_px=px[:, 1], x_m=np.nan, z_m=np.nan)
        made.append(replace(e, tracks=seen, camera=camera))
    return Study(told.mechanism, tuple(made))


def taken_at_its_word(told):
    """The same places on the bed, as if the file were exact."""
    from backend.fit.eye import Eye as Calibrated

    drawn = {"tip": np.zeros(3), "mid": np.zeros(3)}
    return Study(
        told.mechanism,
        tuple(replace(e, tracks=Calibrated.of(e).placed(e.tracks, drawn), camera=None) for e in told.experiments),
    )


@pytest.fixture(scope="module")
def camera(tmp_path_factory):
    return camera_off_by_one_sd(tmp_path_factory.mktemp("camera") / "camera.json")


def chance(told):
    """Probability of what the drawing leaves, from noise and what the camera's file allows."""
    from backend.diagnose.adequacy import adequacy
    from backend.diagnose.library import SMOOTH, library
    from backend.diagnose.subject import prepare
    from backend.diagnose.which import Search

    known = library(told.mechanism, SMOOTH, told.tolerances, FEW)
    search = Search(prepare(told, known, 1 / 60), lambda words: None, lambda: False)
    return adequacy(search.baseline().fitted, search.latent, np.random.default_rng(0)).p


@pytest.mark.nightly
def test_an_error_that_the_calibration_allows_is_no_gap(drawing, camera):  # noqa: F811
    from backend.diagnose.run import diagnose_study

    told = filmed(study(drawing, 2), camera)
    assert chance(taken_at_its_word(told)) < 1e-6  # it is there to be seen
    found = diagnose_study(told, without=FEW, step_s=COARSE_S).report
    assert found.verdict == "none"
    smallest = {d.kind: d.minimum for d in found.detectable}
    assert smallest["coulomb_friction"] < RUB  # friction would have been seen all the same


@pytest.mark.nightly
def test_a_cause_is_named_through_a_camera_that_is_a_little_off(drawing, camera):  # noqa: F811
    from backend.diagnose.run import diagnose_study

    told = filmed(study(drawing, 1, rubbing, angles=(0.9, -0.5, 1.4, 0.3), frames=84), camera)
    found = diagnose_study(told, without=FEW, step_s=COARSE_S).report
    assert found.verdict in ("identified", "ambiguous")
    assert found.causes[0].effects[0].kind in ("coulomb_friction", "stribeck_friction")
    assert found.where.locations[0].at == "joint:j1"


def test_shifts_of_samples_are_those_of_a_camera_that_moved_within_its_covariance(drawing, camera):  # noqa: F811
    from backend.diagnose.calibration import Misplaced, cameras_of
    from backend.fit.measured import measured
    from backend.model.build import build
    from backend.observe.viewpoint import LENS, POSE

    told, model = filmed(study(drawing, 2), camera), build(drawing)
    cameras = cameras_of(told)
    (eye,) = cameras.values()
    e = told.experiments[0]
    data = measured(e, model)
    made = Misplaced.of(data, model, cameras, camera)
    z = 0.3 * np.random.default_rng(0).standard_normal(eye.root.shape[1])
    change = eye.root @ z
    heights = np.array([eye.pose.marker_height_m[m] for m in e.tracks.marker])
    higher = np.array([change[eye.height_row(m)] for m in e.tracks.marker])
    px = e.tracks[["x_px", "y_px"]].to_numpy()
    before = eye.view.on_plane(px, eye.pose.plane, heights)
    after = eye.view.moved(change[: LENS + POSE]).on_plane(px, eye.pose.plane, heights + higher)
    shift = pd.DataFrame(before - after, columns=["x_m", "z_m"]).assign(marker=e.tracks.marker)
    of = {name: shift[shift.marker == name] for name in ("tip", "mid")}
    expected = np.concatenate([of[c.at.removeprefix("marker:")][c.coordinate] for c in data.channels])
    np.testing.assert_allclose(made.slopes(data.value) @ z, expected, atol=0.03 * np.abs(expected).max())
