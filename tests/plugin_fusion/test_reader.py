"""The reader asks Fusion's objects and writes down; whatever raises is named, and the reading goes on."""

import json
from pathlib import Path

import pytest

from backend.mechanism.read import read_mechanism
from tests.plugin_fusion import fakes
from tests.plugin_fusion.addin import room
from tests.plugin_fusion.snapshots import about, rows

BROKEN = RuntimeError("3 : object is invalid")


def frame_and_link(**link):
    frame = fakes.component("Frame", fakes.box_body("Body1", (-1, -1, 0), (1, 1, 0.5)))
    bar = fakes.component("Link", fakes.box_body("Body1", (-1, -1, 0), (9, 1, 0.5)))
    return (
        fakes.occurrence("Frame:1", frame, rows(), isGrounded=True),
        fakes.occurrence("Link:1", bar, rows((0, 0, 0.5), about("z", 30)), **link),
    )


def design(*joints, occurrences=None, **more):
    frame, link = occurrences or frame_and_link()
    pivot = fakes.joint("Pivot", fakes.revolute((0, 0, 1), 0.5), link, frame, (0, 0, 0.5))
    return fakes.design("Root", (frame, link), (pivot, *joints), write_mesh=fakes.write_box, **more)


def read(of, folder: Path, **application):
    (folder / "raw").mkdir(exist_ok=True)
    return room("lib.reader").read_design(of, fakes.application(**application), folder)


def saved(of, folder: Path, **application):
    bundle = room("lib.bundle")
    snapshot = read(of, folder, **application)
    bundle.save_snapshot(snapshot, folder)
    return bundle.save(folder)


def test_a_design_becomes_a_snapshot_in_fusions_own_units(tmp_path):
    snapshot = read(design(), tmp_path)
    assert [(o["path"], o["parent"], o["component"], o["pinned"]) for o in snapshot["occurrences"]] == [
        ("Frame:1", "", "Frame", True),
        ("Link:1", "", "Link", False),
    ]
    (body,) = snapshot["components"]["Link"]["bodies"]
    assert body["volume_cm3"] == 10.0
    assert body["center_cm"] == [4.0, 0.0, 0.25]
    assert (tmp_path / "raw" / body["mesh"]).is_file()
    (joint,) = snapshot["joints"]
    assert (joint["one"], joint["two"], joint["type"], joint["rotation_rad"]) == ("Link:1", "Frame:1", 1, 0.5)
    assert joint["rotation_axis"] == [0.0, 0.0, 1.0]
    assert snapshot["unread"] == []
    json.dumps(snapshot, allow_nan=False)


def test_what_was_read_is_a_mechanism(tmp_path):
    mechanism = read_mechanism(saved(design(), tmp_path).mechanism)
    assert [body.id for body in mechanism.bodies] == ["Frame", "Link"]
    assert mechanism.joints[0].id == "Pivot"
    assert mechanism.provenance.tool_version == "2.0.20000"


