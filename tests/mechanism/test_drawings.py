"""What a good drawing may say, and that nothing of it is lost."""

import copy
import json
import math
import subprocess
import sys

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backend.mechanism.drawing_error import DrawingError
from backend.mechanism.kinds import effect_kinds
from backend.mechanism.read import decode, parse_mechanism, read_mechanism, write_mechanism
from backend.mechanism.schema import FOLDER, schemas

FORMATS_KINDS = {
    "viscous_friction",
    "coulomb_friction",
    "pin_friction",
    "stribeck_friction",
    "effort_offset",
    "clearance",
    "joint_stop",
    "torsion_spring",
    "rotor_inertia",
    "prescribed_motion",
    "extension_spring",
    "surface_friction",
    "air_drag",
    "linear_drag",
    "applied_force",
    "applied_torque",
    "link_contact",
    "link_flexibility",
    "mass_error",
    "center_of_mass_error",
    "inertia_error",
    "length_error",
    "joint_axis_error",
    "spring_stiffness_error",
    "spring_preload_error",
    "gravity_tilt",
    "base_motion",
    "late_release",
    "release_velocity",
    "camera_scale",
    "camera_rotation",
    "camera_tilt",
    "lens_distortion",
    "frame_rate_error",
    "time_offset",
    "rolling_shutter",
    "marker_offset",
    "tracker_drift",
}

numbers = st.floats(-1e3, 1e3, allow_nan=False)
vectors = st.tuples(numbers, numbers, numbers).map(list)
names = st.text(st.characters(categories=["L", "N", "P", "S"]), min_size=1, max_size=8)  # anything that can be seen


@st.composite
def frames(draw):
    q = draw(st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: math.hypot(*q) > 0.1))
    return {"position_m": draw(vectors), "quaternion_wxyz": [x / math.hypot(*q) for x in q]}


@st.composite
def inertias(draw):
    """Of a box of point masses, so always possible."""
    x, y, z = (draw(st.floats(1e-4, 10.0)) ** 2 for _ in range(3))
    mass = draw(st.floats(1e-9, 1e4))  # down to a watch's pinion
    tensor = {
        "xx": mass * (y + z),
        "yy": mass * (x + z),
        "zz": mass * (x + y),
        "xy": 0.0,
        "xz": 0.0,
        "yz": 0.0,
    }
    return {"mass_kg": mass, "center_of_mass_m": draw(vectors), "inertia_kg_m2": tensor}


@st.composite
def mechanisms(draw):
    ids = draw(st.lists(names, min_size=2, max_size=5, unique=True))
    bodies = [{"id": ids[0], "fixed": True, "pose": draw(frames())}]
    bodies += [{"id": id, "fixed": False, "pose": draw(frames()), "inertial": draw(inertias())} for id in ids[1:]]
    joints = []
    for at in range(draw(st.integers(0, 4))):
        a, b = draw(st.permutations(ids))[:2]
        kinds = st.sampled_from(["revolute", "fixed", "prismatic", "cylindrical", "spherical", "planar"])
        joints.append(
            {
                "id": f"j{at}",
                "type": draw(kinds),
                "body_a": a,
                "body_b": b,
                "frame_a": draw(frames()),
                "frame_b": draw(frames()),
            }
        )
        if draw(st.booleans()):
            joints[-1]["limits"] = {"lower": draw(st.floats(-9, 0)), "upper": draw(st.floats(0, 9))}
    effects = [
        {
            "id": f"e{at}",
            "kind": "linear_drag",
            "on": [id],
            "parameters": {"n_s_per_m": draw(st.floats(0, 9))},
        }
        for at, id in enumerate(ids[1:])
    ]
    markers = [{"id": id, "body": draw(st.sampled_from(ids)), "position_m": draw(vectors)} for id in ids]
    return {
        "schema_version": "1.0",
        "name": draw(st.text(max_size=9).filter(lambda text: text.isascii())),
        "gravity_m_per_s2": draw(vectors),
        "bodies": bodies,
        "joints": joints,
        "effects": effects,
        "markers": markers,
    }


@settings(max_examples=60, deadline=None)
@given(document=mechanisms())
def test_writing_and_reading_again_is_the_identity(document, tmp_path_factory):
    path = tmp_path_factory.mktemp("drawn") / "mechanism.json"
    once = parse_mechanism(document)
    write_mechanism(once, path)
    assert read_mechanism(path) == once
    text = path.read_text("utf-8")
    write_mechanism(read_mechanism(path), path)
    assert path.read_text("utf-8") == text


junk = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.just(10**400),
    st.floats(),
    st.text(max_size=4),
    st.lists(st.floats(), max_size=4),
    st.dictionaries(st.text(max_size=3), st.integers(), max_size=2),
)


def spots(node, path=()):
    """All places of a document: paths of keys and indices."""
    if isinstance(node, dict | list):
        for key, child in node.items() if isinstance(node, dict) else enumerate(node):
            yield (*path, key)
            yield from spots(child, (*path, key))


def read_or_refused(read):
    """Whether reading gave a drawing, or sentences; any other error passes through."""
    try:
        return read()
    except DrawingError as error:
        return error.problems and all(isinstance(problem, str) and problem for problem in error.problems)


