"""Snapshots of designs become mechanisms that the backend reads."""

import itertools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from backend.mechanism.graph import describe
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.read import parse_mechanism
from tests.plugin_fusion.snapshots import (
    BALL,
    CYLINDRICAL,
    INFERRED,
    PIN_SLOT,
    PLANAR,
    REVOLUTE,
    RIGID,
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

CLOSED_MM = 1e-9  # positions pass through rotations and back, in double precision


def mechanism_of(design, **reading) -> Mechanism:
    made = export(design, **reading)
    assert made.problems == []
    return parse_mechanism(made.document)


def warnings_of(design, **reading) -> str:
    return "\n".join(export(design, **reading).warnings)


def pair(type=REVOLUTE, place=None, **more):
    """A frame and a bar of 10 cm on it, joined at the world's origin unless the bar is placed elsewhere."""
    return snapshot(
        {"Frame": bar("Frame", 2.0), "Link": bar("Link", 10.0)},
        [occurrence("Frame:1", pinned=True), occurrence("Link:1", transform=place)],
        [joint("Pivot", type, "Link:1", "Frame:1", (0, 0, 0.5), **more)],
    )


def test_a_fourbar_is_read_closes_and_has_one_freedom():
    mechanism = mechanism_of(fourbar())
    report = describe(mechanism)
    assert [body.id for body in mechanism.bodies] == ["Frame", "Crank", "Coupler", "Rocker"]
    assert [body.name for body in mechanism.bodies] == ["Frame:1", "Crank:1", "Coupler:1", "Rocker:1"]
    assert {joint.type for joint in mechanism.joints} == {"revolute"}
    assert report.closes
    assert report.mobility.by_count_in_plane == 1
    assert max(closure.gap_mm for closure in report.closure) < CLOSED_MM


def test_a_fourbar_drawn_in_fusion_swings_under_its_weight():
    from backend.simulate.run import simulate

    run = simulate(mechanism_of({**fourbar(), "up": "y"}), duration_s=0.05, step_s=1e-3)
    assert run.done
    assert np.max(run.constraint_error_m) < 1e-8  # the loop stays closed far within a micrometre
    kinetic, potential = run.kinetic_j, run.potential_j
    assert kinetic[-1] > 1e-4  # it falls
    assert kinetic[-1] == pytest.approx(potential[0] - potential[-1], rel=1e-3)  # steps of 1 ms, second order


def test_gravity_points_away_from_up():
    for up, down in (("x", (-9.80665, 0, 0)), ("y", (0, -9.80665, 0)), ("z", (0, 0, -9.80665))):
        assert mechanism_of({**fourbar(), "up": up}).gravity_m_per_s2 == down


def nested_scissor(cells=2):
    """Cells of two crossed bars, each cell a component of its own; the first bar of the first cell is pinned."""
    half, turn = 5.0, 30.0
    reach = 2 * half * np.cos(np.radians(turn))
    rise = half * np.sin(np.radians(turn))
    occurrences, joints = [], []
    for cell, name in enumerate(f"Cell:{n}" for n in range(1, cells + 1)):
        x = cell * reach
        occurrences += [
            occurrence(name, "Cell", rows((x, 0, 0))),
            occurrence(f"{name}+Rising:1", "Bar", rows((x, -rise, 0), about("z", turn)), pinned=cell == 0),
            occurrence(f"{name}+Falling:1", "Bar", rows((x, rise, 0.5), about("z", -turn))),
        ]
        ends = (f"{name}+Falling:1", f"{name}+Rising:1")
        joints.append(joint("Middle", REVOLUTE, *ends, (x + reach / 2, 0, 0.5), context=name))
        if cell:
            last = f"Cell:{cell}"
            for id, here, there, y in (("Top", "Falling:1", "Rising:1", rise), ("Low", "Rising:1", "Falling:1", -rise)):
                joints.append(joint(id, REVOLUTE, f"{name}+{here}", f"{last}+{there}", (x, y, 0.5)))
    return snapshot({"Cell": component("Cell"), "Bar": bar("Bar", 2 * half)}, occurrences, joints)


def test_bars_of_nested_cells_stay_apart_and_the_cells_vanish():
    mechanism = mechanism_of(nested_scissor())
    assert [body.id for body in mechanism.bodies] == [
        "Cell:1/Rising:1", "Cell:1/Falling:1", "Cell:2/Rising:1", "Cell:2/Falling:1",
    ]  # fmt: skip
    assert [joint.id for joint in mechanism.joints] == ["Cell:1/Middle", "Cell:2/Middle", "Top", "Low"]
    report = describe(mechanism)
    assert report.closes
    assert report.mobility.by_count_in_plane == 1
    meshes = {mesh.uri for body in mechanism.bodies for mesh in body.meshes}
    assert len(meshes) == 1, "four occurrences of one component share its mesh"


def test_nested_parts_without_a_joint_between_them_are_one_body():
    parts = {
        "Link": component("Link"),
        "Plate": bar("Plate", 10.0),
        "Pin": component("Pin", solid((-0.4, -0.4, 0), (0.4, 0.4, 2))),
    }
    design = snapshot(
        {**pair()["components"], **parts},
        [
            occurrence("Frame:1", pinned=True),
            occurrence("Link:1"),
            occurrence("Link:1+Plate:1"),
            occurrence("Link:1+Pin:1", transform=rows((10, 0, 0))),
        ],
        [joint("Pivot", REVOLUTE, "Link:1+Plate:1", "Frame:1", (0, 0, 0))],
    )
    mechanism = mechanism_of(design)
    assert [body.id for body in mechanism.bodies] == ["Frame", "Link"]
    assert len(mechanism.body("Link").meshes) == 2
    weights = [design["components"][part]["bodies"][0]["mass_kg"] for part in ("Plate", "Pin")]
    assert mechanism.body("Link").moving_inertial().mass_kg == pytest.approx(sum(weights), rel=1e-12)


def test_as_built_joints_hold_as_well_as_others():
    design = pair()
    design["joints"] = [as_built("Pivot", REVOLUTE, "Link:1", "Frame:1", (0, 0, 0.5))]
    made, drawn = mechanism_of(design), mechanism_of(pair())
    assert made.joint("Pivot") == drawn.joint("Pivot")


def test_a_rigid_as_built_joint_without_geometry_makes_one_body():
    design = pair()
    design["components"]["Cap"] = component("Cap", solid((-0.5, -0.5, 0.5), (0.5, 0.5, 1.0)))
    design["occurrences"].append(occurrence("Cap:1"))
    design["joints"].append(as_built("Weld", RIGID, "Cap:1", "Link:1"))
    mechanism = mechanism_of(design)
    assert [body.id for body in mechanism.bodies] == ["Frame", "Link"]
    assert len(mechanism.body("Link").meshes) == 2


@pytest.mark.parametrize("suppressed", [False, True])
def test_a_rigid_group_makes_one_body_while_it_is_not_suppressed(suppressed):
    design = pair()
    design["components"]["Screw"] = component("Screw", solid((0, 0, 0), (0.3, 0.3, 1.0)))
    design["occurrences"].append(occurrence("Screw:1"))
    group = {"name": "Group1", "context": "", "suppressed": suppressed, "members": ["Link:1", "Screw:1"]}
    design["rigid_groups"] = [group]
    mechanism = mechanism_of(design)
    assert ("Screw" in [body.id for body in mechanism.bodies]) == suppressed
    assert ('"Screw": tied to nothing' in warnings_of(design)) == suppressed


def test_what_lies_in_a_component_that_could_not_be_read_is_named_and_left_out():
    design = pair()
    design["components"]["Cap"] = component("Cap", solid((0, 0, 0), (0.3, 0.3, 1.0)))
    design["occurrences"].append({**occurrence("Cap:1"), "path": "Sub:1+Cap:1", "parent": "Sub:1"})
    design["unread"] = ['component "Sub:1" could not be read']
    assert "Cap" not in [body.id for body in mechanism_of(design).bodies]
    assert 'component "Sub:1+Cap:1" is left out' in warnings_of(design)


def test_a_suppressed_joint_is_named_and_left_out():
    design = fourbar()
    design["joints"][2]["suppressed"] = True
    assert len(mechanism_of(design).joints) == 3
    assert 'joint "C" is suppressed and left out' in warnings_of(design)


def test_an_inferred_joint_is_named_and_left_out():
    design = fourbar()
    design["joints"].append(
        joint("Constraint1", INFERRED, "Crank:1", "Rocker:1", (0, 0, 0), geometry_one=None, geometry_two=None)
    )
    assert len(mechanism_of(design).joints) == 4
    assert 'joint "Constraint1" is inferred' in warnings_of(design)


def test_a_joint_whose_component_is_missing_is_named_and_left_out():
    design = fourbar()
    design["joints"][1]["one"], design["joints"][2]["one"] = "Gone:1", None
    assert [joint.id for joint in mechanism_of(design).joints] == ["A", "D"]
    said = warnings_of(design)
    assert 'joint "B" joins "Gone:1", which is missing' in said
    assert 'joint "C" joins a component that Fusion does not name' in said


def test_a_joint_to_no_occurrence_is_one_to_the_root_component():
    design = pair()
    design["occurrences"] = [occurrence("Link:1")]
    design["joints"][0]["two"] = ""
    mechanism = mechanism_of(design)
    assert [(body.id, body.fixed) for body in mechanism.bodies] == [("ground", True), ("Link", False)]
    assert mechanism.joint("Pivot").body_a == "ground"


def test_suppressed_components_are_gone_with_all_in_them():
    design = fourbar()
    design["occurrences"][3]["suppressed"] = True
    made = export(design)
    assert [body["id"] for body in made.document["bodies"]] == ["Frame", "Crank", "Coupler"]
    assert 'joint "D" joins "Rocker:1", which is missing or suppressed' in "\n".join(made.warnings)


def test_names_of_any_script_are_kept_and_repeated_ones_numbered():
    design = fourbar()
    names = {"Crank:1": "Kurbel übergroß:1", "Coupler:1": "連桿:1", "Rocker:1": "Balancín\tñ :1"}
    for record in design["occurrences"]:
        record["path"] = names.get(record["path"], record["path"])
    for record in design["joints"]:
        record["name"] = "Drehen"
        record["one"], record["two"] = (names.get(record[side], record[side]) for side in ("one", "two"))
    mechanism = mechanism_of(design)
    assert [body.id for body in mechanism.bodies] == ["Frame", "Kurbel übergroß", "連桿", "Balancín ñ"]
    assert [joint.id for joint in mechanism.joints] == ["Drehen", "Drehen (2)", "Drehen (3)", "Drehen (4)"]
    assert all(mesh.uri.isascii() for body in mechanism.bodies for mesh in body.meshes)


def test_components_of_one_name_keep_their_numbers():
    design = pair()
    design["occurrences"].append(occurrence("Link:2", transform=rows((0, 0, 3))))
    design["joints"].append(joint("Other", REVOLUTE, "Link:2", "Frame:1", (0, 0, 3.5)))
    assert [body.id for body in mechanism_of(design).bodies] == ["Frame", "Link:1", "Link:2"]


TYPES = {
    REVOLUTE: "revolute",
    SLIDER: "prismatic",
    CYLINDRICAL: "cylindrical",
    PLANAR: "planar",
    BALL: "spherical",
    PIN_SLOT: "planar",
}


@pytest.mark.parametrize("type", TYPES)
def test_every_joint_type_of_fusion_finds_its_like(type):
    axis = (0.6, 0.0, 0.8)
    across = {"slide_direction": [0.0, 1.0, 0.0]} if type == PIN_SLOT else {}
    mechanism = mechanism_of(pair(type, axis=axis, **across))
    made = mechanism.joint("Pivot")
    assert made.type == TYPES[type]
    assert describe(mechanism).closes
    if type != BALL:
        np.testing.assert_allclose(made.frame_a.rotation()[:, 2], axis, atol=1e-12)  # rounding of a product
    assert ("pin-slot" in warnings_of(pair(type, axis=axis, **across))) == (type == PIN_SLOT)


def test_a_slot_along_its_own_pin_is_a_cylindrical_joint():
    design = pair(PIN_SLOT, axis=(0, 0, 1), slide_direction=[0.0, 0.0, -1.0])
    assert mechanism_of(design).joint("Pivot").type == "cylindrical"
    assert "pin-slot" not in warnings_of(design)


@pytest.mark.parametrize(
    ("type", "value", "unit"), [(REVOLUTE, {"rotation_rad": 0.4}, 1.0), (SLIDER, {"slide_cm": 3.0}, 1e-2)]
)
def test_the_joint_starts_at_fusions_own_value(type, value, unit):
    (drawn,) = value.values()
    mechanism = mechanism_of(pair(type, **value))
    assert describe(mechanism).closure[0].q == pytest.approx(drawn * unit, rel=1e-12)


def test_a_driven_joint_leaves_its_frames_and_turns_its_body():
    """The check that docs/fusion.md asks for inside Fusion: the same joint at 0 and driven."""
    still = mechanism_of(pair(axis=(0, 0, 1)))
    driven = mechanism_of(pair(axis=(0, 0, 1), place=rows(turn=about("z", 30)), rotation_rad=np.radians(30)))
    for frame in ("frame_a", "frame_b"):
        one, other = (getattr(mechanism.joint("Pivot"), frame) for mechanism in (still, driven))
        np.testing.assert_allclose(one.position_m, other.position_m, atol=1e-15)
        np.testing.assert_allclose(one.rotation(), other.rotation(), atol=1e-12)
    assert still.body("Link").pose != driven.body("Link").pose


def test_a_slider_pulled_out_has_its_origins_apart_and_still_meets():
    design = pair(SLIDER, axis=(1, 0, 0), slide_cm=3.0)
    design["joints"][0]["geometry_one"]["origin_cm"] = [3.0, 0.0, 0.5]
    made = export(design)
    assert made.readings["joints"][0]["reading"] == "world"
    assert not [warning for warning in made.warnings if "origins" in warning]


def test_part_one_is_the_one_that_moves_and_so_is_body_b():
    made = mechanism_of(pair()).joint("Pivot")
    assert (made.body_a, made.body_b) == ("Frame", "Link")


def test_limits_may_have_one_side_only():
    for limits in ({"lower": -0.5}, {"upper": 1.2}, {"lower": -0.5, "upper": 1.2}):
        made = mechanism_of(pair(rotation_limits=limits)).joint("Pivot").limits
        assert made is not None
        assert made.model_dump(exclude_none=True) == limits
    slide = mechanism_of(pair(SLIDER, slide_limits={"upper": 4.0})).joint("Pivot").limits
    assert slide is not None
    assert slide.model_dump() == {"lower": None, "upper": 0.04}


def test_limits_that_the_format_cannot_hold_are_named():
    said = warnings_of(pair(CYLINDRICAL, slide_limits={"lower": 0.0}, other_limits=[]))
    assert 'joint "Pivot": its slide limits (lower 0) have no place in a cylindrical joint' in said
    assert "pitch limits" in warnings_of(pair(BALL, other_limits=["pitch"]))
    crossed = pair(rotation_limits={"lower": 1.0, "upper": 0.0})
    assert "crossed" in warnings_of(crossed)
    assert mechanism_of(crossed).joint("Pivot").limits is None


def test_a_locked_joint_is_rigid_and_says_so():
    design = fourbar()
    design["joints"][1]["locked"] = True
    mechanism = mechanism_of(design)
    assert [body.id for body in mechanism.bodies] == ["Frame", "Crank", "Rocker"]
    assert 'joint "B" is locked' in warnings_of(design)


def test_a_joint_inside_one_rigid_body_is_named_and_left_out():
    design = pair()
    design["occurrences"][1]["pinned"] = True
    made = export(design)
    assert made.document["joints"] == []
    assert 'joint "Pivot" (revolute) cannot move: "Link:1" and "Frame:1" are one rigid body' in "\n".join(made.warnings)
    assert "nothing moves" in made.problems[0]


def test_a_component_grounded_to_its_parent_stands_as_that_does():
    design = pair()
    design["occurrences"][0].update(pinned=False, ground_to_parent=True)
    assert mechanism_of(design).body("Frame").fixed


def test_without_ground_there_is_no_mechanism_and_the_remedy_is_told():
    design = pair()
    design["occurrences"][0]["pinned"] = False
    (problem,) = export(design).problems
    assert "none of the 2 bodies is grounded" in problem
    assert "Pin" in problem


@pytest.mark.parametrize("way", [0.0, 25.0, 140.0])
def test_the_order_of_parts_does_not_change_the_motion(way):
    """Users of exporters to trees suffer from parents and children swapped; here only q changes its sign."""
    place = rows((0, 0, 0.5), about("z", way))
    forth = pair(place=place, rotation_rad=0.3)
    back = pair(place=place, rotation_rad=0.3)
    back["joints"][0].update(one="Frame:1", two="Link:1")
    one, other = (describe(mechanism_of(design)) for design in (forth, back))
    assert one.closes
    assert other.closes
    assert one.mobility.by_rank == other.mobility.by_rank == 1


def test_markers_are_construction_points_that_begin_so():
    design = fourbar()
    design["components"]["Crank"]["markers"] = [{"name": "marker pin", "position_cm": [4.0, 0.0, 0.5]}]
    (marker,) = mechanism_of(design).markers
    assert (marker.id, marker.body) == ("marker pin", "Crank")
    assert marker.position_m == pytest.approx((0.04, 0.0, 0.005), abs=1e-15)


def test_bodies_stand_where_fusion_placed_them():
    place, turn = (1.0, -2.0, 3.0), Rotation.from_euler("xyz", [20, -40, 130], degrees=True)
    link = mechanism_of(pair(place=rows(place, turn))).body("Link")
    assert link.pose.position_m == pytest.approx([0.01, -0.02, 0.03], rel=1e-15)
    np.testing.assert_allclose(link.pose.rotation(), turn.as_matrix(), atol=1e-12)


@pytest.mark.parametrize("axis", list(itertools.product((-1.0, 0.0, 1.0), repeat=3))[:13])
def test_a_joint_may_lie_along_any_axis(axis):
    unit = np.array(axis) / np.linalg.norm(axis)
    made = mechanism_of(pair(axis=tuple(unit))).joint("Pivot")
    np.testing.assert_allclose(made.frame_a.rotation()[:, 2], unit, atol=1e-12)


def test_a_scaled_or_mirrored_component_is_refused_by_name():
    mirrored = rows()
    mirrored[0] = -1.0
    problems = export(pair(place=mirrored)).problems
    assert any('"Link:1"' in problem and "mirrors" in problem for problem in problems)
