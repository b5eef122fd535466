"""Every kind of bad drawing is refused in a sentence with the part, the number and the remedy."""

import json
import time

import pytest

from backend.mechanism.drawing_error import MOST_LISTED, DrawingError
from backend.mechanism.effect import MOST_PLACES
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.read import decode, parse_mechanism, read_mechanism, read_study


def put(*path_and_value):
    """A fault: set the value at a path of keys and indices."""

    def spoil(document):
        *path, last, value = path_and_value
        for step in path:
            document = document[step]
        document[last] = value

    return spoil


def drop(*path):
    def spoil(document):
        *way, last = path
        for step in way:
            document = document[step]
        del document[last]

    return spoil


def add(group, part):
    return lambda document: document[group].append(part(document) if callable(part) else part)


def effect(kind, on, **parameters):
    return add("effects", {"id": "x", "kind": kind, "on": on, "parameters": parameters})


def slide_too(document):
    """A second moving body, on a slide."""
    document["bodies"].append({**document["bodies"][1], "id": "link2"})
    document["joints"].append({**document["joints"][0], "id": "s", "type": "prismatic", "body_b": "link2"})
    del document["joints"][1]["fit"], document["joints"][1]["limits"]


def together(*faults):
    def spoil(document):
        for fault in faults:
            fault(document)

    return spoil


LINK_INERTIA = ("bodies", 1, "inertial", "inertia_kg_m2")
SPRING = ("effects", 0, "parameters")
CAPSULES = {f"{end}_{side}_m": [0, 0, 0.1 * (end == "end")] for side in "ab" for end in ("start", "end")}
TOO_LARGE = 10**400  # an integer that no double holds

