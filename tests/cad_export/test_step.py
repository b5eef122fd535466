"""STEP files: the parts they hold, what they lost, and the script they begin."""

import cadquery as cq
import numpy as np
import pytest
from OCP.Interface import Interface_Static

from backend.mechanism.drawing_error import DrawingError
from backend.mechanism.read import read_mechanism
from cad_export import Drawing, begin, export_script
from cad_export.assembly import parts_of
from cad_export.script import draw
from cad_export.step import ALWAYS_LOST, read_step

BLOCK = cq.Workplane().box(10, 20, 30)
TWO_BLOCKS = cq.Compound.makeCompound([BLOCK.val(), BLOCK.translate((50, 0, 0)).val()])


@pytest.fixture(scope="module")
def fourbar(tmp_path_factory):
    path = tmp_path_factory.mktemp("step") / "fourbar.step"
    assembly = cq.Assembly(name="fourbar")
    for part in draw("samples/fourbar/design.py").parts.values():
        assembly.add(part.shape, name=part.path, loc=part.X_WP.location())
    assembly.export(str(path))
    return path


def test_parts_keep_their_names_frames_and_places(fourbar):
    drawn, read = draw("samples/fourbar/design.py").parts, parts_of(read_step(fourbar).assembly)
    assert list(read) == list(drawn)
    for path, part in read.items():
        np.testing.assert_allclose(part.X_WP.position_mm, drawn[path].X_WP.position_mm, atol=1e-9)
        np.testing.assert_allclose(part.X_WP.rotation, drawn[path].X_WP.rotation, atol=1e-9)


def test_a_step_file_becomes_the_mechanism_that_was_drawn(fourbar, tmp_path):
    begun = begin(fourbar, tmp_path)
    assert "proposed, to be confirmed" in begun.picture.read_text()
    read = read_mechanism(export_script(begun.script, tmp_path, {"density_kg_per_m3": 2700}))
    drawn = draw("samples/fourbar/design.py").mechanism()
    assert [body.id for body in read.bodies if body.fixed] == ["frame"]  # the guess
    for body in drawn.bodies:
        if not body.fixed:
            assert read.body(body.id).inertial.mass_kg == pytest.approx(body.inertial.mass_kg, rel=1e-9)
    at = [
        {tuple(np.round(joint.frame_a.position_m, 9)): (joint.body_a, joint.body_b, joint.fit) for joint in of.joints}
        for of in (read, drawn)
    ]
    assert at[0] == at[1]
    assert any("read from STEP, which holds no joints" in words for words in read.provenance.warnings)


def test_a_script_that_was_corrected_is_not_written_over(fourbar, tmp_path):
    script = tmp_path / "design.py"
    script.write_text("# corrected")
    with pytest.raises(DrawingError, match=r"may hold corrections.*another --out"):
        begin(fourbar, tmp_path)
    assert script.read_text() == "# corrected"


def test_parts_without_a_name_are_numbered_and_said_to_be(tmp_path):
    path = tmp_path / "nameless.step"
    cq.exporters.export(cq.Workplane(TWO_BLOCKS), str(path))
    read = read_step(path)
    assert list(parts_of(read.assembly)) == ["part", "part-2"]
    assert read.lost[-1] == "names of 2 parts, which have none; here part, part-2"


def test_parts_that_cadquery_named_itself_have_no_name(tmp_path):
    assembly = cq.Assembly(name="m").add(BLOCK, name="frame").add(cq.Workplane().box(5, 5, 5))
    assembly.export(str(tmp_path / "m.step"))
    read = read_step(tmp_path / "m.step")
    assert list(parts_of(read.assembly)) == ["frame", "part"]
    assert "the name of a part, which has none; here part" in read.lost


def test_names_in_every_script_come_back_from_cadquerys_file_and_from_others(tmp_path):
    names = ["Gehäuse", "曲柄 1"]
    assembly = cq.Assembly(name="m").add(BLOCK, name=names[0]).add(BLOCK, name=names[1], loc=cq.Location((50, 0, 0)))
    path = tmp_path / "m.step"
    assembly.export(str(path))
    assert list(parts_of(read_step(path).assembly)) == names
    written = path.read_bytes()
    twice = "Gehäuse".encode().decode("latin-1").encode()  # as CadQuery writes it
    assert twice in written
    path.write_bytes(written.replace(twice, rb"Geh\X2\00E4\X0\use"))  # as ISO 10303-21 says
    assert list(parts_of(read_step(path).assembly)) == names


def test_a_name_that_stands_twice_is_numbered_and_said_to_be(tmp_path):
    path = tmp_path / "twice.step"
    cq.Assembly(name="top").add(BLOCK, name="bar").add(BLOCK, name="second").export(str(path))
    path.write_text(path.read_text().replace("'second'", "'bar'"))
    read = read_step(path)
    assert list(parts_of(read.assembly)) == ["bar", "bar-2"]
    assert read.lost[-1] == 'names of 2 parts, all "bar" in the file; here bar, bar-2'


def test_one_part_of_several_solids_is_taken_apart_and_said_to_be(tmp_path):
    path = tmp_path / "flat.step"
    Interface_Static.SetIVal_s("write.step.assembly", 0)  # as programs write that know no parts
    try:
        cq.exporters.export(cq.Workplane(TWO_BLOCKS), str(path))
    finally:
        Interface_Static.SetIVal_s("write.step.assembly", 2)
    read = read_step(path)
    assert list(parts_of(read.assembly)) == ["solid-1", "solid-2"]
    assert read.lost[: len(ALWAYS_LOST)] == ALWAYS_LOST
    assert "the file is 1 part of 2 solids" in read.lost[-1]
    drawing = Drawing.from_step(path)
    drawing.ground("solid-1", "solid-2")
    assert any("lost in STEP: the tree of parts" in words for words in drawing.mechanism().provenance.warnings)


def test_a_file_in_inches_is_read_in_millimetres(tmp_path):
    path = tmp_path / "inch.step"  # CadQuery writes its numbers as they are, as inches
    cq.Assembly(name="top").add(BLOCK, name="block").export(str(path), unit="INCH")
    (part,) = parts_of(read_step(path).assembly).values()
    size = part.shape.BoundingBox()
    assert "CONVERSION_BASED_UNIT" in path.read_text()
    assert (size.xlen, size.ylen, size.zlen) == pytest.approx((254, 508, 762), abs=1e-6)


@pytest.mark.parametrize(
    ("content", "says"),
    [(None, "is not a file"), (b"ISO-10303-21;\nnothing", "cannot be read as STEP"), (b"\x00\x01", "cannot be read")],
)
def test_what_is_no_step_file_is_refused_in_a_sentence(tmp_path, content, says):
    path = tmp_path / "wrong.step"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(DrawingError, match=says):
        read_step(path)
