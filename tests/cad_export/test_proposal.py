"""Joints proposed from pins and holes, confirmed, and overridden by declared ones."""

import cadquery as cq
import pytest

from backend.mechanism.drawing_error import DrawingError
from cad_export import Drawing, bar, cylinder
from cad_export.picture import proposal_svg
from cad_export.script import draw

SAMPLES = {
    "pendulum": set(), "double_pendulum": set(), "fourbar": set(), "bennett": set(), "scissor": {"guide"},
    "slider_crank": {"rail"},
}  # fmt: skip
BLOCK = cq.Workplane().box(30, 30, 10)


def rod(diameter_mm: float, *at: tuple[float, float], tilt_deg: float = 0.0) -> cq.Workplane:
    """A base under z = -5, with pins that rise from it through z = 0."""
    return _round(cq.Workplane().box(60, 60, 4).translate((0, 0, -7)), diameter_mm, at, (-7, 10), tilt_deg, "union")


def plate(diameter_mm: float, *at: tuple[float, float]) -> cq.Workplane:
    return _round(cq.Workplane().box(60, 60, 8), diameter_mm, at, (-10, 10), 0.0, "cut")


def _round(body, diameter_mm, at, span_mm, tilt_deg, how):
    for x, y in at:
        low, high = span_mm
        column = cq.Workplane().circle(0.5 * diameter_mm).extrude(high - low).translate((0, 0, low))
        body = getattr(body, how)(column.rotate((0, 0, 0), (0, 1, 0), tilt_deg).translate((x, y, 0)))
    return body


def two(carrier, carried, off_mm: float = 0.0) -> Drawing:
    assembly = cq.Assembly(name="rig").add(carrier, name="base")
    assembly.add(carried, name="arm", loc=cq.Location((off_mm, 0, 0)))
    drawing = Drawing(assembly)
    drawing.ground("base")
    drawing.material(density_kg_per_m3=2700)
    return drawing


@pytest.mark.parametrize("sample", SAMPLES)
def test_the_proposals_are_the_joints_that_a_sample_declares_but_for_its_grooves(sample):
    drawing = draw(f"samples/{sample}/design.py")
    drawn = {joint.id: joint for joint in drawing.mechanism().joints}
    proposed = {one.declared[0]: one for one in drawing.propose() if one.declared}
    assert len(drawing.propose()) == len(proposed)  # nothing that is none
    assert set(drawn) - set(proposed) == SAMPLES[sample]
    for id, one in proposed.items():
        assert (one.type, one.fit.json()) == (drawn[id].type, drawn[id].fit.model_dump(exclude_none=True))


def test_a_confirmed_proposal_is_the_joint_as_declared():
    declared, confirmed = (two(rod(8, (0, 0)), plate(8.1, (0, 0)), 0.03) for _ in range(2))
    base, arm = (declared.parts[name].shape for name in ("base", "arm"))
    declared.revolute("pivot", "base", "arm", cylinder(base, (0, 0, 0)), cylinder(arm, (0, 0, 0)), drawn_at_deg=20)
    confirmed.confirm("base-arm", "pivot", drawn_at_deg=20)
    assert confirmed.mechanism().joints == declared.mechanism().joints


def test_play_and_a_pin_off_the_middle_are_told():
    (one,) = two(rod(8, (0, 0)), plate(8.1, (0, 0)), 0.03).propose()
    assert one.play_mm == pytest.approx(0.05, abs=1e-9)
    assert one.off_mm == pytest.approx(0.03, abs=1e-9)
    assert one.sentence() == (
        "base-arm: revolute, pin 8 mm of base in hole 8.1 mm of arm, play 0.05 mm; stands 0.03 mm off the middle"
    )


@pytest.mark.parametrize(
    ("pins", "holes", "type", "remark"),
    [
        (rod(8, (0, 0)), plate(8.0, (0, 0)), "fixed", "press fit"),
        (rod(8.02, (0, 0)), plate(8.0, (0, 0)), "fixed", "press fit"),
        (rod(8, (-15, 0), (15, 0)), plate(8.1, (-15, 0), (15, 0)), "prismatic", "two parallel pins"),
        (rod(8, (0, 0), tilt_deg=0.3), plate(8.4, (0, 0)), "revolute", "leans by 0.3°"),
    ],
)
def test_what_the_cylinders_say_beyond_a_pin_that_turns(pins, holes, type, remark):
    (one,) = two(pins, holes).propose()
    assert one.type == type
    assert remark in one.remark


