"""Mass properties from the boundary representation."""

import math

import cadquery as cq
import numpy as np
import pytest
import trimesh

from backend.mechanism.drawing_error import DrawingError
from cad_export.flat_bar import bar
from cad_export.mass import combined, mass_properties
from cad_export.placement import Placement

RHO = 2700.0
EXACT = 1e-9  # OCCT integrates planes and quadrics by Gauss points that are exact to about 1e-12


def box(x, y, z):
    return cq.Solid.makeBox(x, y, z, cq.Vector(-x / 2, -y / 2, -z / 2))


def principal(volume, *moments):
    return volume, np.array(moments)


def box_by_hand(x, y, z):
    return principal(x * y * z, (y * y + z * z) / 12, (x * x + z * z) / 12, (x * x + y * y) / 12)


ANALYTIC = {
    "box": (box(10, 20, 30), box_by_hand(10, 20, 30), (0, 0, 0)),
    "cylinder": (
        cq.Solid.makeCylinder(7, 31),
        principal(math.pi * 49 * 31, *[(3 * 49 + 31**2) / 12] * 2, 49 / 2),
        (0, 0, 15.5),
    ),
    "tube": (
        cq.Solid.makeCylinder(7, 31).cut(cq.Solid.makeCylinder(3, 31)),
        principal(math.pi * 40 * 31, *[(3 * 58 + 31**2) / 12] * 2, 58 / 2),
        (0, 0, 15.5),
    ),
    "sphere": (cq.Solid.makeSphere(6, angleDegrees1=-90), principal(4 / 3 * math.pi * 216, *[0.4 * 36] * 3), (0, 0, 0)),
    "cone": (
        cq.Solid.makeCone(7, 0, 31),
        principal(math.pi * 49 * 31 / 3, *[3 / 80 * (4 * 49 + 31**2)] * 2, 0.3 * 49),
        (0, 0, 31 / 4),
    ),
    "torus": (
        cq.Solid.makeTorus(20, 5),
        principal(2 * math.pi**2 * 20 * 25, *[(4 * 400 + 5 * 25) / 8] * 2, 400 + 0.75 * 25),
        (0, 0, 0),
    ),
}


@pytest.mark.parametrize("name", ANALYTIC)
def test_a_body_with_a_formula_weighs_what_the_formula_says(name):
    shape, (volume, per_mass), center = ANALYTIC[name]
    found = mass_properties(shape, RHO, name)
    mass = volume * 1e-9 * RHO
    assert found.mass_kg == pytest.approx(mass, rel=EXACT)
    np.testing.assert_allclose(found.center_mm, center, atol=EXACT * 31)
    np.testing.assert_allclose(
        found.inertia_kg_m2, np.diag(mass * per_mass * 1e-6), rtol=EXACT, atol=EXACT * mass * 1e-4
    )


@pytest.mark.parametrize("name", ANALYTIC)
def test_turning_and_shifting_a_body_turns_its_inertia_and_shifts_its_centre(name):
    shape, _, _ = ANALYTIC[name]
    location = cq.Location((40, -30, 20), (1, 2, 3), 50)
    from cad_export.placement import placement_of

    here = mass_properties(shape, RHO, name).in_frame(placement_of(location, name))
    there = mass_properties(shape.moved(location), RHO, name)
    np.testing.assert_allclose(there.center_mm, here.center_mm, rtol=EXACT)
    # About the centre of mass: 54 mm away from it, the parallel axis would add far more than this.
    scale = np.trace(here.inertia_kg_m2)
    np.testing.assert_allclose(there.inertia_kg_m2, here.inertia_kg_m2, atol=EXACT * scale)


def test_products_are_tensor_entries_so_mass_along_x_equals_y_makes_xy_negative():
    diagonal = box(40, 4, 4).moved(cq.Location((0, 0, 0), (0, 0, 1), 45))
    found = mass_properties(diagonal, RHO, "rod")
    by_hand = 640e-9 * RHO * (40**2 - 4**2) / 24 * 1e-6  # half the difference of the principal moments
    assert found.inertia_kg_m2[0, 1] == pytest.approx(-by_hand, rel=EXACT)
    assert found.json()["inertia_kg_m2"]["xy"] < 0.0


