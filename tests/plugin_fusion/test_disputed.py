"""What Autodesk's help leaves open is settled by evidence, whichever way Fusion turns out to do it."""

import copy

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from backend.mechanism.graph import describe
from backend.mechanism.read import parse_mechanism
from tests.plugin_fusion.addin import room
from tests.plugin_fusion.snapshots import (
    BALL,
    REVOLUTE,
    SLIDER,
    about,
    as_built,
    bar,
    component,
    export,
    fourbar,
    joint,
    occurrence,
    rows,
    snapshot,
    solid,
)

TILTED = Rotation.from_euler("xyz", [20, -40, 130], degrees=True)


def in_own_frames(design, joints=None):
    """The same design, each origin given in its occurrence's own frame; the axis stays the world's."""
    told = copy.deepcopy(design)
    places = {"": np.eye(4), **{o["path"]: np.reshape(o["transform"], (4, 4)) for o in told["occurrences"]}}
    for record in told["joints"] if joints is None else [j for j in told["joints"] if j["name"] in joints]:
        for side in ("one", "two"):
            if geometry := record[f"geometry_{side}"]:
                inverse = np.linalg.inv(places[record[side]])
                geometry["origin_cm"] = (inverse @ [*geometry["origin_cm"], 1.0])[:3].tolist()
    return told


def test_joint_origins_are_found_in_either_frame():
    made = {name: export(told) for name, told in (("world", fourbar()), ("occurrence", in_own_frames(fourbar())))}
    for reading, export_ in made.items():
        # A has both parts' origins on the world's, where the readings agree but for the height of the crank.
        assert {entry["reading"] for entry in export_.readings["joints"]} == {reading}
        assert export_.problems == []
    for one, other in zip(made["world"].document["joints"], made["occurrence"].document["joints"], strict=True):
        for frame in ("frame_a", "frame_b"):
            np.testing.assert_allclose(one[frame]["position_m"], other[frame]["position_m"], atol=1e-12)


def test_both_readings_of_every_joint_are_kept_for_people_to_see():
    for entry in export(fourbar()).readings["joints"]:
        assert set(entry["origins_apart_mm"]) == {"world", "occurrence"}
        assert entry["origins_apart_mm"]["world"] < 1e-9


def test_origins_that_meet_in_no_reading_are_told_with_both_distances_and_left_to_the_check():
    design = fourbar()
    design["joints"][1]["geometry_one"]["origin_cm"][0] += 0.7
    made = export(design)
    assert 'joint "B": its two origins meet in no reading (7 mm as world, ' in "\n".join(made.warnings)
    report = describe(parse_mechanism(made.document))
    assert {closure.joint: round(closure.gap_mm, 6) for closure in report.closure}["B"] == 7.0


def test_a_joints_offset_along_its_axis_is_meant():
    design = fourbar()
    design["joints"][0]["geometry_one"]["origin_cm"][2] += 0.3
    design["joints"][0]["offset_cm"] = 0.3
    assert not [warning for warning in export(design).warnings if "origins" in warning]


@pytest.mark.parametrize("type", [SLIDER, BALL])
def test_an_offset_across_a_slide_and_of_a_ball_is_meant_too(type):
    design = fourbar()
    record = design["joints"][0]
    record.update(type=type, slide_direction=[1.0, 0.0, 0.0], offset_cm=0.3)
    record["geometry_one"]["origin_cm"][2] += 0.3
    assert not [warning for warning in export(design).warnings if "origins" in warning]


@pytest.mark.parametrize("own_frames", [False, True])
def test_an_as_built_joint_has_one_origin_and_follows_the_others(own_frames):
    design = fourbar()
    place = design["joints"][3]["geometry_two"]["origin_cm"]
    design["joints"][3] = as_built("D", REVOLUTE, "Frame:1", "Rocker:1", place)
    made = export(in_own_frames(design) if own_frames else design)
    assert made.readings["joints"][3]["reading"] == ("occurrence" if own_frames else "world")
    assert describe(parse_mechanism(made.document)).closes


@pytest.mark.parametrize("own_frames", [False, True])
def test_as_built_joints_alone_are_taken_where_their_parts_are(own_frames):
    design = fourbar()
    for record in design["joints"]:
        record.update(kind="as_built", geometry_one=None)
    made = export(in_own_frames(design) if own_frames else design)
    assert describe(parse_mechanism(made.document)).mobility.by_count_in_plane == 1
    expected = export(fourbar()).document["joints"]
    for one, other in zip(made.document["joints"], expected, strict=True):
        np.testing.assert_allclose(one["frame_a"]["position_m"], other["frame_a"]["position_m"], atol=1e-12)


@pytest.mark.parametrize("in_world", [True, False])
def test_the_axis_is_turned_where_the_joints_own_axes_ask_for_it(in_world):
    axis, turn = np.array([0.0, 0.6, 0.8]), TILTED
    told = axis if in_world else turn.inv().apply(axis)
    design = snapshot(
        {"Frame": bar("Frame", 2.0), "Link": bar("Link", 10.0)},
        [
            occurrence("Frame:1", transform=rows((5, 5, 5), turn), pinned=True),
            occurrence("Link:1", transform=rows((1, 2, 3), turn)),
        ],
        [joint("Pivot", REVOLUTE, "Link:1", "Frame:1", (1, 2, 3), axis=told)],
    )
    basis = np.column_stack([np.cross([1.0, 0, 0], axis), [1.0, 0, 0], axis])
    for side in ("geometry_one", "geometry_two"):
        design["joints"][0][side]["vectors"] = basis.T.tolist()
    (made,) = parse_mechanism(export(design).document).joints
    np.testing.assert_allclose(turn.as_matrix() @ made.frame_a.rotation()[:, 2], axis, atol=1e-12)