def test_a_pin_that_leans_is_proposed_but_not_confirmed():
    drawing = two(rod(8, (0, 0), tilt_deg=0.3), plate(8.4, (0, 0)))
    with pytest.raises(DrawingError, match=r'joint "base-arm".*0\.3° apart'):
        drawing.confirm("base-arm")


@pytest.mark.parametrize(
    ("pins", "holes", "off_mm"),
    [
        (rod(8, (0, 0)), plate(8.1, (0, 0)), 0.1),  # beyond its play
        (rod(8, (0, 0)), plate(10.1, (0, 0)), 0.0),  # the pin passes through
        (rod(8, (0, 0), tilt_deg=1.0), plate(9, (0, 0)), 0.0),
        (BLOCK, plate(8.1, (0, 0)), 0.0),
        (rod(8, (0, 0)), plate(8.1, (0, 0)).translate((0, 0, 40)), 0.0),  # coaxial, but above it
    ],
)
def test_what_cannot_be_a_bearing_is_not_proposed(pins, holes, off_mm):
    assert two(pins, holes, off_mm).propose() == []


def test_a_declared_joint_wins_over_a_proposal():
    drawing = two(rod(8, (0, 0)), plate(8.1, (0, 0)))
    drawing.fixed("glued", "base", "arm")
    (one,) = drawing.propose()
    assert one.remark == 'declared as fixed "glued", which wins over revolute'
    drawing.confirm_all()
    assert [joint.id for joint in drawing.mechanism().joints] == ["glued"]
    with pytest.raises(DrawingError, match='"base-arm" is drawn already, as fixed "glued"'):
        drawing.confirm("base-arm")


def test_a_proposal_that_is_not_there_is_refused_with_those_that_are():
    with pytest.raises(DrawingError, match=r'joint "pivot" is not among the 1 proposed. Known: "base-arm"'):
        two(rod(8, (0, 0)), plate(8.1, (0, 0))).confirm("pivot")


def test_a_pin_loose_in_both_plates_is_two_joints():
    assembly = cq.Assembly(name="loose").add(plate(8.1, (0, 0)), name="low")
    assembly.add(plate(8.2, (0, 0)), name="high", loc=cq.Location((0, 0, 8)))
    assembly.add(cq.Workplane().circle(4).extrude(30).translate((0, 0, -10)), name="pin")
    assert {(one.id, round(one.play_mm, 6)) for one in Drawing(assembly).propose()} == {
        ("pin-low", 0.05),
        ("pin-high", 0.1),
    }


def test_parts_of_one_body_have_no_joint_and_like_names_are_told_apart():
    assembly = cq.Assembly(name="twins")
    for side, x in (("left", 0), ("right", 100)):
        one = cq.Assembly(name=side, loc=cq.Location((x, 0, 0)))
        one.add(bar((0, "pin"), (40, "plain")), name="plate")
        one.add(bar((0, "hole"), (40, "plain")), name="link", loc=cq.Location((0, 0, 5.5)))
        assembly.add(one)
    drawing = Drawing(assembly)
    assert [one.id for one in drawing.propose()] == ["left/plate-left/link", "right/plate-right/link"]
    drawing.rigid("left/plate", "left/link")
    assert [one.id for one in drawing.propose()] == ["right/plate-right/link"]


def test_the_picture_shows_every_part_and_which_joints_are_open():
    drawing = draw("samples/fourbar/design.py")
    page = proposal_svg(drawing.parts, drawing.propose(), "a <crank> & rocker")
    assert page.count('class="declared"') == 4
    assert all(f"<title>{path}</title>" in page for path in drawing.parts)
    assert "a &lt;crank&gt; &amp; rocker" in page
    loose = two(rod(8, (0, 0)), plate(8.1, (0, 0)))
    assert proposal_svg(loose.parts, loose.propose(), "rig").count('class="open"') == 1
    assert "declare the joints" in proposal_svg(loose.parts, [], "rig")
