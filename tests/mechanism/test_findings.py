"""What `check` says of numbers that can be read and are no linkage's."""

import pytest

from backend.mechanism.graph import describe
from backend.mechanism.read import parse_mechanism


def scaled(lengths=1.0, mass=1.0, inertia=1.0, gravity=1.0):
    """The same numbers in other units."""

    def change(document):
        document["gravity_m_per_s2"] = [gravity * g for g in document.get("gravity_m_per_s2", [0, 0, -9.80665])]
        placed = [body["pose"] for body in document["bodies"] if "pose" in body]
        placed += [joint[frame] for joint in document["joints"] for frame in ("frame_a", "frame_b")]
        for frame in placed:
            frame["position_m"] = [lengths * x for x in frame["position_m"]]
        for body in document["bodies"]:
            if inertial := body.get("inertial"):
                inertial["mass_kg"] *= mass
                inertial["center_of_mass_m"] = [lengths * x for x in inertial["center_of_mass_m"]]
                inertial["inertia_kg_m2"] = {n: inertia * x for n, x in inertial["inertia_kg_m2"].items()}

    return change


def pin(**fit):
    return lambda document: document["joints"][0].update(fit=fit)


def effect(kind, **parameters):
    one = {"id": "x", "kind": kind, "on": [0], "parameters": parameters}
    return lambda document: document.setdefault("effects", []).append({**one, "on": [document["joints"][0]["id"]]})


def spring(anchor_a_m, anchor_b_m, **more):
    """From the crank, whose axes are drawn as the world's, to the ground."""
    given = {"anchor_a_m": anchor_a_m, "anchor_b_m": anchor_b_m, "stiffness_n_per_m": 50.0, "free_length_m": 0.1}
    one = {"id": "s", "kind": "extension_spring", "on": ["crank"], "parameters": given | more}
    return lambda document: document.setdefault("effects", []).append(one)


FOUND = {
    "inertia in g mm²": (scaled(inertia=1e9), ['body "crank"', "lighter than air", "1 g mm² is 1e-9"]),
    "inertia in kg mm²": (scaled(inertia=1e6), ['body "crank"', "lighter than air", "kg m²"]),
    "mass in g": (scaled(mass=1e3), ['body "crank"', "denser than any matter", "mass is in kg"]),
    "all of it in mm and g": (scaled(lengths=1e3, mass=1e3, inertia=1e9), ['body "crank"', "lighter than air"]),
    "lengths in mm": (scaled(lengths=1e3), ['body "crank"', "mm long", "m apart; lengths are in m"]),
    "gravity in mm/s²": (scaled(gravity=1e3), ["gravity_m_per_s2", "9807 m/s²", "1000 times", "in m/s²"]),
    "an inertia of no size": (scaled(inertia=1e308), ['body "crank"', "lighter than air"]),
    "diameters in mm": (pin(pin_diameter_m=8, hole_diameter_m=8.1), ['joint "A"', "8.1 m wide", "in m"]),
    "play in mm": (pin(radial_clearance_m=0.05), ['joint "A"', "0.05 m", "5% of the mechanism's size", "in m"]),
    "a clearance in mm": (effect("clearance", radial_m=0.05), ['effect "x"', "0.05 m", "5%", "in m"]),
    "limits in degrees": (
        lambda document: document["joints"][0].update(limits={"lower": -90, "upper": 90}),
        ['joint "A"', "90 rad", "14.3 turns"],
    ),
    "a stop in degrees": (effect("joint_stop", lower=-90, upper=90), ['effect "x"', "90 rad", "14.3 turns"]),
    "a marker in mm": (
        lambda document: document.setdefault("markers", []).append(
            {"id": "knee", "body": "crank", "position_m": [20.0, 0.0, 0.0]}
        ),
        ['marker "knee" is drawn 20 m from a joint of its body "crank"', "times the mechanism's size", "in m"],
    ),
    "a spring with both its ends at one point": (
        spring([0.02, 0.0, 0.0], [0.02, 0.0, 0.0]),
        ['effect "s": both its ends are drawn at one point, [0.02, 0, 0] m', "no direction", "first body's axes"],
    ),
    "drawn beyond a stop": (
        effect("joint_stop", lower=0.5, upper=1.0),
        ['effect "x": joint "A" is drawn at', "beyond the lower end 0.5 rad", "correct the end or the pose"],
    ),
}


@pytest.mark.parametrize("number", FOUND)
def test_a_number_of_another_unit_is_told_with_part_and_remedy(drawings, number):
    document = drawings.fourbar()
    change, terms = FOUND[number]
    assert describe(parse_mechanism(document)).warnings == ()
    change(document)
    told = describe(parse_mechanism(document)).warnings
    assert any(all(term in sentence for term in terms) for sentence in told), told


def test_a_plate_a_line_and_a_balanced_rotor_are_no_finding(drawings):
    document = drawings.pendulum()
    document["joints"][0] |= {"limits": None, "fit": {"pin_diameter_m": 0.02}}
    for moments in ((1e-5, 1e-5, 2e-5), (1e-12, 1e-5, 1e-5), (1e-5, 1e-5, 1.5e-5)):
        tensor = dict(zip(("xx", "yy", "zz"), moments, strict=True))
        document["bodies"][1]["inertial"] |= {"mass_kg": 0.05, "center_of_mass_m": [0, 0, 0], "inertia_kg_m2": tensor}
        assert describe(parse_mechanism(document)).warnings == ()


def test_a_long_pointer_and_a_spring_that_is_slack_at_one_point_are_no_finding(drawings):
    document = drawings.fourbar()
    spring([0.02, 0, 0], [0.02, 0, 0], free_length_m=0.0)(document)
    document["markers"] = [{"id": "pointer", "body": "crank", "position_m": [0.4, 0.0, 0.0]}]
    assert describe(parse_mechanism(document)).warnings == ()
