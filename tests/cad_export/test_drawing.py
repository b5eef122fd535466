"""Bodies of several parts, springs, effects, markers, and the written file."""

import json

import cadquery as cq
import numpy as np
import pytest
import trimesh

from backend.mechanism.drawing_error import DrawingError
from backend.mechanism.read import read_mechanism
from cad_export import Drawing

ARM = cq.Workplane().box(40, 10, 10)


def two_part_arm(second_at=(25, 0, 0), turn=90):
    """A frame, and an arm with a second, equal arm screwed across its end."""
    assembly = cq.Assembly(name="rig").add(cq.Workplane().box(5, 5, 5), name="frame", loc=cq.Location((0, 0, -50)))
    inner = cq.Assembly(name="arm", loc=cq.Location((0, 0, 20), (0, 1, 0), 40))
    inner.add(ARM, name="long").add(ARM, name="across", loc=cq.Location(second_at, (0, 0, 1), turn))
    drawing = Drawing(assembly.add(inner))
    drawing.ground("frame")
    drawing.material(density_kg_per_m3=1000)
    return drawing


def test_a_rigid_group_weighs_as_its_fused_solid():
    drawing = two_part_arm()
    drawing.rigid("long", "across")
    body = drawing.mechanism().body("arm/long")
    fused = ARM.val().fuse(ARM.val().moved(cq.Location((25, 0, 0), (0, 0, 1), 90)))
    assert body.inertial.mass_kg == pytest.approx(fused.Volume() * 1e-6, rel=1e-12)
    np.testing.assert_allclose(
        np.array(body.inertial.center_of_mass_m) * 1e3, cq.Shape.centerOfMass(fused).toTuple(), atol=1e-12
    )
    expected = np.array(cq.Shape.matrixOfInertia(fused)) * 1e-12
    np.testing.assert_allclose(body.inertial.inertia_kg_m2.matrix(), expected, atol=1e-12 * np.trace(expected))


def test_a_rigid_groups_meshes_are_in_its_body_axes(tmp_path):
    drawing = two_part_arm()
    drawing.rigid("long", "across")
    body = read_mechanism(drawing.write(tmp_path)).body("arm/long")
    assert len(body.meshes) == 2  # equal solids, but not equally placed in the body
    boxes = [trimesh.load_mesh(tmp_path / mesh.uri).bounds * mesh.scale_to_m for mesh in body.meshes]
    np.testing.assert_allclose(boxes[0], [[-0.02, -0.005, -0.005], [0.02, 0.005, 0.005]], atol=1e-8)
    np.testing.assert_allclose(boxes[1], [[0.02, -0.02, -0.005], [0.03, 0.02, 0.005]], atol=1e-8)  # float32 STL


def test_parts_of_a_rigid_group_that_share_volume_are_refused():
    drawing = two_part_arm(second_at=(15, 0, 0))
    drawing.rigid("long", "across")
    with pytest.raises(DrawingError, match=r'"arm/long": part "arm/long" and part "arm/across" overlap by 1000'):
        drawing.mechanism()


def test_points_on_a_grouped_part_are_moved_into_its_body():
    drawing = two_part_arm()
    drawing.rigid("long", "across")
    drawing.marker("tip", "across", (20, 0, 5))
    drawing.revolute("j", "frame", "across", axis=((0, 0, 0), (0, 1, 0)))
    mechanism = drawing.mechanism()
    assert mechanism.marker("tip").body == "arm/long"
    assert mechanism.marker("tip").position_m == pytest.approx((0.025, 0.02, 0.005), abs=1e-15)
    assert mechanism.joint("j").body_b == "arm/long"


def test_a_joint_inside_a_rigid_group_is_refused():
    drawing = two_part_arm()
    drawing.rigid("long", "across")
    with pytest.raises(DrawingError, match=r'joint "j": "arm/long" and "arm/across" are 1 body'):
        drawing.fixed("j", "long", "across")


def test_groups_come_before_what_refers_to_them():
    drawing = two_part_arm()
    drawing.marker("tip", "across", (0, 0, 0))
    with pytest.raises(DrawingError, match="comes after a joint, marker or effect"):
        drawing.rigid("long", "across")


def test_grounding_one_member_grounds_its_group():
    drawing = two_part_arm()
    drawing.rigid("frame", "across")
    mechanism = drawing.mechanism()
    assert [(body.id, body.fixed) for body in mechanism.bodies] == [("frame", True), ("arm/long", False)]


def test_nothing_grounded_is_refused():
    drawing = Drawing(cq.Assembly(name="rig").add(ARM, name="arm"))
    with pytest.raises(DrawingError, match=r'0 parts are grounded; call ground.*"arm"'):
        drawing.mechanism()