@settings(max_examples=300, deadline=None)
@given(data=st.data())
def test_a_damaged_drawing_is_read_or_refused_and_nothing_else(data, drawings):
    document = copy.deepcopy(drawings.pendulum())
    for _ in range(data.draw(st.integers(1, 3))):
        *way, last = data.draw(st.sampled_from(list(spots(document))))
        node = document
        for step in way:
            node = node[step]
        match data.draw(st.sampled_from(["replace", "delete", "repeat", "add"])):
            case "replace":
                node[last] = data.draw(junk)
            case "delete":
                del node[last]
            case "repeat" if isinstance(node, list):
                node.append(copy.deepcopy(node[last]))
            case _ if isinstance(node, dict):
                node[data.draw(st.text(max_size=4))] = data.draw(junk)
        if not document:
            break
    assert read_or_refused(lambda: parse_mechanism(document))


@settings(max_examples=100, deadline=None)
@given(data=st.data())
def test_a_truncated_or_garbled_file_is_refused_or_read(data, drawings):
    text = json.dumps(drawings.pendulum())
    at = data.draw(st.integers(0, len(text)))
    garbled = text[:at] + data.draw(st.text(max_size=3)) + text[at + data.draw(st.integers(0, 20)) :]
    assert read_or_refused(lambda: parse_mechanism(decode(garbled, "garbled")))


def test_a_small_inertia_keeps_every_digit(tmp_path, drawings):
    document = drawings.pendulum()
    document["bodies"][1]["inertial"] = {
        "mass_kg": 1.2345678901234567e-6,
        "center_of_mass_m": [1 / 3, 0, 0],
        "inertia_kg_m2": {"xx": 1.1111111111111112e-15, "yy": 2.3e-15, "zz": 2.2e-15},
    }
    mechanism = parse_mechanism(document)
    write_mechanism(mechanism, tmp_path / "m.json")
    inertial = read_mechanism(tmp_path / "m.json").body("link1").inertial
    assert inertial.inertia_kg_m2.xx == 1.1111111111111112e-15
    assert inertial.mass_kg == 1.2345678901234567e-6
    assert inertial.center_of_mass_m[0] == 1 / 3


def test_a_quaternion_with_seven_digits_becomes_a_rotation(drawings):
    document = drawings.pendulum()
    document["joints"][0]["frame_a"]["quaternion_wxyz"] = [0.7071068, 0.7071068, 0, 0]
    q = parse_mechanism(document).joint("j1").frame_a.quaternion_wxyz
    assert math.hypot(*q) == pytest.approx(1.0, abs=1e-15)


def test_a_one_sided_limit_is_allowed(drawings):
    document = drawings.pendulum()
    document["joints"][0]["limits"] = {"upper": 1.0}
    limits = parse_mechanism(document).joint("j1").limits
    assert (limits.lower, limits.upper) == (None, 1.0)


def test_a_newer_minor_version_without_new_fields_is_read(drawings):
    assert parse_mechanism({**drawings.pendulum(), "schema_version": "1.4"}).name == "pendulum"


def test_all_means_every_joint_that_the_parameter_suits(drawings):
    document = drawings.slider_crank()
    document["effects"] = [
        {
            "id": "turning",
            "kind": "viscous_friction",
            "on": "all",
            "parameters": {"damping_n_m_s_per_rad": 1},
        },
        {"id": "sliding", "kind": "viscous_friction", "on": "all", "parameters": {"damping_n_s_per_m": 1}},
    ]
    assert [effect.on for effect in parse_mechanism(document).effects] == ["all", "all"]


def test_a_fixed_body_needs_no_mass_and_a_clearance_follows_from_the_diameters(drawings):
    document = drawings.pendulum()
    del document["joints"][0]["fit"]["radial_clearance_m"]
    mechanism = parse_mechanism(document)
    assert mechanism.joint("j1").fit.clearance_m() == pytest.approx(5e-5)
    assert mechanism.body("ground").inertial is None
    assert mechanism.moving_bodies() == (mechanism.body("link1"),)


def test_every_kind_of_the_format_is_known():
    kinds = effect_kinds()
    assert set(kinds) >= FORMATS_KINDS
    for kind in kinds.values():
        assert kind.acts_on in {"joint", "body", "bodies", "effect", "marker", "world", "camera"}
        assert kind.doc
        for spec in kind.parameters.values():
            assert spec.doc
            assert spec.default is None or spec.lower is None or min([spec.default]) >= spec.lower


def test_the_schemas_in_the_docs_are_fresh():
    written = {path.name: path.read_text("utf-8") for path in FOLDER.glob("*.schema.json")}
    for file, text in schemas().items():
        assert written[file] == text, f"{file} is stale: run python -m backend.mechanism.schema"


@pytest.mark.parametrize("file", sorted(schemas()))
def test_a_schema_knows_every_field_and_allows_no_other(file):
    schema = json.loads(schemas()[file])
    for part in [schema, *schema["$defs"].values()]:
        if "properties" in part:
            assert part["additionalProperties"] is False
            assert set(part.get("required", [])) <= set(part["properties"])


def test_reading_a_drawing_loads_no_solver():
    heavy = "jax", "pandas", "scipy", "cv2", "cadquery", "equinox"
    rooms = "backend.mechanism.graph, backend.mechanism.check, backend.mechanism.read"
    code = f"import {rooms}, sys; print([name for name in {heavy!r} if name in sys.modules])"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"