# name: (fault, what the message must say: part, number, remedy)
FAULTS = {
    "unknown field": (put("bodies", 1, "colour", "red"), ['body "link1": colour', "'red'", "remove it"]),
    "unknown field at the top": (put("units", "mm"), ["units", "'mm'", "remove it"]),
    "unknown field deep inside": (
        put("joints", 0, "fit", "axial_m", 1),
        ['joint "j1": fit.axial_m', "(its value is 1)"],
    ),
    "missing field": (drop("joints", 0, "frame_b"), ['joint "j1": frame_b', "missing", "add it"]),
    "missing bodies": (drop("bodies"), ["bodies is missing", "add it"]),
    "missing id": (drop("bodies", 1, "id"), ["body 2: id is missing"]),
    "empty id": (put("bodies", 1, "id", ""), ["body 2: id", "empty", "give it a name"]),
    "blank id": (put("markers", 0, "id", "  "), ["marker", "empty", "give it a name"]),
    "id with a space at its end": (put("markers", 0, "id", "tip "), ['marker "tip "', "remove it"]),
    "text for a number": (
        put("bodies", 1, "inertial", "mass_kg", "0.05"),
        ['body "link1": inertial.mass_kg', "'0.05'", "without quotes"],
    ),
    "true for a number": (
        put("bodies", 1, "inertial", "mass_kg", True),
        ['body "link1": inertial.mass_kg', "True", "number"],
    ),
    "number for text": (put("name", 5), ["name is 5", "text in quotes"]),
    "number for true": (put("bodies", 0, "fixed", 1), ['body "ground": fixed is 1', "true or false"]),
    "null for a number": (
        put("bodies", 1, "inertial", "mass_kg", None),
        ["inertial.mass_kg", "None", "number"],
    ),
    "object for a list": (put("bodies", {}), ["bodies", "{}", "square brackets"]),
    "list for an object": (put("joints", 0, []), ["joint 1", "[]", "braces"]),
    "two coordinates": (
        put("markers", 0, "position_m", [1, 2]),
        ['marker "tip": position_m', "[2]", "add it"],
    ),
    "four coordinates": (
        put("markers", 0, "position_m", [1, 2, 3, 4]),
        ['marker "tip": position_m', "4 entries", "takes 3"],
    ),
    "NaN": (
        put("markers", 0, "position_m", [0, float("nan"), 0]),
        ['marker "tip": position_m[1]', "nan", "finite"],
    ),
    "infinity": (put("gravity_m_per_s2", [0, 0, float("-inf")]), ["gravity_m_per_s2[2]", "-inf", "finite"]),
    "too large an integer": (
        put("bodies", 1, "inertial", "mass_kg", TOO_LARGE),
        ['body "link1"', "10000", "finite"],
    ),
    "no version": (drop("schema_version"), ["schema_version is missing", "1.0", "add"]),
    "number for a version": (put("schema_version", 1.0), ["schema_version is 1.0", 'text such as "1.0"']),
    "no version at all": (put("schema_version", "new"), ["'new'", 'such as "1.0"']),
    "another major version": (put("schema_version", "2.0"), ["2.0 is not supported", "1.0", "export again"]),
    "field of a newer minor version": (
        together(put("schema_version", "1.7"), put("bodies", 1, "colour", "red")),
        ['body "link1": colour', "1.7", "knows 1.0", "update linktwin"],
    ),
    "no body": (put("bodies", []), ["no fixed body among the 0 bodies", "add a ground"]),
    "no fixed body": (drop("bodies", 0), ["no fixed body among the 1 bodies", "declare"]),
    "no mass": (drop("bodies", 1, "inertial"), ['body "link1"', "no inertial", "density"]),
    "zero mass": (put("bodies", 1, "inertial", "mass_kg", 0), ['body "link1"', "mass 0 kg", "density"]),
    "negative mass": (
        put("bodies", 1, "inertial", "mass_kg", -0.1),
        ['body "link1"', "-0.1", "mass_kg is -0.1; it must be above 0"],
    ),
    "a thin rod": (
        put(*LINK_INERTIA, "xx", 0),
        ['body "link1"', "not positive definite", "4.545e-05", "thickness"],
    ),
    "inertia with a negative moment": (
        put(*LINK_INERTIA, "xy", 1e-4),
        ['body "link1"', "not positive definite", "principal moments -", "export again"],
    ),
    "inertia that breaks the triangle inequality": (
        put(*LINK_INERTIA, "zz", 9e-5),
        ['body "link1"', "triangle inequality", "2.25e-06 + 4.545e-05 < 9e-05", "centre of mass"],
    ),
    "duplicate body": (add("bodies", lambda d: d["bodies"][1]), ['body "link1" stands 2 times', "rename"]),
    "duplicate joint": (add("joints", lambda d: d["joints"][0]), ['joint "j1" stands 2 times', "rename"]),
    "duplicate effect": (add("effects", lambda d: d["effects"][1]), ['effect "f1" stands 2 times', "rename"]),
    "duplicate marker": (
        add("markers", lambda d: d["markers"][0]),
        ['marker "tip" stands 2 times', "rename"],
    ),
    "dangling body_a": (
        put("joints", 0, "body_a", "gruond"),
        ['joint "j1": body_a "gruond"', 'Known: "ground", "link1"'],
    ),
    "dangling body_b": (
        put("joints", 0, "body_b", "link9"),
        ['joint "j1": body_b "link9"', 'Known: "ground", "link1"'],
    ),
    "joint to itself": (
        put("joints", 0, "body_a", "link1"),
        ['joint "j1"', '"link1" to itself', "two bodies"],
    ),
    "dangling marker": (put("markers", 0, "body", "arm"), ['marker "tip": body "arm"', "Known"]),
    "unknown joint type": (put("joints", 0, "type", "hinge"), ['joint "j1": type', "'hinge'", "'revolute'"]),
    "quaternion off its norm": (
        put("joints", 0, "frame_a", "quaternion_wxyz", [0.7, 0.7, 0, 0]),
        ['joint "j1": frame_a.quaternion_wxyz', "norm 0.989949", "divide"],
    ),
    "zero quaternion": (
        put("bodies", 1, "pose", "quaternion_wxyz", [0, 0, 0, 0]),
        ['body "link1": pose', "norm 0,", "divide"],
    ),
    "limits the wrong way round": (
        put("joints", 0, "limits", {"lower": 1, "upper": -1}),
        ['joint "j1": limits', "lower 1 is above upper -1", "swap"],
    ),
    "coordinate of another world": (
        put("joints", 0, "frame_a", "position_m", [0, 0, 1e160]),
        ['joint "j1": frame_a.position_m', "1e+160", "1e+09", "write it in m"],
    ),
    "a push that points nowhere": (
        effect("applied_force", ["link1"], force_n=1.0, direction=[0, 0, 0]),
        ['effect "x"', "direction has length 0", "[0, 0, 1]"],
    ),
    "an axis too short to point": (
        effect("applied_torque", ["link1"], torque_n_m=1.0, axis=[0, 1e-200, 0]),
        ['effect "x"', "axis has length 1e-200"],
    ),
    "a joint driven twice": (
        together(
            add("effects", {"id": "p1", "kind": "prescribed_motion", "on": ["j1"], "parameters": {"q": 0}}),
            add("effects", {"id": "p2", "kind": "prescribed_motion", "on": "all", "parameters": {"q": 1}}),
        ),
        ['joint "j1"', '2 effects prescribe its motion ("p1", "p2")', "keep one"],
    ),
    "negative clearance": (
        put("joints", 0, "fit", "radial_clearance_m", -1e-5),
        ['joint "j1": fit', "-1e-05", "press fit"],
    ),
    "pin thicker than its hole": (
        put("joints", 0, "fit", "pin_diameter_m", 0.009),
        ['joint "j1": fit', "9 mm", "8.1 mm", "press fit"],
    ),
    "pin without diameter": (
        put("joints", 0, "fit", "pin_diameter_m", 0),
        ['joint "j1": fit.pin_diameter_m', "0", "above 0"],
    ),
    "mesh without scale": (
        put("bodies", 1, "meshes", 0, "scale_to_m", 0),
        ['body "link1": mesh 1: scale_to_m', "0", "above 0"],
    ),
    "unknown kind": (
        effect("friction", ["j1"]),
        ['effect "x"', '"friction" is unknown', '"coulomb_friction"'],
    ),
    "a kind with a slip of the pen": (
        effect("viscus_friction", ["j1"]),
        ['"viscus_friction" is unknown. Did you mean "viscous_friction"? Known: "viscous_friction", '],
    ),
    "a parameter with a slip of the pen": (
        effect("viscous_friction", ["j1"], damping_n_m_s_per_rads=1.0),
        ['Did you mean "damping_n_m_s_per_rad"?'],
    ),
    "gravity as an effect": (effect("gravity", ["world"]), ['effect "x"', "gravity_m_per_s2"]),
    "unknown parameter": (
        effect("viscous_friction", ["j1"], damping=1.0),
        ['effect "x"', '"damping" is unknown', '"damping_n_m_s_per_rad"'],
    ),
    "parameter below its bound": (
        effect("viscous_friction", ["j1"], damping_n_m_s_per_rad=-2.0),
        ['effect "x"', "-2 N m s/rad", "lower bound 0", "raise"],
    ),
    "parameter above its bound": (
        effect("clearance", ["j1"], restitution=1.5),
        ['effect "x"', "1.5", "upper bound 1", "lower it"],
    ),
    "a word that is no shape": (
        effect("clearance", ["j1"], shape="oval"),
        ['effect "x"', "shape is 'oval'", "write 'circle' or 'rectangle'"],
    ),
    "a number for a shape": (effect("clearance", ["j1"], shape=2), ['effect "x"', "shape is 2", "'circle'"]),
    "clearance without a number or a fit": (
        together(drop("joints", 0, "fit"), effect("clearance", ["j1"])),
        ['effect "x"', "radial_m is missing", 'draw joint "j1" with fit.radial_clearance_m'],
    ),
    "clearance at a slide": (
        together(slide_too, effect("clearance", ["s"], radial_m=1e-3)),
        ['effect "x"', 'joint "s", which is prismatic', "remove it"],
    ),
    "capsules without radii": (
        effect("link_contact", ["link1", "ground"], **CAPSULES),
        ['effect "x"', "radius_a_m is missing", "radius_b_m is missing", "give it in m"],
    ),
    "capsules that no two joints tell": (
        effect("link_contact", ["link1", "ground"], radius_a_m=0.01, radius_b_m=0.01, start_a_m=[0, 0, 0]),
        ['effect "x"', "end_a_m is missing, and 1 joint of body", '"link1"', "start_b_m and end_b_m are missing"],
    ),
    "ends of one capsule for every link": (
        effect("link_contact", "all", **CAPSULES, radius_a_m=0.01, radius_b_m=0.01),
        ['effect "x"', "start_a_m is given", "every capsule ends at joints", "name two links"],
    ),
    "contact with rebound above 1": (
        effect("link_contact", ["link1", "ground"], **CAPSULES, radius_a_m=0.01, radius_b_m=0.01, restitution=1.2),
        ['effect "x"', "1.2", "upper bound 1", "lower it"],
    ),
    "friction on the bed at a joint": (
        effect("surface_friction", ["j1"], friction_coefficient=0.2),
        ['effect "x"', '"j1"', "no body has that id"],
    ),
    "list for one number": (
        effect("viscous_friction", ["j1"], damping_n_m_s_per_rad=[1, 2]),
        ['effect "x"', "a list of 2", "write one number in N m s/rad"],
    ),
    "one number for a list": (
        put(*SPRING, "anchor_a_m", 0.1),
        ['effect "s1"', "anchor_a_m is one number", "list of 3"],
    ),
    "short list": (put(*SPRING, "anchor_a_m", [0.1, 0]), ['effect "s1"', "a list of 2", "list of 3"]),
    "text for a parameter": (
        put(*SPRING, "stiffness_n_per_m", "2870"),
        ['effect "s1"', '"2870"', "number in N/m"],
    ),
    "true for a parameter": (
        put(*SPRING, "stiffness_n_per_m", True),
        ['effect "s1"', "stiffness_n_per_m", "True", "number"],
    ),
    "NaN for a parameter": (
        put(*SPRING, "stiffness_n_per_m", float("nan")),
        ['effect "s1"', "nan", "finite"],
    ),
    "too large a parameter": (
        put(*SPRING, "stiffness_n_per_m", TOO_LARGE),
        ['effect "s1"', "401 digits", "1e308"],
    ),
    "missing parameter": (
        drop(*SPRING, "anchor_b_m"),
        ['effect "s1"', "anchor_b_m is missing", "give it in m"],
    ),
    "effect at no joint": (
        effect("viscous_friction", ["j7"]),
        ['effect "x"', '"j7"', "no joint has that id", 'Known: "j1"'],
    ),
    "effect at a body instead of a joint": (
        effect("viscous_friction", ["link1"]),
        ['"link1"', "no joint has that id", '"j1"'],
    ),
    "effect on no body": (
        effect("linear_drag", ["arm"]),
        ['effect "x"', '"arm"', "no body has that id", '"link1"'],
    ),
    "effect on no marker": (
        effect("marker_offset", ["toe"]),
        ['effect "x"', '"toe"', "no marker has that id", '"tip"'],
    ),
    "effect on no spring": (
        effect("spring_preload_error", ["s9"], n=1),
        ['"s9"', "no effect has that id", '"s1"'],
    ),
    "effect on a third body": (
        effect("applied_torque", ["ground", "link1", "link2"]),
        ['effect "x"', "3 bodies", "one, or two"],
    ),
    "one spring on every body": (
        effect("extension_spring", "all", anchor_a_m=[0, 0, 0], anchor_b_m=[0, 0, 1], stiffness_n_per_m=1),
        ['effect "x"', '"all"', "extension_spring", '"link1"'],
    ),
    "a push to nowhere": (
        effect("applied_force", ["link1"], force_n=1.0, direction=[0, 0, 0]),
        ['effect "x"', "direction has length 0", "give a vector"],
    ),
    "stops the wrong way round": (
        effect("joint_stop", ["j1"], lower=0.1, upper=-0.1),
        ['effect "x"', "lower 0.1 is above upper -0.1", "swap"],
    ),
    "camera effect on a body": (
        effect("camera_scale", ["link1"]),
        ['effect "x"', "link1", '"on": ["camera"]'],
    ),
    "world effect on all": (effect("gravity_tilt", "all"), ['effect "x"', "all", '"on": ["world"]']),
    "on as text": (effect("viscous_friction", "j1"), ['effect "x": on', "'j1'", "list of ids"]),
    "on empty": (effect("viscous_friction", []), ['effect "x": on', "[]", "list of ids"]),
    "on twice the same": (effect("viscous_friction", ["j1", "j1"]), ['effect "x": on', "j1, j1", "once"]),
    "torque at a sliding joint": (
        together(slide_too, effect("coulomb_friction", ["s"], friction_torque_n_m=0.1)),
        ['effect "x"', "friction_torque_n_m", 'joint "s", which is prismatic', "use friction_force_n"],
    ),
    "force at a turning joint": (
        effect("viscous_friction", ["j1"], damping_n_s_per_m=0.1),
        ['effect "x"', 'joint "j1", which is revolute', "use damping_n_m_s_per_rad"],
    ),
    "force at a joint that slides and turns": (
        together(put("joints", 0, "type", "planar"), effect("viscous_friction", ["j1"], damping_n_s_per_m=0.1)),
        ['joint "j1", which is planar and whose slides nothing can act along, only its turn: use damping_n_m_s_per'],
    ),
    "torque at a turning and a sliding joint": (
        together(slide_too, effect("effort_offset", ["j1", "s"], torque_n_m=0.1)),
        ['effect "x"', 'joint "s", which is prismatic', "force_n"],
    ),
    "friction at a fixed joint": (
        together(slide_too, put("joints", 1, "type", "fixed"), effect("viscous_friction", ["s"])),
        ['effect "x"', 'joint "s", which is fixed', "revolute"],
    ),
    "friction on all of no joints": (put("joints", []), ['effect "f1"', '"j1"', "no joint has that id"]),
    "all of no joints": (
        together(put("joints", []), put("effects", 1, "on", "all")),
        ['effect "f1"', '"all"', "no joint", "draw one"],
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_bad_drawing_is_refused_with_part_number_and_remedy(drawings, fault):
    document = drawings.pendulum()
    spoil, terms = FAULTS[fault]
    spoil(document)
    with pytest.raises(DrawingError) as refusal:
        parse_mechanism(document, source="pendulum.json")
    message = str(refusal.value)
    assert message.startswith("pendulum.json: ")
    for term in terms:
        assert term in message
    assert "pydantic" not in message
    assert "Input should" not in message


def test_the_drawing_that_the_faults_start_from_is_good(drawings):
    document = drawings.pendulum()
    slide_too(document)
    assert isinstance(parse_mechanism(document), Mechanism)


def test_all_faults_are_listed_not_only_the_first(drawings):
    document = drawings.pendulum()
    document["bodies"][1]["inertial"]["mass_kg"] = 0
    document["joints"][0]["limits"] = {"lower": 1, "upper": 0}
    document["markers"][0]["colour"] = "red"
    with pytest.raises(DrawingError) as refusal:
        parse_mechanism(document)
    assert len(refusal.value.problems) == 3
    assert "3 problems" in str(refusal.value)

    document = drawings.pendulum()
    document["joints"][0]["body_b"] = "arm"
    document["markers"][0]["body"] = "leg"
    document["effects"][1]["kind"] = "glue"
    with pytest.raises(DrawingError) as refusal:
        parse_mechanism(document)
    assert len(refusal.value.problems) == 3


@pytest.mark.parametrize(
    ("text", "terms"),
    [
        ("", ["is not JSON", "line 1"]),
        ("{'a': 1}", ["is not JSON", "line 1, column 2"]),
        ('{"schema_version": "1.0", "name": "a", "name": "b"}', ["'name' stands twice", "keep one"]),
        ('{"gravity_m_per_s2": [0, 0, NaN]}', ["NaN", "finite"]),
        ('{"gravity_m_per_s2": [0, 0, -Infinity]}', ["-Infinity", "finite"]),
        ('{"schema_version": "1.0", "gravity_m_per_s2": [0, 0, 1e999]}', ["gravity_m_per_s2[2]", "is inf"]),
        ('{"schema_version": "1.0", "name": "crank \\ud800"}', [r"'\ud800', half of a letter"]),
        ("[" * 200_000 + "]" * 200_000, ["nested too deeply"]),
        ('{"a": ' + "9" * 5000 + "}", ["fewer digits"]),
        ('{"schema_version": "1.0", "experiments": [1, 2]}', ["a study with 2 experiments", "that it names"]),
        ('{"schema_version": "1.0", "experiments": 2}', ["bodies is missing"]),
        ("[1, 2]", ["list", "object in braces"]),
        ("3", ["int", "object in braces"]),
    ],
)  # fmt: skip
def test_a_file_that_is_no_drawing_is_refused(tmp_path, text, terms):
    path = tmp_path / "mechanism.json"
    path.write_text(text)
    with pytest.raises(DrawingError) as refusal:
        read_mechanism(path)
    for term in ["mechanism.json", *terms]:
        assert term in str(refusal.value)


def test_a_drawing_in_the_place_of_a_study_is_told(tmp_path, drawings):
    path = tmp_path / "mechanism.json"
    path.write_text(json.dumps(drawings.pendulum()))
    with pytest.raises(DrawingError, match=r"holds a drawing with 2 bodies; give a study\.json that names it"):
        read_study(path)


def test_a_name_may_hold_any_whole_letter(tmp_path, drawings):
    path = tmp_path / "mechanism.json"
    path.write_text(json.dumps({**drawings.pendulum(), "name": "crank \U0001f680"}))  # as two halves
    assert read_mechanism(path).name == "crank \U0001f680"


def test_a_file_that_cannot_be_opened_is_refused(tmp_path):
    with pytest.raises(DrawingError, match=r"nowhere\.json: cannot be read \(No such file"):
        read_mechanism(tmp_path / "nowhere.json")
    with pytest.raises(DrawingError, match="directory"):
        read_mechanism(tmp_path)
    (tmp_path / "zip.json").write_bytes(b"PK\x03\x04\xff\xfe")
    with pytest.raises(DrawingError, match="not UTF-8"):
        read_mechanism(tmp_path / "zip.json")


def test_a_file_too_large_for_a_drawing_is_not_loaded(tmp_path):
    path = tmp_path / "huge.json"
    with path.open("wb") as file:
        file.truncate(65 * 2**20)  # sparse: takes no space
    with pytest.raises(DrawingError, match="65 MB, above the limit of 64 MB"):
        read_mechanism(path)


def test_a_byte_order_mark_is_no_fault(tmp_path, drawings):
    path = tmp_path / "mechanism.json"
    path.write_text(json.dumps(drawings.pendulum()), encoding="utf-8-sig")
    assert read_mechanism(path).name == "pendulum"


def test_an_unknown_id_lists_the_known_ones(drawings):
    mechanism = parse_mechanism(drawings.pendulum())
    assert mechanism.body("link1").id == "link1"
    assert mechanism.joint("j1").id == "j1"
    assert mechanism.effect("f1").kind == "viscous_friction"
    assert mechanism.marker("tip").body == "link1"
    for find, known in ((mechanism.body, "link1"), (mechanism.joint, "j1"), (mechanism.effect, "s1")):
        with pytest.raises(DrawingError, match=f'"nobody".*"{known}"'):
            find("nobody")
    with pytest.raises(DrawingError, match=r'there is no marker "toe".*"tip"'):
        mechanism.marker("toe")


def test_a_repeated_key_among_many_is_found_at_once():
    keys = ", ".join(f'"k{number}": 0' for number in range(200_000))
    began = time.process_time()
    with pytest.raises(DrawingError, match=r"key 'k0', 'k1', .* and 199995 more stands twice"):
        decode(f"{{{keys}, {keys}}}", "mechanism.json")
    assert time.process_time() - began < 5.0  # counted one by one: an hour


@pytest.mark.parametrize("on", ["all", ["j1"]])
def test_many_effects_at_many_joints_are_read_in_the_time_of_both(drawings, on):
    document = drawings.pendulum()
    document["joints"] += [{**document["joints"][0], "id": f"k{number}"} for number in range(4000)]
    document["effects"] = [{"id": f"e{number}", "kind": "viscous_friction", "on": on} for number in range(4000)]
    began = time.process_time()
    parse_mechanism(document)
    assert time.process_time() - began < 5.0  # each joint asked for each effect: a minute and more


@pytest.mark.parametrize("known", [0, 20_000])
def test_a_hostile_list_of_places_is_refused_at_once_and_in_a_few_lines(drawings, known):
    document = drawings.pendulum()
    document["markers"] += [{**document["markers"][0], "id": f"m{number}"} for number in range(known)]
    effect = {"kind": "marker_offset", "on": [f"none{number}" for number in range(10_000)], "parameters": {}}
    document["effects"] = [{**effect, "id": f"e{number}"} for number in range(3)]
    began = time.process_time()
    with pytest.raises(DrawingError) as refusal:
        parse_mechanism(document)
    assert time.process_time() - began < 5.0
    assert len(refusal.value.problems) == MOST_LISTED + 1
    assert "none0" in refusal.value.problems[0]
    document["effects"][0]["on"] = [f"m{number}" for number in range(MOST_PLACES + 1)]
    with pytest.raises(DrawingError, match="on has 20001 names, above the limit of 20000"):
        parse_mechanism(document)
