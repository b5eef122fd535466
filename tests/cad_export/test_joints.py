"""Axes from geometry, the frames of joints, and the fits of pins."""

import math

import cadquery as cq
import numpy as np
import pytest

from backend.mechanism.drawing_error import DrawingError
from cad_export import Axis, Drawing, bar, cylinder
from cad_export.placement import quaternion

PLATE = bar((0, "pin"), (100, "pin"))
LINK = bar((0, "hole"), (40, "hole"))


def drawing(link_at=(0, 0, 5.5), turn_deg=0.0, link=LINK, plate=PLATE):
    assembly = cq.Assembly(name="rig").add(plate, name="plate")
    assembly.add(link, name="link", loc=cq.Location(link_at, (0, 0, 1), turn_deg))
    made = Drawing(assembly)
    made.ground("plate")
    made.material(density_kg_per_m3=2700)
    return made


def pinned(made, link=LINK, plate=PLATE, **options):
    made.revolute("j", "plate", "link", cylinder(plate, (0, 0, 0)), cylinder(link, (0, 0, 0)), **options)
    return made.mechanism().joint("j")


def world(body, frame):
    return np.array(body.pose.position_m) + body.pose.rotation() @ frame.position_m


def test_a_pin_in_a_hole_gives_the_joint_its_fit():
    fit = pinned(drawing()).fit
    assert fit.pin_diameter_m == 0.008
    assert fit.hole_diameter_m == 0.0081
    assert fit.radial_clearance_m == 5e-5
    assert fit.bearing_length_m == 0.005  # the pin is 5.5 long, half a millimetre of it in the gap
    assert fit.source == "drawn"


def test_the_two_frames_coincide_in_the_world_at_the_middle_of_the_bearing():
    made = drawing(turn_deg=37.0)
    joint, mechanism = pinned(made), made.mechanism()
    a, b = (world(mechanism.body(id), frame) for id, frame in (("plate", joint.frame_a), ("link", joint.frame_b)))
    np.testing.assert_allclose(a, [0, 0, 0.008], atol=1e-15)
    np.testing.assert_allclose(b, a, atol=1e-15)
    z_a = mechanism.body("plate").pose.rotation() @ joint.frame_a.rotation()
    z_b = mechanism.body("link").pose.rotation() @ joint.frame_b.rotation()
    np.testing.assert_allclose(z_b, z_a, atol=1e-15)  # q = 0 as drawn


def test_q_as_drawn_is_the_turn_of_frame_b_about_z():
    made = drawing(turn_deg=37.0)
    joint, mechanism = pinned(made, drawn_at_deg=20.0), made.mechanism()
    R_WF = mechanism.body("plate").pose.rotation() @ joint.frame_a.rotation()
    R_WG = mechanism.body("link").pose.rotation() @ joint.frame_b.rotation()
    R_FG = R_WF.T @ R_WG
    assert math.degrees(math.atan2(R_FG[1, 0], R_FG[0, 0])) == pytest.approx(20.0, abs=1e-12)


def test_parts_placed_apart_are_refused_with_the_gap_in_millimetres():
    with pytest.raises(DrawingError, match=r'joint "j": the axes on its two parts are 50 mm and 0° apart'):
        pinned(drawing(link_at=(50, 0, 5.5)))


def test_the_assembly_solvers_success_is_no_proof_that_parts_meet():
    assembly = cq.Assembly(name="rig").add(PLATE, name="plate")
    assembly.add(LINK, name="link", loc=cq.Location((0, 50, 5.5)))
    for fixed in ("plate", "link"):
        assembly.constrain(fixed, "Fixed")
    assembly.constrain("plate", cylinder(PLATE, (0, 0, 0)), "link", cylinder(LINK, (0, 0, 0)), "Axis", param=0)
    assembly.constrain("plate@faces@>Z", "link@faces@>Z", "Point")
    assembly.solve()
    assert assembly._solve_result["success"]
    made = Drawing(assembly)
    with pytest.raises(DrawingError, match="50 mm"):
        made.revolute("j", "plate", "link", cylinder(PLATE, (0, 0, 0)), cylinder(LINK, (0, 0, 0)))


