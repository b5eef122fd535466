"""The same parts through Fusion's numbers and through CadQuery's own: one mechanism."""

import importlib.util
from pathlib import Path

import cadquery as cq
import numpy as np
import pytest
import trimesh

from backend.mechanism.graph import describe
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.read import read_mechanism
from cad_export import Drawing, bar
from tests.plugin_fusion import fakes
from tests.plugin_fusion.addin import room
from tests.plugin_fusion.from_cadquery import fusion_design, fusion_properties, world_line

SAMPLES = Path(__file__).resolve().parents[2] / "samples"
EXACT = 1e-6  # relative, of the trace: OpenCASCADE's two integrals of one solid agree to 1e-9


def exported(design: fakes.Fake, folder: Path, **reading):
    """The design through the add-in's reader and its files."""
    (folder / "raw").mkdir()
    bundle = room("lib.bundle")
    application = fakes.application(**reading)
    bundle.save_snapshot(room("lib.reader").read_design(design, application, folder), folder)
    return bundle.save(folder)


def sample(name: str, **settings) -> Drawing:
    spec = importlib.util.spec_from_file_location(f"{name}_design", SAMPLES / name / "design.py")
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.design(**settings)


@pytest.fixture(scope="module")
def fourbar() -> Drawing:
    return sample("fourbar")


@pytest.fixture(scope="module")
def both(fourbar, tmp_path_factory) -> tuple[Mechanism, Mechanism, Path]:
    """The four-bar as CadQuery writes it, and as the add-in does."""
    folder = tmp_path_factory.mktemp("fourbar")
    saved = exported(fusion_design(fourbar, 2700.0), folder)
    assert saved.problems == ()
    assert list(saved.warnings) == []
    return fourbar.mechanism(), read_mechanism(saved.mechanism), folder


def test_mass_properties_of_every_body_agree(both):
    drawn, made, _ = both
    for body in drawn.bodies:
        expected, found = body.inertial, made.body(body.id).inertial
        assert found.mass_kg == pytest.approx(expected.mass_kg, rel=EXACT)
        np.testing.assert_allclose(found.center_of_mass_m, expected.center_of_mass_m, atol=EXACT * 0.1)
        inertia = expected.inertia_kg_m2.matrix()
        np.testing.assert_allclose(found.inertia_kg_m2.matrix(), inertia, atol=EXACT * np.trace(inertia))


def test_bodies_stand_and_joints_lie_as_drawn(both):
    drawn, made, _ = both
    for body in drawn.bodies:
        pose = made.body(body.id).pose
        np.testing.assert_allclose(pose.position_m, body.pose.position_m, atol=1e-15)
        np.testing.assert_allclose(pose.rotation(), body.pose.rotation(), atol=1e-12)
    for joint in drawn.joints:
        same = made.joint(joint.id)
        assert (same.body_a, same.body_b, same.type) == (joint.body_a, joint.body_b, joint.type)
        for side in "ab":
            body, frame = getattr(same, f"body_{side}"), getattr(same, f"frame_{side}")
            wanted = world_line(drawn, getattr(joint, f"body_{side}"), getattr(joint, f"frame_{side}"))
            for found, expected in zip(world_line(made, body, frame), wanted, strict=True):
                np.testing.assert_allclose(found, expected, atol=1e-9)
    assert describe(made).closes


def test_the_fit_of_every_pin_is_found(both):
    drawn, made, _ = both
    for joint in drawn.joints:
        assert made.joint(joint.id).fit == joint.fit


def test_meshes_are_in_millimetres_in_body_axes(both):
    _, made, folder = both
    for body in made.bodies:
        (mesh,) = body.meshes
        read = trimesh.load(folder / mesh.uri)
        assert isinstance(read, trimesh.Trimesh)
        assert mesh.scale_to_m == 1e-3
        assert read.is_watertight
        mass, center = body.inertial.mass_kg, body.inertial.center_of_mass_m
        assert read.volume * mesh.scale_to_m**3 * 2700.0 == pytest.approx(mass, rel=1e-2)  # flats for curves
        np.testing.assert_allclose(read.center_mass * mesh.scale_to_m, center, atol=1e-4)