@pytest.mark.parametrize(
    ("declare", "sentence"),
    [
        (lambda d: d.marker("m", "long", (1, 2)), r'"m": point \(1, 2\) mm; give three finite numbers'),
        (lambda d: d.marker("m", "long", (1, 2, np.inf)), "three finite numbers"),
        (lambda d: d.marker("m", "long", "end"), r'"m": point end mm; give three finite numbers'),
        (lambda d: d.revolute("j", "frame", "long", ((0, 0, 0), (1, 0, 0)), limits_deg=90), "1 limits; write"),
        (
            lambda d: d.revolute("j", "frame", "long", ((0, 0, 0), (1, 0, 0)), drawn_at_deg=np.nan),
            "drawn_at_deg is nan",
        ),
        (lambda d: Drawing(cq.Assembly(ARM, name="a"), gravity_m_per_s2=9.8), r"gravity_m_per_s2 9.8; give three"),
        (lambda d: d.rigid("long"), r"rigid\(long\) names 1 parts; name two or more"),
        (lambda d: d.prismatic("j", "frame", "long", ((0, 0, 0), (1, 0, 0)), limits_mm=(1, 2, 3)), "3 limits; write"),
        (lambda d: Drawing(ARM), "on a cq.Assembly, not on a Workplane"),
        (lambda d: d.material("long", density_kg_per_m3=2.7), 'part "long" has density 2.7'),
        (lambda d: d.ground("Frame"), r'no part "Frame".*"frame"'),
    ],
)
def test_a_slip_in_a_declaration_is_named(declare, sentence):
    with pytest.raises(DrawingError, match=sentence):
        declare(two_part_arm())


def test_a_spring_without_a_free_length_is_slack_as_drawn():
    drawing = two_part_arm()
    drawing.extension_spring("s", "frame", "long", anchor_a_mm=(0, 0, 0), anchor_b_mm=(0, 0, 0), stiffness_n_per_m=100)
    spring = drawing.mechanism().effect("s")
    assert spring.parameters["free_length_m"] == pytest.approx(0.07, abs=1e-15)
    assert spring.on == ("frame", "arm/long")


def test_effects_take_the_names_of_parts_and_joints():
    drawing = two_part_arm()
    drawing.revolute("j", "frame", "long", axis=((0, 0, 0), (0, 1, 0)), limits_deg=(-90, None))
    drawing.torsion_spring("t", "j", stiffness_n_m_per_rad=0.2, rest_deg=180)
    drawing.effect("viscous_friction", "j", damping_n_m_s_per_rad=0.01)
    drawing.effect("air_drag", ["across", "long"], id="wind", drag_area_m2=1e-3)
    drawing.effect("applied_force", "long", force_n=2, direction=(0, 0, 1), point_m=(0.02, 0, 0))
    drawing.effect("coulomb_friction", "all", friction_torque_n_m=0.01)
    drawing.fixed("weld", "long", "across")
    mechanism = drawing.mechanism()
    assert mechanism.effect("t").parameters["rest_rad"] == pytest.approx(np.pi)
    assert mechanism.effect("viscous_friction_1").on == ("j",)
    assert mechanism.effect("wind").on == ("arm/across", "arm/long")
    assert mechanism.effect("applied_force_1").parameters["direction"] == (0.0, 0.0, 1.0)
    assert mechanism.effect("coulomb_friction_1").on == "all"
    assert mechanism.joint("j").limits.lower == pytest.approx(-np.pi / 2)
    assert mechanism.joint("j").limits.upper is None


def test_an_effect_without_a_name_gets_one_that_nothing_else_has():
    drawing = two_part_arm()
    drawing.revolute("j", "frame", "long", ((0, 0, 0), (1, 0, 0)))
    for id in ("viscous_friction_2", None, None):
        drawing.effect("viscous_friction", "j", id=id)
    names = [effect.id for effect in drawing.mechanism().effects]
    assert names == ["viscous_friction_2", "viscous_friction_1", "viscous_friction_3"]


def test_unknown_effects_and_parameters_list_the_known_ones():
    drawing = two_part_arm()
    with pytest.raises(DrawingError, match=r'effect kind "friction" is unknown.*"air_drag"'):
        drawing.effect("friction", "j")
    drawing.effect("air_drag", "long", drag=1.0)
    with pytest.raises(DrawingError, match=r'parameter "drag" is unknown to air_drag.*"drag_area_m2"'):
        drawing.mechanism()


def test_a_small_parts_inertia_is_written_with_every_digit(tmp_path):
    assembly = cq.Assembly(name="watch").add(ARM, name="plate").add(cq.Workplane().box(3, 0.7, 0.3), name="hand")
    drawing = Drawing(assembly)
    drawing.ground("plate")
    drawing.material(density_kg_per_m3=8500)
    inertia = read_mechanism(drawing.write(tmp_path)).body("hand").inertial.inertia_kg_m2
    mass = 3 * 0.7 * 0.3 * 1e-9 * 8500
    assert inertia.xx == pytest.approx(mass * (0.7**2 + 0.3**2) / 12 * 1e-6, rel=1e-12)  # 2.6e-13 kg m²
    assert inertia == drawing.mechanism().body("hand").inertial.inertia_kg_m2


def test_meshes_say_their_scale(tmp_path):
    drawing = two_part_arm()
    body = read_mechanism(drawing.write(tmp_path)).body("arm/long")
    mesh = trimesh.load_mesh(tmp_path / body.meshes[0].uri)
    np.testing.assert_allclose(mesh.extents * body.meshes[0].scale_to_m, [0.04, 0.01, 0.01], rtol=1e-6)


def test_the_file_says_when_and_with_what_it_was_made(tmp_path, monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "0")
    document = json.loads(two_part_arm().write(tmp_path).read_text("utf-8"))
    assert document["provenance"]["created"] == "1970-01-01T00:00:00Z"
    assert document["provenance"]["tool"] == "CadQuery"
    assert document["provenance"]["tool_version"] == cq.__version__
