"""What users of other CAD exporters complain of most, one by one; none of it may come back here."""

import itertools
import json

import pytest

from backend.mechanism.graph import describe
from backend.mechanism.read import parse_mechanism, read_mechanism
from tests.plugin_fusion.addin import room
from tests.plugin_fusion.snapshots import (
    REVOLUTE,
    as_built,
    bar,
    box_mesh,
    component,
    export,
    fourbar,
    joint,
    occurrence,
    snapshot,
    solid,
)


def said(made) -> str:
    return "\n".join(made.warnings)


def test_as_built_joints_are_not_ignored():
    design = fourbar()
    for record in design["joints"]:
        record.update(
            as_built(record["name"], REVOLUTE, record["one"], record["two"], record["geometry_two"]["origin_cm"])
        )
    mechanism = parse_mechanism(export(design).document)
    assert [joint.id for joint in mechanism.joints] == ["A", "B", "C", "D"]
    assert describe(mechanism).mobility.by_count_in_plane == 1


@pytest.mark.parametrize("swapped", list(itertools.product((False, True), repeat=4)))
def test_no_order_of_parents_and_children_breaks_a_loop(swapped):
    design = fourbar()
    for record, swap in zip(design["joints"], swapped, strict=True):
        if swap:
            record["one"], record["two"] = record["two"], record["one"]
    report = describe(parse_mechanism(export(design).document))
    assert report.closes
    assert report.mobility.by_count_in_plane == 1


@pytest.mark.parametrize("size_cm", [0.01, 0.05])
def test_the_inertia_of_a_small_part_is_not_rounded_to_zero(size_cm):
    """A cube of 0.1 mm weighs 2.7 µg and has 4.5e-18 kg m²: six decimals would leave nothing."""
    design = fourbar()
    half = size_cm / 2
    design["components"]["Coupler"] = component("Coupler", solid((-half, -half, -half), (half, half, half)))
    made = export(design)
    inertial = parse_mechanism(made.document).body("Coupler").moving_inertial()
    mass = 2.7e-3 * size_cm**3
    assert inertial.mass_kg == pytest.approx(mass, rel=1e-12)
    assert inertial.inertia_kg_m2.xx == pytest.approx(mass * (size_cm * 1e-2) ** 2 / 6, rel=1e-9)


def test_every_digit_reaches_the_file(tmp_path):
    design = fourbar()
    (tmp_path / "raw" / "meshes").mkdir(parents=True)
    bundle = room("lib.bundle")
    bundle.save_snapshot(design, tmp_path)
    written = read_mechanism(bundle.save(tmp_path).mechanism)
    assert written.body("Crank").moving_inertial().mass_kg == design["components"]["Crank"]["bodies"][0]["mass_kg"]


@pytest.mark.parametrize("mass", [0.0, None])
def test_a_part_without_mass_is_never_silent(mass):
    design = fourbar()
    design["components"]["Coupler"]["bodies"][0]["mass_kg"] = mass
    made = export(design)
    assert 'component "Coupler", body "Body1" has mass 0' in said(made)
    assert "give it a physical material" in said(made)
    assert 'body "Coupler" moves but has mass 0' in made.problems[0]


def test_a_design_all_of_the_default_material_is_told():
    design = fourbar()
    for part in design["components"].values():
        for body in part["bodies"]:
            body["material"] = "Steel"
    assert 'all 4 bodies are of "Steel", Fusion\'s default' in said(export(design))
    design["components"]["Crank"]["bodies"][0]["material"] = "Brass"
    assert "default" not in said(export(design))


def test_a_density_that_no_matter_has_is_told():
    design = fourbar()
    crank = design["components"]["Crank"]["bodies"][0]
    crank["volume_cm3"] *= 1e-3  # as if it came in litres
    crank["mesh"] = None
    assert "weighs 2.7e+06 kg/m³, outside 10 (foam) to 23000 (beyond osmium)" in said(export(design))


def test_meshes_have_the_size_of_their_parts_in_metres(tmp_path):
    design = fourbar()
    stl, bundle, placement = (room(f"lib.{name}") for name in ("stl", "bundle", "placement"))
    (tmp_path / "raw" / "meshes").mkdir(parents=True)
    for part in design["components"].values():
        for body in part["bodies"]:
            stl.write(tmp_path / "raw" / body["mesh"], [(box_mesh(*body["box_cm"]), 1.0, placement.Placement())])
    bundle.save_snapshot(design, tmp_path)
    mechanism = read_mechanism(bundle.save(tmp_path).mechanism)
    for body in mechanism.bodies:
        low, high = design["components"][body.id]["bodies"][0]["box_cm"]
        (mesh,) = body.meshes
        points = [p for t in stl.read(tmp_path / mesh.uri) for p in (t[0:3], t[3:6], t[6:9])]
        for axis in range(3):
            extent = mesh.scale_to_m * (max(p[axis] for p in points) - min(p[axis] for p in points))
            assert extent == pytest.approx((high[axis] - low[axis]) * 1e-2, rel=1e-6)  # single precision


def test_closed_loops_stay_closed():
    report = describe(parse_mechanism(export(fourbar()).document))
    assert len(report.loops) == 1
    assert set(report.loops[0].joints) == {"A", "B", "C", "D"}


def test_one_sided_limits_are_kept():
    design = fourbar()
    design["joints"][0]["rotation_limits"] = {"lower": -0.2}
    design["joints"][3]["rotation_limits"] = {"upper": 1.1}
    made = {joint.id: joint.limits for joint in parse_mechanism(export(design).document).joints}
    assert made["A"].model_dump() == {"lower": -0.2, "upper": None}
    assert made["D"].model_dump() == {"lower": None, "upper": 1.1}


def test_no_two_parts_joints_markers_or_files_share_a_name():
    twins = [occurrence(path, "Link") for path in ("Link:1", "Link (2):1", "Link:2", "LINK:1")]
    joints = [joint("Rev", REVOLUTE, twin["path"], "Frame:1", (0, 0, n)) for n, twin in enumerate(twins)]
    marked = bar("Link", 5.0, markers=[{"name": "marker", "position_cm": [1, 0, 0]}])
    others = {f"Part{n}": bar("Kurbel/ß?", 3.0 + n) for n in range(3)}
    for n, other in enumerate(others.values()):
        other["bodies"][0]["mesh"] = f"meshes/Kurbel-{n}.stl"
    design = snapshot(
        {"Frame": bar("Frame", 2.0), "Link": marked, **others},
        [occurrence("Frame:1", pinned=True), *twins, *(occurrence(f"Kurbel/ß?:{n}", f"Part{n}") for n in range(3))],
        joints,
    )
    made = export(design)
    for part in ("bodies", "joints", "markers"):
        ids = [entry["id"] for entry in made.document[part]]
        assert len(set(ids)) == len(ids) > 3
    files = [uri.casefold() for uri in made.meshes]
    assert len(set(files)) == len(files) == 5
    assert all(uri.isascii() and ":" not in uri for uri in files)
    parse_mechanism(made.document)


def test_warnings_travel_with_the_mechanism():
    design = fourbar()
    design["joints"][0]["suppressed"] = True
    made = export(design)
    told = parse_mechanism(json.loads(json.dumps(made.document))).provenance
    assert told
    assert list(told.warnings) == made.warnings
    assert any('joint "A" is suppressed' in warning for warning in told.warnings)