def test_rigid_groups_weigh_as_cadquerys_rigid_bodies_do(tmp_path):
    """Three bars at angles in space, one body: the shift and the turn of every inertia are in it."""
    assembly = cq.Assembly(name="knot")
    assembly.add(bar((0, "pin"), (30, "plain")), name="stand")
    places = [((0, 0, 6), (0, 0, 1), 20), ((90, 10, 40), (1, 2, 3), 77), ((-60, 5, 90), (3, -1, 1), 200)]
    for n, place in enumerate(places):
        assembly.add(bar((0, "hole"), (40 + 10 * n, "pin")), name=f"link{n}", loc=cq.Location(*place))
    drawing = Drawing(assembly)
    drawing.ground("stand")
    drawing.material(density_kg_per_m3=2700)
    links = [f"link{n}" for n in range(3)]
    parts = fusion_design(drawing_with(drawing, "pivot", links[0]), 2700.0, groups=[links])
    made = read_mechanism(exported(parts, tmp_path).mechanism)

    together = Drawing(assembly)
    together.ground("stand")
    together.material(density_kg_per_m3=2700)
    together.rigid(*links)
    expected = together.mechanism().body("link0")
    found = made.body("link0")
    np.testing.assert_allclose(found.pose.position_m, expected.pose.position_m, atol=1e-15)
    np.testing.assert_allclose(found.pose.rotation(), expected.pose.rotation(), atol=1e-12)
    assert found.inertial.mass_kg == pytest.approx(expected.inertial.mass_kg, rel=EXACT)
    np.testing.assert_allclose(found.inertial.center_of_mass_m, expected.inertial.center_of_mass_m, atol=EXACT * 0.1)
    inertia = expected.inertial.inertia_kg_m2.matrix()
    np.testing.assert_allclose(found.inertial.inertia_kg_m2.matrix(), inertia, atol=EXACT * np.trace(inertia))
    assert len(found.meshes) == 3


def drawing_with(drawing: Drawing, id: str, link: str) -> Drawing:
    drawing.revolute(id, "stand", link, axis=((0, 0, 5), (0, 0, 1)))
    return drawing


@pytest.mark.parametrize("offset", [(0, 0, 0), (400, -300, 250)])
def test_the_shift_to_the_centre_of_mass_agrees_far_from_the_origin_too(offset):
    wedge = cq.Workplane("XY").polyline([(0, 0), (50, 0), (0, 20)]).close().extrude(7).val().moved(cq.Location(offset))
    told = fusion_properties(wedge, 7850.0)
    moments = told.getXYZMomentsOfInertia()[1:]
    center = (told.centerOfMass.x, told.centerOfMass.y, told.centerOfMass.z)
    found = room("lib.mass").from_fusion(told.mass, center, moments, integrals=False)
    expected = np.array(cq.Shape.matrixOfInertia(wedge)) * 1e-9 * 7850.0 * 0.01
    assert abs(expected[0, 1]) > 0.01 * np.trace(expected), "a wedge has products"
    np.testing.assert_allclose(found.inertia, expected, atol=EXACT * np.trace(expected))


def test_the_bars_and_pins_of_a_scissor_come_out_as_drawn(tmp_path):
    drawing = sample("scissor", cells=2, spring_n_per_m=0.0)
    saved = exported(fusion_design(drawing, 2700.0), tmp_path)
    made, drawn = read_mechanism(saved.mechanism), drawing.mechanism()
    assert {body.id for body in made.bodies} == {body.id for body in drawn.bodies}
    revolutes = [joint.id for joint in drawn.joints if joint.type == "revolute"]
    assert [joint.id for joint in made.joints] == revolutes
    for id in revolutes:
        assert made.joint(id).fit == drawn.joint(id).fit