def test_tilted_axes_are_refused():
    assembly = cq.Assembly(name="rig").add(PLATE, name="plate")
    assembly.add(LINK, name="link", loc=cq.Location((0, 0, 5.5), (1, 0, 0), 1.0))
    with pytest.raises(DrawingError, match=r"and 1° apart"):
        Drawing(assembly).revolute("j", "plate", "link", cylinder(PLATE, (0, 0, 0)), cylinder(LINK, (0, 0, 0)))


def test_a_pin_off_the_middle_but_within_its_play_is_accepted_with_a_warning():
    made = drawing(link_at=(0.03, 0, 5.5))
    joint = pinned(made)
    assert joint.frame_a.position_m[0] == 0.0
    assert joint.frame_b.position_m[0] == 0.0
    (warning,) = made.mechanism().provenance.warnings
    assert "0.03 mm off the middle of its hole, within 0.05 mm play" in warning


def test_a_pin_thicker_than_its_hole_is_refused():
    tight = bar((0, "hole"), (40, "hole"), hole_diameter_mm=7.9)
    with pytest.raises(DrawingError, match=r'joint "j": pin 8 mm is thicker than its hole 7.9 mm by 0.1 mm.*fixed'):
        pinned(drawing(link=tight), link=tight)


def test_a_pin_that_ends_before_its_hole_is_refused():
    with pytest.raises(DrawingError, match=r'joint "j": the pin ends 2 mm short of its hole'):
        pinned(drawing(link_at=(0, 0, 12.5)))


def test_a_hole_alone_says_what_it_knows():
    made = drawing()
    made.revolute("j", "link", "plate", axis=cylinder(LINK, (0, 0, 0)))
    fit = made.mechanism().joint("j").fit
    assert (fit.pin_diameter_m, fit.hole_diameter_m, fit.radial_clearance_m) == (None, 0.0081, None)


def test_two_holes_on_a_pin_that_is_not_drawn_claim_no_fit():
    plate = bar((0, "hole"), (100, "plain"))
    made = drawing(plate=plate)
    made.revolute("j", "plate", "link", cylinder(plate, (0, 0, 0)), cylinder(LINK, (0, 0, 0)))
    joint = made.mechanism().joint("j")
    assert joint.fit is None
    assert joint.frame_a.position_m[2] == pytest.approx(0.00525, abs=1e-15)  # the middle of the gap


SHAFT = cq.Workplane("YZ").circle(6).extrude(50).faces(">X").workplane().circle(4).extrude(20)
AXES = {
    "cylinder": (lambda s: cylinder(s, (60, 0, 0), 8.0), (60, 0, 0), (1, 0, 0)),
    "plane, out of the solid": (lambda s: s.faces("<X"), (0, 0, 0), (-1, 0, 0)),
    "circle": (lambda s: s.faces("<X").edges(), (0, 0, 0), (1, 0, 0)),
    "vector": (lambda s: ((1, 2, 3), (0, 0, -2)), (1, 2, 3), (0, 0, -1)),
    "Axis": (lambda s: Axis((1, 2, 3), (0, 5, 0)), (1, 2, 3), (0, 1, 0)),
}


@pytest.mark.parametrize("name", AXES)
def test_an_axis_may_be_a_face_an_edge_or_a_vector(name):
    select, point, direction = AXES[name]
    made = drawing(plate=SHAFT)
    made.revolute("j", "plate", "link", axis=select(SHAFT))
    frame = made.mechanism().joint("j").frame_a
    np.testing.assert_allclose(np.array(frame.position_m) * 1e3, point, atol=1e-12)
    np.testing.assert_allclose(frame.rotation()[:, 2], direction, atol=1e-12)


