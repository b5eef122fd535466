"""Names, places and materials of parts in an assembly."""

import cadquery as cq
import numpy as np
import pytest
from OCP.gp import gp_Ax2, gp_Dir, gp_Pnt, gp_Trsf

from backend.mechanism.drawing_error import DrawingError
from backend.mechanism.read import read_mechanism
from cad_export import Drawing
from cad_export.assembly import find_part, parts_of

BLOCK = cq.Workplane().box(10, 20, 30)


def nested():
    inner = cq.Assembly(name="sub", loc=cq.Location((0, 0, 50), (0, 0, 1), 90))
    inner.add(BLOCK, name="coupler", loc=cq.Location((10, 0, 0)))
    return cq.Assembly(name="top", loc=cq.Location((1, 0, 0))).add(BLOCK, name="frame").add(inner)


def test_a_nested_part_has_a_path_for_a_name_and_stands_where_its_tree_puts_it():
    parts = parts_of(nested())
    assert list(parts) == ["frame", "sub/coupler"]
    # 10 mm along x, turned to y by the sub-assembly, then lifted 50 and shifted 1.
    np.testing.assert_allclose(parts["sub/coupler"].X_WP.position_mm, [1, 10, 50], atol=1e-12)
    np.testing.assert_allclose(parts["sub/coupler"].X_WP.rotation[:, 0], [0, 1, 0], atol=1e-12)


def test_places_agree_with_cadquerys_own_absolute_locations():
    own = {name.split("/", 1)[1]: location for _, name, location, _ in nested()}
    for path, part in parts_of(nested()).items():
        np.testing.assert_allclose(part.X_WP.position_mm, own[path].toTuple()[0], atol=1e-12)


def test_the_end_of_a_path_is_enough_where_it_is_unique():
    parts = parts_of(nested())
    assert find_part(parts, "coupler").path == "sub/coupler"
    with pytest.raises(DrawingError, match=r'no part "crank".*"frame", "sub/coupler"'):
        find_part(parts, "crank")


def test_an_ambiguous_end_asks_for_the_path():
    assembly = cq.Assembly(name="top")
    for side in ("left", "right"):
        assembly.add(cq.Assembly(name=side).add(BLOCK, name="bar"))
    with pytest.raises(DrawingError, match=r'"bar" names 2 parts.*"left/bar", "right/bar"'):
        find_part(parts_of(assembly), "bar")


def test_names_that_make_the_same_path_are_refused():
    assembly = cq.Assembly(name="top").add(BLOCK, name="s/t").add(cq.Assembly(name="s").add(BLOCK, name="t"))
    with pytest.raises(DrawingError, match='part "s/t" stands twice'):
        parts_of(assembly)


def test_a_part_without_a_name_is_refused_for_its_name_would_change_with_each_run():
    with pytest.raises(DrawingError, match=r'a part of "top" has no name.*name="crank"'):
        parts_of(cq.Assembly(name="top").add(BLOCK))


def test_a_mirrored_place_is_refused():
    mirror = gp_Trsf()
    mirror.SetMirror(gp_Ax2(gp_Pnt(0, 0, 0), gp_Dir(1, 0, 0)))
    with pytest.raises(DrawingError, match=r'part "a" stands in a scaled or mirrored location \(scale -1\)'):
        parts_of(cq.Assembly(name="top").add(BLOCK, name="a", loc=cq.Location(mirror)))


def test_unicode_names_survive_and_name_plain_mesh_files(tmp_path):
    assembly = cq.Assembly(name="Gestänge").add(BLOCK, name="Rahmen").add(BLOCK.translate((9, 0, 0)), name="曲柄")
    assembly.add(BLOCK.translate((0, 9, 0)), name="Kröpfung").add(BLOCK.translate((0, 0, 9)), name="KR_PFUNG")
    drawing = Drawing(assembly)
    drawing.ground("Rahmen")
    drawing.material(density_kg_per_m3=1000)
    mechanism = read_mechanism(drawing.write(tmp_path))
    assert [body.id for body in mechanism.bodies] == ["Rahmen", "曲柄", "Kröpfung", "KR_PFUNG"]
    files = [mesh.uri for body in mechanism.bodies for mesh in body.meshes]
    # Two names that differ in case only would be one file on some systems.
    assert files == ["meshes/Rahmen.stl", "meshes/part.stl", "meshes/Kr_pfung.stl", "meshes/KR_PFUNG-2.stl"]
    assert sorted(path.name for path in (tmp_path / "meshes").iterdir()) == sorted(f[7:] for f in files)