@pytest.mark.parametrize(
    "shape",
    [
        bar((0, "hole"), (40, "pin"), (100, "pin_down")).val(),
        cq.Workplane().box(30, 20, 10).union(cq.Workplane().box(8, 8, 40).translate((9, 4, 7))).val(),
    ],
    ids=["bar", "bracket"],
)
def test_the_mesh_weighs_the_same_to_a_thousandth(shape, tmp_path):
    file = tmp_path / "part.stl"
    shape.exportStl(str(file), 0.1, 0.1, relative=False)
    mesh = trimesh.load_mesh(file)
    mesh.density = RHO * 1e-9
    found = mass_properties(shape, RHO, "part")
    assert mesh.mass == pytest.approx(found.mass_kg, rel=1e-3)  # chords of 0.1 mm and 0.1 rad
    np.testing.assert_allclose(mesh.center_mass, found.center_mm, atol=0.01)
    scale = np.trace(found.inertia_kg_m2)
    np.testing.assert_allclose(mesh.moment_inertia * 1e-6, found.inertia_kg_m2, atol=1e-3 * scale)


def test_two_halves_weigh_as_the_whole():
    whole = mass_properties(box(40, 10, 10), RHO, "whole")
    half = mass_properties(box(20, 10, 10), RHO, "half")
    both = combined([half.in_frame(Placement(position_mm=np.array([x, 0.0, 0.0]))) for x in (-10.0, 10.0)])
    assert both.mass_kg == pytest.approx(whole.mass_kg, rel=EXACT)
    np.testing.assert_allclose(both.inertia_kg_m2, whole.inertia_kg_m2, rtol=EXACT, atol=1e-18)


def test_a_two_millimetre_cube_keeps_its_inertia_to_the_last_digit():
    found = mass_properties(box(2, 2, 2), 1000.0, "grain")
    assert found.json()["inertia_kg_m2"]["xx"] == pytest.approx(8e-6 * 8e-6 / 12, rel=1e-12)


def test_solids_that_touch_are_added_but_solids_that_overlap_are_refused():
    touching = cq.Compound.makeCompound([box(10, 10, 10), box(10, 10, 10).moved(cq.Location((10, 0, 0)))])
    assert mass_properties(touching, RHO, "pair").mass_kg == pytest.approx(2000e-9 * RHO, rel=EXACT)
    overlapping = cq.Compound.makeCompound([box(10, 10, 10), box(10, 10, 10).moved(cq.Location((7, 0, 0)))])
    with pytest.raises(DrawingError, match=r'part "pair": solid 1 and solid 2 overlap by 300 mm³.*union'):
        mass_properties(overlapping, RHO, "pair")


def _open_box():
    return cq.Solid.makeSolid(cq.Shell.makeShell(box(10, 10, 10).Faces()[:5]))


@pytest.mark.parametrize(
    ("shape", "sentence"),
    [
        (_open_box(), r'part "p": solid 1 of 1 is open \(its 5 faces leave a gap\).*sew'),
        (cq.Solid(box(10, 10, 10).wrapped.Reversed()), r"inside out \(volume -1000 mm³\).*fix"),
        (cq.Face.makePlane(10, 10), r"no solid \(a Face with volume 0 mm³\); extrude"),
        (cq.Shell.makeShell(box(10, 10, 10).Faces()), r"no solid \(a Shell with volume 0 mm³\).*makeSolid"),
        (
            cq.Compound.makeCompound([box(10, 10, 10), cq.Face.makePlane(30, 30)]),
            r"holds 1 faces outside any solid",
        ),
    ],
    ids=["open", "inside out", "face", "shell", "loose face"],
)
def test_a_shape_without_a_sound_volume_is_refused(shape, sentence):
    with pytest.raises(DrawingError, match=sentence):
        mass_properties(shape, RHO, "p")


@pytest.mark.parametrize("density", [0.0, -1.0, 2.7, 1_240_000.0, math.nan])
def test_a_density_that_no_solid_has_is_refused(density):
    with pytest.raises(DrawingError, match=r'part "p" has density .* kg/m³.*aluminium 2700'):
        mass_properties(box(1, 1, 1), density, "p")