def test_a_straight_edge_guides_a_slide():
    rail = cq.Workplane().box(100, 10, 10)
    made = drawing(plate=rail, link_at=(10, 0, 20))
    made.prismatic("j", "plate", "link", axis=rail.edges("|X and >Y and >Z"), limits_mm=(-20, 30))
    joint = made.mechanism().joint("j")
    np.testing.assert_allclose(joint.frame_a.rotation()[:, 2], [1, 0, 0], atol=1e-12)
    assert (joint.limits.lower, joint.limits.upper) == (-0.02, 0.03)


def test_a_slides_q_is_the_way_between_its_two_points():
    made = drawing(link_at=(30, 0, 5.5))
    made.prismatic("j", "plate", "link", Axis((0, 0, 5.5), (1, 0, 0)), Axis((0, 0, 0), (-1, 0, 0)))
    mechanism = made.mechanism()
    joint = mechanism.joint("j")
    a, b = (world(mechanism.body(id), frame) for id, frame in (("plate", joint.frame_a), ("link", joint.frame_b)))
    np.testing.assert_allclose(b - a, [0.03, 0, 0], atol=1e-15)


def test_a_weld_needs_no_axis():
    made = drawing(link_at=(30, 1, 5.5), turn_deg=20)
    made.fixed("j", "plate", "link")
    mechanism = made.mechanism()
    assert mechanism.joint("j").frame_a.position_m == pytest.approx((0.03, 0.001, 0.0055), abs=1e-15)


def test_a_face_of_another_shape_is_refused():
    made = drawing()
    with pytest.raises(
        DrawingError, match=r'the face given as axis on "plate" is none of its \d+.*before it is placed'
    ):
        made.revolute("j", "plate", "link", axis=cylinder(LINK, (0, 0, 0)))


@pytest.mark.parametrize(
    ("axis", "sentence"),
    [
        (PLATE.faces(), r"selects \d+ objects; narrow"),
        (PLATE.val(), "give a face, an edge"),
        (((0, 0, 0), (0, 0, 0)), "direction has length 0"),
        (((0, 0), (0, 0, 1)), "three finite numbers"),
        (((0, 0, math.nan), (0, 0, 1)), "three finite numbers"),
    ],
)
def test_what_is_no_axis_is_refused(axis, sentence):
    with pytest.raises(DrawingError, match=sentence):
        drawing().revolute("j", "plate", "link", axis=axis)


def test_a_free_form_hole_has_no_axis():
    wire = cq.Workplane().spline([(3, 0), (0, 2), (-3, 0), (0, -2)], periodic=True).close()
    blob = wire.extrude(5)
    made = drawing(plate=blob)
    with pytest.raises(DrawingError, match=r"a face of type \w+ has no axis.*point_mm, direction"):
        made.revolute("j", "plate", "link", axis=blob.faces("not #Z and not |Z").faces("not %PLANE"))


def test_a_missing_cylinder_lists_those_there_are():
    with pytest.raises(
        DrawingError, match=r"no cylinder has its axis through \(5, 0, 0\) mm; there are: .*hole 8.1 mm, 5 mm off"
    ):
        cylinder(LINK, (5, 0, 0))
    tube = bar((0, "hole"), (40, "pin"), pin_diameter_mm=6).union(
        bar((0, "plain"), (40, "pin"), pin_diameter_mm=4, pin_length_mm=9)
    )
    with pytest.raises(DrawingError, match=r"2 cylinders.*pin 6 mm along .*say which with diameter_mm"):
        cylinder(tube, (40, 0, 0))


@pytest.mark.parametrize("seed", range(20))
def test_a_quaternion_turns_as_its_matrix_does(seed):
    rng = np.random.default_rng(seed)
    q = rng.normal(size=4) * rng.choice([1e-8, 1.0], size=4)  # half turns, where the trace is useless, among them
    q /= np.linalg.norm(q)
    w, x, y, z = q
    v = np.array([x, y, z])
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    rotation = (w * w - v @ v) * np.eye(3) + 2 * np.outer(v, v) + 2 * w * cross
    assert abs(quaternion(rotation) @ q) == pytest.approx(1.0, abs=1e-14)
