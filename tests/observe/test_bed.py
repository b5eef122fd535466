import json

import numpy as np
import pytest

from backend.blind.camera import Bed as FilmedBed
from backend.blind.camera import Camera
from backend.observe.account import warn_height, warn_lens, warn_marks
from backend.observe.bed import Plane, read_bed
from backend.observe.project import calibrate, mark_residuals_px
from backend.observe.shared_error import error_of_marks_m, error_of_unknown_lens_m
from backend.observe.tracking_error import TrackingError

SPOTS = [(-0.25, -0.13), (0.25, -0.13), (0.25, 0.13), (-0.25, 0.13), (0.0, 0.14), (0.02, -0.12)]
POINTS = np.random.default_rng(1).uniform([-0.25, -0.13], [0.25, 0.13], (40, 2))


def marks(camera, spots=SPOTS):
    px = camera.project(np.c_[np.array(spots), np.zeros(len(spots))])
    return [
        {"id": f"b{k}", "x_m": x, "y_m": y, "x_px": u, "y_px": v}
        for k, ((x, y), (u, v)) in enumerate(zip(spots, px.tolist(), strict=True))
    ]


def test_four_marks_place_a_tilted_cameras_pixels_on_the_bed():
    camera = Camera(tilt_deg=(8, -5, 3))
    view = calibrate(read_bed(marks(camera, SPOTS[:4])), 1280, 720)
    px = camera.project(np.c_[POINTS, np.zeros(len(POINTS))])
    np.testing.assert_allclose(
        view.metres(px, np.zeros(40)), POINTS, atol=1e-7
    )  # marks are solved in single precision: 1e-4 px
    np.testing.assert_allclose(view.pixels(POINTS, np.zeros(40)), px, atol=1e-5)


@pytest.mark.parametrize("lens", [{"focal_px": 1600, "k1": -0.05}])
def test_a_known_lens_places_dots_at_any_known_height(lens):
    camera = Camera(tilt_deg=(8, -5, 3), k1=-0.05)
    view = calibrate(read_bed({"marks": marks(camera), "lens": lens}), 1280, 720)
    heights = np.linspace(0, 0.05, 40)
    px = camera.project(np.c_[POINTS, heights])
    np.testing.assert_allclose(view.metres(px, heights), POINTS, atol=2e-6)  # the pose solver stops near 1e-3 px
    np.testing.assert_allclose(view.pixels(POINTS, heights), px, atol=5e-3)


def test_a_bed_drawn_in_a_mirror_has_its_heights_towards_the_camera_too():
    camera = Camera()
    mirrored = [dict(m, y_m=-m["y_m"]) for m in marks(camera)]
    view = calibrate(read_bed({"marks": mirrored, "lens": {"focal_px": 1600}}), 1280, 720)
    heights = np.full(40, 0.02)
    px = camera.project(np.c_[POINTS, heights])
    np.testing.assert_allclose(view.metres(px, heights), POINTS * [1, -1], atol=2e-6)


def test_the_slope_of_a_view_is_its_derivative():
    view = calibrate(read_bed(marks(Camera(tilt_deg=(8, -5, 3)))), 1280, 720)
    px, flat = np.array([[300.0, 200.0], [900.0, 500.0]]), np.zeros(2)
    step = np.array([0.3, -0.2])
    moved = view.metres(px + step, flat) - view.metres(px, flat)
    np.testing.assert_allclose(moved, view.slope(px, flat) @ step, rtol=2e-3)  # curvature over 0.4 px


def test_an_upright_plane_leaves_the_depth_unmeasured():
    plane = Plane(origin_m=(0.1, 0.2, 0.3), y_axis=(0.0, 0.0, 1.0))
    world = plane.to_world(np.array([[0.01, 0.02]]))[0]
    np.testing.assert_allclose(world[[0, 2]], [0.11, 0.32])
    assert np.isnan(world[1])
    np.testing.assert_allclose(plane.from_world(np.array([0.11, 0.15, 0.32])), [0.01, 0.02, 0.05])