def wedge_design(integrals=False, world=False):
    """A bar of two boxes that stand askew of its axes, told in one of Fusion's possible ways."""
    design = snapshot(
        {"Frame": bar("Frame", 2.0), "Link": component("Link", solid((1, 2, 3), (9, 4, 4)))},
        [occurrence("Frame:1", pinned=True), occurrence("Link:1", transform=rows((20, -30, 10), TILTED))],
        [joint("Pivot", REVOLUTE, "Link:1", "Frame:1", (20, -30, 10))],
    )
    told = design["components"]["Link"]["bodies"][0]
    if world:
        center = TILTED.apply(told["center_cm"]) + np.array([20, -30, 10])
        xx, yy, zz, xy, yz, xz = told["moments_kg_cm2"]
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        mass, at = told["mass_kg"], np.array(told["center_cm"])
        central = tensor - mass * (at @ at * np.eye(3) - np.outer(at, at))
        moved = TILTED.as_matrix() @ central @ TILTED.as_matrix().T + mass * (
            center @ center * np.eye(3) - np.outer(center, center)
        )
        told["center_cm"] = center.tolist()
        told["moments_kg_cm2"] = [*np.diag(moved), moved[0, 1], moved[1, 2], moved[0, 2]]
    if integrals:
        for part in ("Frame", "Link"):
            (told,) = design["components"][part]["bodies"]
            told["moments_kg_cm2"][3:] = [-product for product in told["moments_kg_cm2"][3:]]
    return design


@pytest.mark.parametrize("world", [False, True])
@pytest.mark.parametrize("integrals", [False, True])
def test_signs_and_frames_of_inertia_are_settled_by_the_mesh(integrals, world):
    expected = export(wedge_design()).document["bodies"][1]["inertial"]
    made = export(wedge_design(integrals, world))
    assert made.problems == []
    assert made.readings["products_of_inertia"] == ("integrals" if integrals else "tensor entries")
    assert made.readings["products_settled_by"] == "2 of 2 meshes"
    found = made.document["bodies"][1]["inertial"]
    assert found["mass_kg"] == expected["mass_kg"]
    np.testing.assert_allclose(found["center_of_mass_m"], expected["center_of_mass_m"], atol=1e-12)
    trace = sum(expected["inertia_kg_m2"][axis] for axis in ("xx", "yy", "zz"))
    for entry, value in expected["inertia_kg_m2"].items():
        assert found["inertia_kg_m2"][entry] == pytest.approx(value, abs=1e-9 * trace)  # rounding of a shift of 40 cm


def test_without_meshes_the_sign_that_matter_allows_is_taken():
    for integrals in (False, True):
        design = wedge_design(integrals)
        for part in design["components"].values():
            for body in part["bodies"]:
                body["mesh"] = None
        made = export(design)
        assert made.readings["products_of_inertia"] == ("integrals" if integrals else "tensor entries")
        assert made.readings["products_settled_by"] == "default: no mesh to compare"
        assert sum("has no mesh" in warning for warning in made.warnings) == 2


@pytest.mark.parametrize("unit_cm", [0.1, 1.0, 100.0, 2.54, 30.48])
def test_the_unit_of_a_mesh_is_measured_whatever_fusion_wrote(unit_cm):
    made = export(fourbar(), unit_cm=unit_cm)
    assert not [warning for warning in made.warnings if "mesh" in warning]
    for groups in made.meshes.values():
        for _, scale, _ in groups:
            assert scale == unit_cm


def test_a_mesh_of_no_known_unit_is_left_out_by_name():
    made = export(fourbar(), unit_cm=0.37)
    assert sum("which is no scale in millimetre" in warning for warning in made.warnings) == 4
    assert made.meshes == {}
    assert made.problems == []


def test_a_mesh_written_in_the_world_is_brought_home(tmp_path):
    design = wedge_design()
    place = np.reshape(design["occurrences"][1]["transform"], (4, 4))

    def moved(triangles):
        points = np.array(triangles).reshape(-1, 3)
        if points.max() < 30:  # the frame's, which stands at the origin
            return triangles
        return [tuple(t) for t in (points @ place[:3, :3].T + 10 * place[:3, 3]).reshape(-1, 9)]

    made = export(design, moved=moved)
    assert not [warning for warning in made.warnings if "mesh" in warning]
    stl = room("lib.stl")
    (uri,) = [mesh["uri"] for mesh in made.document["bodies"][1]["meshes"]]
    stl.write(tmp_path / "link.stl", made.meshes[uri])
    points = np.array(stl.read(tmp_path / "link.stl")).reshape(-1, 3)
    np.testing.assert_allclose(points.min(axis=0), (10, 20, 30), atol=1e-4)  # single precision
    np.testing.assert_allclose(points.max(axis=0), (90, 40, 40), atol=1e-4)


def test_a_mesh_of_another_shape_is_told():
    design = wedge_design()
    design["components"]["Link"]["bodies"][0]["center_cm"][0] += 1.0
    assert "centre of mass and that of its mesh are 10 mm apart" in "\n".join(export(design).warnings)


def test_a_rotated_occurrence_changes_nothing_in_its_own_frame():
    still, turned = fourbar(), fourbar()
    turned["occurrences"][1]["transform"] = rows((0, 0, 0.55), about("x", 50) * about("z", 65))
    for name in ("center_of_mass_m", "inertia_kg_m2"):
        assert (
            export(still).document["bodies"][1]["inertial"][name]
            == export(turned).document["bodies"][1]["inertial"][name]
        )