def test_occurrences_of_one_solid_share_mass_and_mesh_but_not_place():
    assembly = cq.Assembly(name="top").add(BLOCK, name="frame")
    assembly.add(BLOCK, name="one", loc=cq.Location((50, 0, 0), (0, 1, 0), 30))
    assembly.add(BLOCK, name="two", loc=cq.Location((0, 50, 0)))
    drawing = Drawing(assembly)
    drawing.ground("frame")
    drawing.material(density_kg_per_m3=1000)
    one, two = drawing.mechanism().moving_bodies()
    assert one.inertial == two.inertial  # in body axes, so turning the occurrence changes nothing
    assert one.meshes == two.meshes
    assert one.pose != two.pose


def test_a_solid_moved_before_it_is_added_keeps_its_own_coordinates():
    shifted = cq.Assembly(name="top").add(BLOCK.val().moved(cq.Location((5, 0, 0))), name="a")
    drawing = Drawing(shifted)
    drawing.ground("a")
    drawing.material(density_kg_per_m3=1000)
    (body,) = drawing.mechanism().bodies
    assert body.pose.position_m == (0.0, 0.0, 0.0)
    assert body.inertial.center_of_mass_m == pytest.approx((0.005, 0.0, 0.0), abs=1e-15)


def _mass(material=None, inherited=None, **drawn):
    inner = cq.Assembly(name="sub", material=inherited).add(BLOCK, name="b", material=material)
    drawing = Drawing(cq.Assembly(name="top").add(BLOCK, name="frame").add(inner))
    drawing.ground("frame")
    for part, density in drawn.items():
        drawing.material(*([] if part == "every" else [part]), density_kg_per_m3=density)
    mechanism = drawing.mechanism()
    return mechanism.body("sub/b").inertial.mass_kg, mechanism.provenance.warnings


def test_density_comes_from_the_part_or_the_tree_or_the_call_in_its_own_unit():
    pla = cq.Material("PLA", density=1.24)  # g/cm^3 unless told otherwise
    assert _mass(pla)[0] == pytest.approx(6e-6 * 1240, rel=1e-12)
    assert _mass(None, pla)[0] == pytest.approx(6e-6 * 1240, rel=1e-12)
    assert _mass(cq.Material("PLA", density=1240, densityUnit="kg/m^3"))[0] == pytest.approx(6e-6 * 1240, rel=1e-12)
    assert _mass(pla, every=2700)[0] == pytest.approx(6e-6 * 1240, rel=1e-12)
    assert _mass(pla, b=2700)[0] == pytest.approx(6e-6 * 2700, rel=1e-12)


def test_a_density_in_kg_per_m3_that_claims_to_be_g_per_cm3_is_refused():
    with pytest.raises(DrawingError, match=r'part "sub/b" has density 1.24e\+06 kg/m³.*densityUnit="kg/m\^3"'):
        _mass(cq.Material("PLA", density=1240))


def test_an_unknown_density_unit_lists_the_known_ones():
    with pytest.raises(DrawingError, match=r'unknown unit "lb/in\^3".*"g/cm\^3"'):
        _mass(cq.Material("PLA", density=0.045, densityUnit="lb/in^3"))


def test_a_material_by_name_alone_weighs_as_steel_and_says_so():
    mass, warnings = _mass("PLA")
    assert mass == pytest.approx(6e-6 * 7850, rel=1e-12)
    assert any('"PLA" has CadQuery\'s default density, 7850' in warning for warning in warnings)
    assert _mass("stainless steel")[1] == ()


def test_a_moving_part_without_density_is_refused():
    with pytest.raises(DrawingError, match=r'part "sub/b" moves but has no density \(mass 0 kg\)'):
        _mass()


def test_a_step_file_scrambles_what_memory_keeps(tmp_path):
    """Why the exporter reads the assembly and not a file."""
    assembly = cq.Assembly(name="top")
    for name in ("one", "two"):
        assembly.add(cq.Assembly(name=f"{name}_side").add(BLOCK, name="bar"), loc=cq.Location((50, 0, 0)))
    assembly.export(str(tmp_path / "a.step"))
    assert list(parts_of(assembly)) == ["one_side/bar", "two_side/bar"]
    assert set(parts_of(cq.Assembly.importStep(str(tmp_path / "a.step")))) != {"one_side/bar", "two_side/bar"}