def test_the_renderers_bed_and_the_readers_plane_agree():
    axes = {"origin_m": (0.1, 0.2, 0.3), "x_axis": (0.0, 1.0, 0.0), "y_axis": (0.0, 0.0, 1.0)}
    p = np.random.default_rng(0).normal(size=(5, 3))
    np.testing.assert_allclose(FilmedBed({}, **axes).from_world(p), Plane(**axes).from_world(p), atol=1e-15)


@pytest.mark.parametrize("count", [0, 1, 3])
def test_fewer_than_four_marks_are_refused(count):
    with pytest.raises(TrackingError, match=f"^{count} bed marks are given"):
        read_bed(marks(Camera())[:count])


@pytest.mark.parametrize(
    "spots",
    [
        [(0, 0), (0.1, 0), (0.2, 0), (0.3, 0)],
        [(0, 0), (0.1, 0), (0.2, 0), (0.1, 0.1)],
        [(0, 0), (0.1, 0.00005), (0.2, 0), (0.1, 0.1)],
        [(0, 0), (0, 0), (0.2, 0), (0.1, 0.1)],
    ],
)
def test_marks_on_a_line_are_refused(spots):
    with pytest.raises(TrackingError, match="lie on a line"):
        read_bed(marks(Camera(), spots))


@pytest.mark.parametrize(
    ("bed", "says"),
    [
        ([{"id": "a", "x_m": 0, "y_m": 0, "x_px": 1}], "y_px"),
        ([{"id": "a", "x_m": 0, "y_m": 0, "x_px": 1, "y_px": 2, "colour": 1}], "colour"),
        ([{"id": "a", "x_m": float("nan"), "y_m": 0, "x_px": 1, "y_px": 2}], "x_m"),
        ({"marks": [], "plane": {"x_axis": [1, 1, 0]}}, "right angle"),
        ({"marks": [], "lens": {"focal_px": -5}}, "focal_px"),
        (7, "bed marks"),
    ],
)
def test_a_faulty_description_is_refused_by_field(bed, says):
    with pytest.raises(TrackingError, match=says):
        read_bed(bed)


def test_a_repeated_mark_and_an_unreadable_file_are_refused(tmp_path):
    with pytest.raises(TrackingError, match="b0 is given twice"):
        read_bed([*marks(Camera()), marks(Camera())[0]])
    (tmp_path / "bed.json").write_text("[{")
    with pytest.raises(TrackingError, match=r"bed\.json cannot be read as JSON"):
        read_bed(tmp_path / "bed.json")
    (tmp_path / "bed.json").write_text(json.dumps(marks(Camera())))
    assert len(read_bed(tmp_path / "bed.json").marks) == 6


def test_a_misplaced_mark_is_named():
    wrong = marks(Camera())
    wrong[2]["x_px"] += 30
    bed = read_bed(wrong)
    view = calibrate(bed, 1280, 720)
    assert mark_residuals_px(bed, view).max() > 3
    assert "Bed mark" in warn_marks(bed, view)[0]
    right = read_bed(marks(Camera()))
    assert warn_marks(right, calibrate(right, 1280, 720)) == []


def test_the_warning_of_unknown_height_is_the_error_that_height_makes():
    camera = Camera()
    bed = read_bed({"marks": marks(camera), "lens": {"focal_px": 1600}})
    view = calibrate(bed, 1280, 720)
    px = camera.project(np.c_[POINTS, np.full(40, 0.005)])
    worst = np.hypot(*(view.metres(px, np.zeros(40)) - POINTS).T).max()
    assert f"up to {1e3 * worst:.1f} mm" in warn_height(bed, view, px, 1280)[0]


