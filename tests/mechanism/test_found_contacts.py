"""Links that may meet, found in the drawing."""

import numpy as np
import pytest

from backend.mechanism.check import check_text
from backend.mechanism.drawing_error import DrawingError
from backend.mechanism.found_contacts import contacts_declared, found_contacts
from backend.mechanism.graph import describe
from backend.mechanism.read import parse_mechanism
from benchmarks.scissor import LENGTH_M, WIDTH_M, scissor
from tests.mechanisms import SPAN_M, bennett, effect, fourbar, parallelogram


def meeting(mechanism, **parameters):
    """The drawing with a contact on every pair of links."""
    return mechanism.model_copy(update={"effects": (effect("meet", "link_contact", "all", **parameters),)})


def layered(cells):
    """A scissor whose second bars lie on the first ones."""
    document = scissor(cells).model_dump(mode="json")
    for body in document["bodies"]:
        if body["id"].startswith("b"):
            body["inertial"]["center_of_mass_m"][2] = WIDTH_M
    return parse_mechanism(document)


def pairs(mechanism):
    (found,) = found_contacts(mechanism)
    return {frozenset(pair) for pair in found.pairs}


def test_links_that_a_joint_connects_do_not_meet():
    found = pairs(meeting(scissor(3)))
    assert found == {
        frozenset(pair) for pair in (("a0", "a1"), ("a0", "a2"), ("a1", "a2"), ("b0", "b1"), ("b0", "b2"), ("b1", "b2"))
    } | {frozenset(("a0", "b2")), frozenset(("b0", "a2"))}


def test_links_in_different_layers_do_not_meet():
    assert all(len({id[0] for id in pair}) == 1 for pair in pairs(meeting(layered(4))))
    assert len(pairs(meeting(layered(4)))) == 12


def test_a_capsule_is_as_long_as_the_joints_are_apart_and_as_wide_as_the_bar():
    declared = contacts_declared(meeting(scissor(2))).effect("meet@a0-a1").parameters
    np.testing.assert_allclose(np.abs(np.subtract(declared["end_a_m"], declared["start_a_m"])), [LENGTH_M, 0, 0])
    assert declared["radius_a_m"] == pytest.approx(0.5 * WIDTH_M)


def test_a_given_radius_holds_for_every_link():
    declared = contacts_declared(meeting(scissor(2), radius_a_m=0.004)).effect("meet@b0-b1").parameters
    assert declared["radius_a_m"] == declared["radius_b_m"] == 0.004


def test_what_is_found_reads_as_a_drawing():
    declared = contacts_declared(meeting(scissor(3), friction_coefficient=0.2))
    assert (
        parse_mechanism(declared.model_dump(mode="json")).effect("meet@a0-a1").parameters["friction_coefficient"] == 0.2
    )


def test_links_that_overlap_as_drawn_are_left_out_and_told():
    drawn = meeting(scissor(3), radius_a_m=0.1)
    (found,) = found_contacts(drawn)
    assert ("a0", "a1") in found.overlapping
    assert "overlap as drawn" in check_text(describe(drawn))


def test_bars_in_space_meet_in_any_layer():
    assert pairs(meeting(bennett(), radius_a_m=0.005)) == {frozenset(("link0", "link2"))}


def test_a_ground_drawn_as_a_bar_is_met_by_links_that_no_joint_connects_with_it():
    assert pairs(meeting(parallelogram())) == {frozenset(("crank", "rocker")), frozenset(("coupler", "ground"))}
    declared = contacts_declared(meeting(parallelogram())).effect("meet@ground-coupler").parameters
    np.testing.assert_allclose([declared["start_a_m"], declared["end_a_m"]], [[0, 0, 0], [SPAN_M, 0, 0]])
    assert declared["radius_a_m"] == pytest.approx(0.5 * WIDTH_M)


def test_a_ground_in_another_layer_is_not_met():
    document = parallelogram().model_dump(mode="json")
    document["bodies"][0]["inertial"]["center_of_mass_m"][2] = WIDTH_M
    assert pairs(meeting(parse_mechanism(document))) == {frozenset(("crank", "rocker"))}


def test_check_names_the_pairs_and_a_ground_that_nothing_meets():
    text = check_text(describe(meeting(fourbar())))
    assert "contacts  meet: 1 pair may meet: crank-rocker; none meets ground, drawn without a bar's shape" in text
    assert "none meets" not in check_text(describe(meeting(parallelogram())))


def test_too_many_pairs_are_refused_with_their_number():
    drawn = meeting(scissor(20))
    with pytest.raises(DrawingError, match=r'"meet": 722 pairs .* more than 200; draw the links in their layers'):
        found_contacts(drawn)
    assert any("722 pairs" in error for error in describe(drawn).errors)


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"start_a_m": [0, 0, 0]}, "every capsule ends at joints"),
        ({"radius_a_m": 0.01, "radius_b_m": 0.02}, "one radius for all links"),
    ],
)
def test_what_belongs_to_one_pair_is_refused_for_all(parameters, words):
    document = scissor(2).model_dump(mode="json")
    document["effects"] = [{"id": "meet", "kind": "link_contact", "on": "all", "parameters": parameters}]
    with pytest.raises(DrawingError, match=words):
        parse_mechanism(document)