def test_the_same_snapshot_gives_the_same_files_again(tmp_path, monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1790000000")
    first = saved(design(), tmp_path).mechanism.read_bytes()
    assert room("lib.bundle").save(tmp_path).mechanism.read_bytes() == first


def test_a_joint_that_raises_is_named_and_the_others_are_read(tmp_path):
    frame, link = frame_and_link()
    motionless = fakes.joint("Broken", BROKEN, link, frame, (0, 0, 0))
    snapshot = read(design(motionless, occurrences=(frame, link)), tmp_path)
    assert [joint["name"] for joint in snapshot["joints"]] == ["Pivot"]
    assert snapshot["unread"] == [
        'joint "Broken" cannot be read (3 : object is invalid) and is left out; repair it in the timeline'
    ]


def test_a_joint_that_cannot_even_be_had_is_counted(tmp_path):
    snapshot = read(design(BROKEN), tmp_path)
    assert len(snapshot["joints"]) == 1
    assert "joint 2 cannot be read" in snapshot["unread"][0]


def test_a_list_of_joints_that_raises_is_read_component_by_component(tmp_path):
    frame, link = frame_and_link()
    inner = fakes.joint("Inner", fakes.revolute((0, 0, 1)), link, frame, (0, 0, 0))
    inner.createForAssemblyContext = lambda _: inner
    link.component.joints = fakes.Things(inner)
    of = design(occurrences=(frame, link))
    own = fakes.Things(of.rootComponent.allJoints[0])
    of.rootComponent.allJoints, of.rootComponent.joints = BROKEN, own
    snapshot = read(of, tmp_path)
    assert [joint["name"] for joint in snapshot["joints"]] == ["Pivot", "Inner"]
    assert "cannot list all" in snapshot["unread"][0]


@pytest.mark.parametrize("missing", ["occurrenceOne", "occurrenceTwo"])
def test_no_occurrence_is_the_root_and_one_that_raises_is_unknown(tmp_path, missing):
    frame, link = frame_and_link()
    bad = fakes.joint("Bad", fakes.revolute((0, 0, 1)), link, frame, (0, 0, 0), **{missing: BROKEN})
    rooted = fakes.joint("Rooted", fakes.revolute((0, 0, 1)), link, None, (0, 0, 0))
    snapshot = read(design(bad, rooted, occurrences=(frame, link)), tmp_path)
    told = {joint["name"]: joint for joint in snapshot["joints"]}
    assert told["Bad"]["one" if missing == "occurrenceOne" else "two"] is None
    assert told["Rooted"]["two"] == ""


def test_limits_are_read_only_where_they_are_switched_on(tmp_path):
    frame, link = frame_and_link()
    kinds = {"none": {}, "low": {"lower": -1.0}, "high": {"upper": 2.0}, "both": {"lower": -1.0, "upper": 2.0}}
    joints = [
        fakes.joint(name, fakes.revolute((0, 0, 1), **sides), link, frame, (0, 0, 0)) for name, sides in kinds.items()
    ]
    found = {
        joint["name"]: joint["rotation_limits"]
        for joint in read(design(*joints, occurrences=(frame, link)), tmp_path)["joints"]
    }
    assert {name: found[name] or {} for name in kinds} == kinds


def test_as_built_joints_and_joint_origins_are_read(tmp_path):
    frame, link = frame_and_link()
    built = fakes.as_built("Built", fakes.slider((1, 0, 0), 2.0, upper=5.0), link, frame, (1, 2, 3))
    welded = fakes.as_built("Welded", fakes.Fake(jointType=0), link, frame)
    of = design(occurrences=(frame, link), allAsBuiltJoints=fakes.Array(built, welded))
    pivot = of.rootComponent.allJoints[0]
    pivot.geometryOrOriginTwo = fakes.Fake(geometry=fakes.geometry((0, 0, 0.5)))
    snapshot = read(of, tmp_path)
    first, second, third = snapshot["joints"]
    assert first["geometry_two"]["origin_cm"] == [0.0, 0.0, 0.5]
    assert (second["geometry_one"], second["geometry_two"]["origin_cm"]) == (None, [1.0, 2.0, 3.0])
    assert (second["slide_cm"], second["slide_limits"]) == (2.0, {"upper": 5.0})
    assert third["geometry_two"] is None


def test_rigid_groups_name_their_members(tmp_path):
    frame, link = frame_and_link()
    group = fakes.Fake(
        name="G", isSuppressed=False, assemblyContext=None, occurrences=fakes.Things(frame, link, BROKEN)
    )
    (found,) = read(design(occurrences=(frame, link), allRigidGroups=fakes.Array(group)), tmp_path)["rigid_groups"]
    assert found == {"name": "G", "context": "", "suppressed": False, "members": ["Frame:1", "Link:1"]}


def test_rigid_groups_that_raise_are_named_and_not_silently_lost(tmp_path):
    frame, link = frame_and_link()
    group = fakes.Fake(name="G", isSuppressed=False, assemblyContext=None, occurrences=fakes.Things(frame, link))
    broken = read(design(occurrences=(frame, link), allRigidGroups=fakes.Array(BROKEN, group)), tmp_path)
    assert [found["name"] for found in broken["rigid_groups"]] == ["G"]
    assert "rigid group 1 cannot be read" in broken["unread"][0]
    refused = design(occurrences=(frame, link), allRigidGroups=BROKEN, rigidGroups=fakes.Things(group))
    snapshot = read(refused, tmp_path)
    assert [found["members"] for found in snapshot["rigid_groups"]] == [["Frame:1", "Link:1"]]
    assert "Fusion cannot list all rigid groups" in snapshot["unread"][0]


def test_copies_of_one_design_share_an_id_and_keep_their_own_bodies(tmp_path):
    frame, _ = frame_and_link()
    sizes = {"Link": (9, 1, 0.5), "Link copy": (19, 1, 0.5)}
    parts = [
        fakes.component(name, fakes.box_body("Body1", (-1, -1, 0), high), id="same", revisionId=name)
        for name, high in sizes.items()
    ]
    places = [fakes.occurrence(f"{part.name}:1", part, rows((0, 0, at))) for at, part in enumerate(parts, 1)]
    again = fakes.occurrence("Link copy:2", parts[1], rows((0, 0, 3)))
    of = fakes.design("Root", (frame, *places, again), write_mesh=fakes.write_box)
    snapshot = read(of, tmp_path)
    keys = [occurrence["component"] for occurrence in snapshot["occurrences"][1:]]
    assert len(set(keys[:2])) == 2
    assert keys[2] == keys[1]
    assert [snapshot["components"][key]["bodies"][0]["volume_cm3"] for key in keys] == [10.0, 20.0, 20.0]


def joint_origin(at, axes, **offsets):
    """A JointOrigin on a JointGeometry: z, x, y of its triad, and how far it is drawn away along them."""
    names = ("primaryAxisVector", "secondaryAxisVector", "thirdAxisVector")
    zero = {"offsetX": 0.0, "offsetY": 0.0, "offsetZ": 0.0}
    return fakes.Fake(
        geometry=fakes.geometry(at, axes),
        **{name: fakes.point(axis) for name, axis in zip(names, axes, strict=True)},
        **{name: fakes.Fake(value=value) for name, value in {**zero, **offsets}.items()},
    )


@pytest.mark.parametrize("held", [False, True])
def test_a_joint_origin_drawn_away_from_its_geometry_is_found_where_both_parts_meet(tmp_path, held):
    frame, link = frame_and_link()
    of = design(occurrences=(frame, link))
    axes = ((0, 0, 1), (0, 1, 0), (-1, 0, 0))
    base = (0, 0, 0.5) if held else (0, -3, 0.2)  # whether the geometry's origin holds the offsets is not told
    of.rootComponent.allJoints[0].geometryOrOriginTwo = joint_origin(base, axes, offsetX=3.0, offsetZ=0.3)
    result = saved(of, tmp_path)
    assert not [warning for warning in result.warnings if "origins" in warning]
    (joint,) = read_mechanism(result.mechanism).joints
    assert joint.frame_a.position_m == pytest.approx((0, 0, 0.005))


def test_what_ties_motions_and_parts_and_is_no_joint_is_named(tmp_path):
    frame, link = frame_and_link()
    frame.component.assemblyConstraints = fakes.Things(fakes.Fake(), fakes.Fake())
    of = design(occurrences=(frame, link))
    of.rootComponent.allJoints[0].motionLinks = fakes.Array(fakes.Fake(name="Gears"))
    said = "\n".join(saved(of, tmp_path).warnings)
    assert 'component "Frame" holds assembly constraints (2), left out' in said
    assert 'joint "Pivot" is tied by motion link "Gears"' in said


def test_a_linked_component_that_is_not_loaded_is_named(tmp_path):
    frame, link = frame_and_link()
    lost = fakes.occurrence("Bracket v3:1", BROKEN, rows())
    of = fakes.design("Root", (frame, link, lost), write_mesh=fakes.write_box)
    snapshot = read(of, tmp_path)
    assert [occurrence["path"] for occurrence in snapshot["occurrences"]] == ["Frame:1", "Link:1"]
    assert 'component "Bracket v3:1" cannot be read' in snapshot["unread"][0]


def test_nested_occurrences_know_their_parents(tmp_path):
    frame, link = frame_and_link()
    inner = fakes.occurrence(
        "Link:1+Pin:1", fakes.component("Pin", fakes.box_body("B", (0, 0, 0), (1, 1, 1))), rows(), link
    )
    snapshot = read(fakes.design("Root", (frame, link, inner), write_mesh=fakes.write_box), tmp_path)
    assert snapshot["occurrences"][2]["parent"] == "Link:1"


def test_a_body_whose_mass_raises_is_named_and_not_silently_weightless(tmp_path):
    frame, link = frame_and_link()
    link.component.bRepBodies = fakes.Things(fakes.body("Body1", BROKEN, ((0, 0, 0), (1, 1, 1))))
    result = saved(design(occurrences=(frame, link)), tmp_path)
    assert result.mechanism is None
    assert 'component "Link", body "Body1": its mass cannot be read' in "\n".join(result.warnings)
    assert 'body "Link" moves but has mass 0' in result.problems[0]


def test_a_mesh_that_cannot_be_written_costs_only_the_mesh(tmp_path):
    frame, link = frame_and_link()
    pivot = fakes.joint("Pivot", fakes.revolute((0, 0, 1)), link, frame, (0, 0, 0.5))
    result = saved(fakes.design("Root", (frame, link), (pivot,), write_mesh=None), tmp_path)
    mechanism = read_mechanism(result.mechanism)
    assert [body.meshes for body in mechanism.bodies] == [(), ()]
    assert sum("has no mesh" in warning for warning in result.warnings) == 2


@pytest.mark.parametrize(
    ("document", "name"), [("Four-bar v12", "Four-bar v12"), (RuntimeError("no document"), "Root"), ("", "Root")]
)
def test_a_document_that_was_never_saved_has_a_name_too(tmp_path, document, name):
    snapshot = read(design(), tmp_path, document=document, saved=RuntimeError("no document"))
    assert snapshot["document"] == {"name": name, "saved": False}


def test_up_is_asked_of_the_preferences_and_said_where_they_do_not_tell(tmp_path):
    assert read(design(), tmp_path, orientation=0)["up"] == "y"
    assert read(design(), tmp_path, orientation=1)["up"] == "z"
    unknown = read(design(), tmp_path, orientation=RuntimeError("no preferences"))
    assert unknown["up"] == "z"
    assert "which way is up" in unknown["unread"][0]


def test_hidden_and_open_bodies_and_meshes_are_named_and_do_not_weigh(tmp_path):
    frame, link = frame_and_link()
    bodies = [
        fakes.box_body("Body1", (-1, -1, 0), (9, 1, 0.5)),
        fakes.box_body("Tool", (0, 0, 0), (5, 5, 5), isLightBulbOn=False),
        fakes.box_body("Skin", (0, 0, 0), (5, 5, 5), isSolid=False),
    ]
    link.component.bRepBodies = fakes.Things(*bodies)
    link.component.meshBodies = fakes.Things(fakes.Fake(name="Scan", isLightBulbOn=True))
    result = saved(design(occurrences=(frame, link)), tmp_path)
    said = "\n".join(result.warnings)
    for name, word in (("Tool", "hidden"), ("Skin", "surface or a mesh"), ("Scan", "surface or a mesh")):
        assert f'component "Link", body "{name}" is' in said
        assert word in said
    assert read_mechanism(result.mechanism).body("Link").inertial.mass_kg == pytest.approx(10 * 2.7e-3, rel=1e-12)


def test_construction_points_that_begin_with_marker_are_read(tmp_path):
    frame, link = frame_and_link()
    points = [fakes.Fake(name=name, geometry=fakes.point((8, 0, 0.5))) for name in ("Marker tip", "Point2")]
    link.component.constructionPoints = fakes.Things(*points, BROKEN)
    mechanism = read_mechanism(saved(design(occurrences=(frame, link)), tmp_path).mechanism)
    assert [(marker.id, marker.body, marker.position_m) for marker in mechanism.markers] == [
        ("Marker tip", "Link", (0.08, 0.0, 0.005))
    ]


def test_progress_is_told_from_nothing_to_nearly_all(tmp_path):
    shares = []
    (tmp_path / "raw").mkdir()
    room("lib.reader").read_design(
        design(), fakes.application(), tmp_path, progress=lambda _, share: shares.append(share)
    )
    assert shares == sorted(shares)
    assert shares[0] == 0.0
    assert shares[-1] < 1.0