@pytest.mark.parametrize("k1", [-0.1, 0.1])
def test_the_warning_of_an_unknown_lens_is_the_error_that_a_bent_one_makes(k1):
    """The filmed camera bends as much as is feared; how high it stands is known, so that its focal length is."""
    camera = Camera(k1=k1)
    bed = read_bed({"marks": marks(camera), "camera_height_m": camera.height_m, "marker_height_m": 0.0})
    view, level = calibrate(bed, 1280, 720), np.zeros(40)
    px = camera.project(np.c_[POINTS, level])
    told = error_of_unknown_lens_m(bed, view, px, level, (1280, 720))
    true = np.hypot(*(view.metres(px, level) - POINTS).T)
    assert told.max() == pytest.approx(true.max(), rel=0.3)
    assert f"up to {1e3 * told.max():.1f} mm" in warn_lens(told)[0]
    known = read_bed({"marks": marks(camera), "lens": {"focal_px": camera.focal_px, "k1": k1}})
    assert warn_lens(error_of_unknown_lens_m(known, calibrate(known, 1280, 720), px, level, (1280, 720))) == []


def test_the_calibrations_error_is_what_misplaced_marks_do():
    camera, rng = Camera(), np.random.default_rng(2)
    exact = marks(camera)
    bed = read_bed(exact)
    px = camera.project(np.c_[POINTS, np.zeros(40)])
    told = error_of_marks_m(bed, calibrate(bed, 1280, 720), px, np.zeros(40), (1280, 720))
    errors = []
    for _ in range(200):
        shaken = [dict(m, x_px=m["x_px"] + rng.normal(0, 0.5), y_px=m["y_px"] + rng.normal(0, 0.5)) for m in exact]
        errors.append(calibrate(read_bed(shaken), 1280, 720).metres(px, np.zeros(40)) - POINTS)
    made = np.sqrt((np.array(errors) ** 2).mean())
    assert told == pytest.approx(made, rel=0.15)  # 200 draws of 12 numbers: 4% expected, three times that allowed


def test_a_stick_gives_scale_turn_and_an_origin_outside_the_picture():
    """A camera square to the plane, turned by 5 degrees: one length is known, and where the pivot would be."""
    camera = Camera(tilt_deg=(0, 0, 5))
    a, b, pivot = camera.project(np.array([[-0.2, 0.05, 0], [0.1, -0.1, 0], [0.02, 0.6, 0]]))
    across = camera.project(np.array([[0.0, 0, 0], [0.1, 0, 0]]))
    du, dv = across[1] - across[0]
    stick = {
        "a_px": a.tolist(), "b_px": b.tolist(), "length_m": float(np.hypot(0.3, 0.15)), "origin_px": pivot.tolist(),
        "turn_deg": float(np.rad2deg(np.arctan2(-dv, du))),
    }  # fmt: skip
    bed = read_bed({"stick": stick})
    view, flat = calibrate(bed, 1280, 720), np.zeros(40)
    px = camera.project(np.c_[POINTS, flat])
    assert pivot[1] < 0
    np.testing.assert_allclose(view.metres(px, flat), POINTS - [0.02, 0.6], atol=1e-6)
    np.testing.assert_allclose(view.pixels(POINTS - [0.02, 0.6], flat), px, atol=1e-3)
    # Half a pixel at each end of 671 px, points up to 1.4 m from the origin that the stick's end carries.
    assert 3e-4 < error_of_marks_m(bed, view, px, flat, (1280, 720)) < 2e-3


@pytest.mark.parametrize(
    ("more", "says"), [({"marks": marks(Camera())}, "stands in for marks"), ({"lens": {"focal_px": 900}}, "stands in")]
)
def test_a_stick_stands_alone(more, says):
    stick = {"a_px": [10, 10], "b_px": [500, 10], "length_m": 0.5}
    with pytest.raises(TrackingError, match=says):
        read_bed({"stick": stick, **more})
    with pytest.raises(TrackingError, match="fall on one pixel"):
        read_bed({"stick": {**stick, "b_px": [10, 10]}})
