"""Small truths about the add-in's own arithmetic: turns, names, meshes, pins in holes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some
from scipy.spatial.transform import Rotation

from tests.plugin_fusion.addin import room
from tests.plugin_fusion.snapshots import box_mesh, rows, solid

placement, stl, names, fits, mass = (room(f"lib.{name}") for name in ("placement", "stl", "names", "fits", "mass"))
turns = some.tuples(*[some.floats(-4.0, 4.0)] * 3).map(Rotation.from_rotvec)
words = some.lists(some.text(alphabet="aAß連/\\:.*? ()2\t\n", max_size=6), max_size=8)
places = some.tuples(*[some.floats(-100.0, 100.0)] * 3)


@given(turns)
def test_a_quaternion_turns_as_its_matrix_does(turn):
    w, x, y, z = placement.quaternion(placement.Placement.from_rows(rows(turn=turn)).rotation)
    np.testing.assert_allclose(Rotation.from_quat([x, y, z, w]).as_matrix(), turn.as_matrix(), atol=1e-12)
    assert next(entry for entry in (w, x, y, z) if abs(entry) > 1e-9) > 0.0


@given(turns, places, turns, places)
def test_placements_multiply_and_invert_as_matrices_do(turn_a, a, turn_b, b):
    A, B = (placement.Placement.from_rows(rows(p, turn)) for p, turn in ((a, turn_a), (b, turn_b)))
    there = np.reshape(rows(a, turn_a), (4, 4)) @ np.reshape(rows(b, turn_b), (4, 4))
    np.testing.assert_allclose((A @ B).position, there[:3, 3], atol=1e-9)
    np.testing.assert_allclose((A @ B).rotation, there[:3, :3], atol=1e-12)
    np.testing.assert_allclose((A @ A.inverse()).position, (0, 0, 0), atol=1e-9)


@given(turns)
def test_a_frame_along_an_axis_is_right_handed_with_z_there(turn):
    axis = turn.apply([0.0, 0.0, 1.0])
    frame = np.array(placement.frame_along(tuple(axis)))
    np.testing.assert_allclose(frame[:, 2], axis, atol=1e-12)
    np.testing.assert_allclose(frame.T @ frame, np.eye(3), atol=1e-12)
    assert np.linalg.det(frame) > 0.0


@given(turns, places)
def test_turning_and_moving_a_piece_keeps_its_principal_moments(turn, place):
    told = solid((0, 0, 0), (4, 2, 1))
    piece = mass.from_fusion(told["mass_kg"], told["center_cm"], told["moments_kg_cm2"], False)
    moved = piece.in_frame(placement.Placement.from_rows(rows(place, turn)))
    np.testing.assert_allclose(np.linalg.eigvalsh(moved.inertia), np.linalg.eigvalsh(piece.inertia), rtol=1e-9)


def test_two_halves_weigh_as_the_whole():
    whole, left, right = (
        mass.from_fusion(told["mass_kg"], told["center_cm"], told["moments_kg_cm2"], False)
        for told in (solid((0, 0, 0), (4, 2, 1)), solid((0, 0, 0), (1, 2, 1)), solid((1, 0, 0), (4, 2, 1)))
    )
    both = mass.combined([left, right])
    np.testing.assert_allclose(both.center, whole.center, rtol=1e-12)
    np.testing.assert_allclose(both.inertia, whole.inertia, atol=1e-12)


def test_a_mesh_weighs_what_its_solid_does():
    told = solid((1, 2, 3), (5, 4, 4))
    expected = mass.from_fusion(told["mass_kg"], told["center_cm"], told["moments_kg_cm2"], False)
    found = stl.weigh([[10 * entry for entry in t] for t in box_mesh((1, 2, 3), (5, 4, 4))], 0.1, told["mass_kg"])
    np.testing.assert_allclose(found.center, expected.center, rtol=1e-12)
    np.testing.assert_allclose(found.inertia, expected.inertia, atol=1e-12)


def test_text_stl_is_read_too(tmp_path):
    loop = "outer loop\n vertex 0 0 0\n vertex 1 0 0\n vertex 0 1e0 0\n endloop"
    text = f"solid a\n facet normal 0 0 1\n {loop}\n endfacet\nendsolid\n"
    (tmp_path / "a.stl").write_text(text)
    assert stl.read(tmp_path / "a.stl") == [(0, 0, 0, 1, 0, 0, 0, 1, 0)]


@pytest.mark.parametrize(
    "data", [b"", b"PK\x03\x04 not a mesh", bytes(80) + b"\xff\xff\xff\x7f", b"solid\n vertex a b c"]
)
def test_what_is_no_stl_is_refused(tmp_path, data):
    (tmp_path / "a.stl").write_bytes(data)
    with pytest.raises(stl.BadMesh):
        stl.read(tmp_path / "a.stl")


def test_a_flat_mesh_encloses_nothing():
    with pytest.raises(stl.BadMesh, match="enclose no volume"):
        stl.weigh([(0, 0, 0, 1, 0, 0, 0, 1, 0)], 1.0, 1.0)


@given(words)
def test_unique_names_are_unique_and_first_ones_stay(wanted):
    found = names.unique(wanted)
    assert len(set(found)) == len(wanted)
    assert all(found[wanted.index(name)] == name for name in set(wanted))


@given(words)
def test_file_names_suit_every_system(wanted):
    found = names.file_names(wanted, ".stl")
    assert len({name.casefold() for name in found}) == len(wanted)
    assert all(name.isascii() and len(name) < 80 and not set(name) & set('/\\:*?"<>| ') for name in found)


def face(sense="pin", radius=0.4, low=0.0, high=2.0, turn=1.0, origin=(0, 0, 0), axis=(0, 0, 1)):
    area = turn * 2 * np.pi * radius * (high - low)
    told = {"origin_cm": list(origin), "axis": list(axis), "radius_cm": radius, "low_cm": low, "high_cm": high}
    return {**told, "area_cm2": area, "sense": sense}


def fit_of(a, b):
    return fits.fit(fits.cylinders(a), fits.cylinders(b), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0))


def test_a_pin_in_a_hole_has_the_clearance_between_them():
    found = fit_of([face("pin", 0.4, 0, 2)], [face("hole", 0.405, 0.5, 1.0)])
    assert found == {
        "pin_diameter_m": 0.008,
        "hole_diameter_m": 0.0081,
        "bearing_length_m": 0.005,
        "radial_clearance_m": 5e-05,
        "source": "drawn",
    }
    assert fit_of([face("hole", 0.405, 0.5, 1.0)], [face("pin", 0.4, 0, 2)]) == found, "whichever part has the pin"


def test_a_fork_bears_in_both_its_holes():
    fork = [face("hole", 0.405, 0.0, 0.5), face("hole", 0.405, 1.5, 2.0)]
    assert fit_of([face("pin", 0.4, 0, 2)], fork)["bearing_length_m"] == 0.01


def test_faces_split_in_two_are_one_cylinder():
    halves = [face("hole", 0.405, 0.5, 1.0, turn=0.5)] * 2
    assert fit_of([face("pin")], halves)["hole_diameter_m"] == 0.0081


@pytest.mark.parametrize(
    "hole",
    [
        face("hole", 0.405, turn=0.5),  # a slot's end
        face("pin", 0.405),  # two pins
        face("hole", 0.395),  # a press fit
        face("hole", 0.6),  # a window
        face("hole", 0.405, 3.0, 4.0),  # past the pin's end
        face("hole", 0.405, origin=(0.1, 0, 0)),  # beside it
        face("hole", 0.405, axis=(0, 0.1, 0.99499)),  # askew
    ],
)
def test_what_is_no_hole_for_the_pin_makes_no_fit(hole):
    assert fit_of([face("pin")], [hole]) is None
