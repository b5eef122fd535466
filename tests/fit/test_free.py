import numpy as np
import pytest

from backend.fit.free import free_parameters
from backend.mechanism.apart import set_apart
from backend.mechanism.effect import Effect
from backend.mechanism.marker import Marker
from backend.mechanism.read import parse_mechanism
from backend.mechanism.study import Tolerance
from backend.model.build import build

UNIT = {"position_m": [0, 0, 0], "quaternion_wxyz": [1, 0, 0, 0]}
SOLID = {
    "mass_kg": 1.0,
    "center_of_mass_m": [0, 0, 0],
    "inertia_kg_m2": {"xx": 1, "yy": 1, "zz": 1, "xy": 0, "xz": 0, "yz": 0},
}


@pytest.fixture(scope="module")
def mechanism():
    """Two turning joints in a chain with a slider at its end, and a spring drawn."""
    bodies = [{"id": "ground", "fixed": True, "pose": UNIT}]
    bodies += [{"id": b, "pose": UNIT, "inertial": SOLID} for b in ("link1", "link2", "block")]
    chain = [("j1", "revolute"), ("j2", "revolute"), ("slide", "prismatic")]
    ids = [b["id"] for b in bodies]
    joints = [
        {"id": j, "type": t, "body_a": a, "body_b": b, "frame_a": UNIT, "frame_b": UNIT}
        for (j, t), a, b in zip(chain, ids, ids[1:], strict=False)
    ]
    effects = [
        {"id": "s1", "kind": "extension_spring", "on": ["block", "ground"],
         "parameters": {"anchor_a_m": [0, 0, 0], "anchor_b_m": [1, 0, 0], "stiffness_n_per_m": 200.0}},
        {"id": "push", "kind": "applied_force", "on": ["block"], "parameters": {"direction": [1, 0, 0]}},
        {"id": "grease", "kind": "viscous_friction", "on": ["j1"], "parameters": {"damping_n_m_s_per_rad": 0.3}},
    ]  # fmt: skip
    return parse_mechanism(
        {"schema_version": "1.0", "name": "chain", "gravity_m_per_s2": [0, 0, -9.81], "bodies": bodies,
         "joints": joints, "effects": effects, "markers": [],
         "provenance": {"tool": "t", "tool_version": "1", "exporter": "e", "exporter_version": "1",
                        "created": "2026-01-01T00:00:00Z", "warnings": []}}
    )  # fmt: skip


def names(mechanism, *specs):
    return [p.name for p in free_parameters(mechanism, specs).parameters]


def test_a_star_frees_every_joint_on_its_own_in_the_unit_of_its_kind(mechanism):
    assert names(mechanism, "coulomb_friction:*") == [
        "coulomb_friction:j1.friction_torque_n_m",
        "coulomb_friction:j2.friction_torque_n_m",
        "coulomb_friction:slide.friction_force_n",
    ]


def test_a_drawn_effect_by_its_id_is_free_in_what_suits_its_joint(mechanism):
    (damping,) = free_parameters(mechanism, ["viscous_friction:grease"]).parameters
    assert (damping.name, damping.start) == ("viscous_friction:grease.damping_n_m_s_per_rad", 0.3)


def test_an_effect_drawn_on_several_joints_is_free_as_one_or_at_each(mechanism):
    rub = Effect(id="rub", kind="coulomb_friction", on="all", parameters={"friction_torque_n_m": 0.2})
    drawn = set_apart(mechanism.model_copy(update={"effects": (*mechanism.effects, rub)}))
    freedom = free_parameters(drawn, ["coulomb_friction:rub"])
    (one,) = freedom.parameters
    assert (one.name, one.on, one.start) == ("coulomb_friction:rub.friction_torque_n_m", ("rub",), 0.2)
    assert [id for id, _ in one.addresses] == ["rub@j1", "rub@j2"]
    assert freedom.added == ()
    assert [p.start for p in free_parameters(drawn, ["coulomb_friction:*"]).parameters] == [0.2, 0.2, 0.0]
    (rest,) = free_parameters(drawn, ["coulomb_friction:all-rub"]).parameters
    assert (rest.on, rest.parameter) == (("slide",), "friction_force_n")


def test_an_effect_on_joints_of_both_kinds_is_free_by_each_of_its_parameters(mechanism):
    rub = Effect(id="rub", kind="coulomb_friction", on="all")
    drawn = set_apart(mechanism.model_copy(update={"effects": (*mechanism.effects, rub)}))
    both = free_parameters(drawn, ["coulomb_friction:rub"]).parameters
    again = free_parameters(drawn, [p.name for p in both]).parameters  # as whoever reads fit.json does
    assert again == both
    assert [[id for id, _ in p.addresses] for p in both] == [["rub@j1", "rub@j2"], ["rub@slide"]]
    with pytest.raises(ValueError, match="'rest_rad' is unknown there"):
        free_parameters(drawn, ["coulomb_friction:rub.rest_rad"])


@pytest.mark.parametrize(("id", "on"), [("motor", ["j1"]), ("motor", "all"), ("effort_offset", "all")])
def test_what_is_free_beside_a_recorded_drive_is_an_effect_of_its_own(mechanism, id, on):
    motor = Effect(id=id, kind="effort_offset", on=on)
    drawn = mechanism.model_copy(update={"effects": (*mechanism.effects, motor)})
    freedom = free_parameters(drawn, ["effort_offset:j1"], recorded={id})
    (offset,) = freedom.parameters
    (added,) = freedom.added
    assert offset.addresses == ((added.id, "torque_n_m"),)
    assert set(build(drawn, freedom.added).addresses(id, "torque_n_m")).isdisjoint(offset.addresses)


def test_an_end_of_travel_is_told_in_the_unit_of_its_joint(mechanism):
    ends = free_parameters(mechanism, ["joint_stop:j1.lower", "joint_stop:slide.upper"]).parameters
    assert [end.unit for end in ends] == ["rad", "m"]


def test_what_stands_still_and_one_marker_of_a_picture_are_free_by_name_only(mechanism):
    seen = mechanism.model_copy(update={"markers": (Marker(id="m", body="link1", position_m=(0, 0, 0)),)})
    assert names(seen, "length_error:*") == [f"length_error:{b}.relative" for b in ("link1", "link2", "block")]
    assert names(seen, "length_error:ground", "camera_scale:m") == [
        "length_error:ground.relative", "camera_scale:m.relative",
    ]  # fmt: skip


def test_all_shares_one_value_per_unit(mechanism):
    torque, force = free_parameters(mechanism, ["coulomb_friction:all"]).parameters
    assert torque.name == "coulomb_friction:all.friction_torque_n_m"
    assert len(torque.addresses) == 2
    assert len(force.addresses) == 1


def test_all_but_some_shares_one_value_among_the_rest(mechanism):
    torque, force = free_parameters(mechanism, ["coulomb_friction:all-j2"]).parameters
    assert (torque.on, force.on) == (("j1",), ("slide",))
    assert free_parameters(mechanism, ["coulomb_friction:all-j1+slide"]).parameters[0].on == ("j2",)
    with pytest.raises(ValueError, match="does not act at 'j9'"):
        free_parameters(mechanism, ["coulomb_friction:all-j9"])


def test_a_name_in_fit_json_frees_the_same_number_again(mechanism):
    for spec in ("coulomb_friction:*", "coulomb_friction:all", "coulomb_friction:all-j1", "coulomb_friction:j1+j2"):
        for parameter in free_parameters(mechanism, [spec]).parameters:
            (again,) = free_parameters(mechanism, [parameter.name]).parameters
            assert again == parameter


def test_a_plus_shares_one_value_among_those_named(mechanism):
    (shared,) = free_parameters(mechanism, ["air_drag:link1+link2"]).parameters
    assert shared.on == ("link1", "link2")
    assert len(shared.addresses) == 2


def test_commas_and_repeats_say_the_same(mechanism):
    assert names(mechanism, "viscous_friction:j1,air_drag:link2") == names(
        mechanism, "viscous_friction:j1", "air_drag:link2"
    )


def test_a_drawn_effect_is_freed_in_place_from_its_drawn_value(mechanism):
    freedom = free_parameters(mechanism, ["viscous_friction:j1", "extension_spring:s1.stiffness_n_per_m"])
    assert [p.start for p in freedom.parameters] == [0.3, 200.0]
    assert [p.addresses[0][0] for p in freedom.parameters] == ["grease", "s1"]
    assert freedom.added == ()


def test_an_absent_effect_is_added_at_values_that_mean_absent(mechanism):
    freedom = free_parameters(mechanism, ["coulomb_friction:j2"])
    assert freedom.parameters[0].start == 0.0
    assert freedom.parameters[0].lower == 0.0
    assert freedom.parameters[0].upper == np.inf
    assert [(e.kind, e.on) for e in freedom.added] == [("coulomb_friction", ("j2",))]


def test_the_camera_needs_no_place(mechanism):
    assert names(mechanism, "camera_rotation") == ["camera_rotation:camera.rad"]


def test_a_tolerance_becomes_a_nuisance_with_its_prior(mechanism):
    tolerance = Tolerance(kind="mass_error", on=("link1", "link2"), sd=0.02)
    parameters = free_parameters(mechanism, ["mass_error:link2"], [tolerance]).parameters
    assert {p.name: (p.prior_sd, p.nuisance) for p in parameters} == {
        "mass_error:link1.relative": (0.02, True),
        "mass_error:link2.relative": (0.02, False),
    }


def test_a_motion_is_freed_at_the_joint_where_it_is_drawn(mechanism):
    motion = Effect(id="motor", kind="prescribed_motion", on=("j1",), parameters={"q": 0.2})
    driven = mechanism.model_copy(update={"effects": (*mechanism.effects, motion)})
    for place in ("*", "j1", "motor"):
        (freed,) = free_parameters(driven, [f"prescribed_motion:{place}"]).parameters
        assert freed.addresses == (("motor", "q"),)
        assert freed.start == 0.2


@pytest.mark.parametrize(
    ("spec", "sentence"),
    [
        ("friction:j1", r'kind "friction" is unknown.*[^.]\. Write KIND:ON'),
        ("viscous_friction", "no place is named"),
        ("viscous_friction:j9", "does not act at 'j9'.*j1.*j2.*slide"),
        ("viscous_friction:j1.stiffness", "is unknown there"),
        ("prescribed_motion:*", "applies nowhere.*draw it"),
        ("prescribed_motion:j1", "does not act at 'j1'"),
        ("extension_spring:s1.anchor_a_m[3]", "not one of its numbers"),
        ("applied_force:push.direction", "is a direction"),
        ("spring_stiffness_error:grease", "does not act at 'grease'.*s1"),
        ("release_velocity:weld", "does not act at 'weld'"),
        ("viscous_friction:j1,viscous_friction:all", "are the same number"),
    ],
)
def test_a_spec_that_cannot_be_read_says_what_can(mechanism, spec, sentence):
    with pytest.raises(ValueError, match=sentence):
        free_parameters(mechanism, [spec])


def test_each_number_of_several_is_free_by_itself_and_those_out_of_the_plane_are_left_out(mechanism):
    planar = mechanism.model_copy(update={"joints": mechanism.joints[:2]})  # both turn about z, and nothing slides
    assert names(planar, "center_of_mass_error:link1") == [
        "center_of_mass_error:link1.offset_m[0]",
        "center_of_mass_error:link1.offset_m[1]",
    ]
    assert names(planar, "base_motion:world") == [
        "base_motion:world.amplitude_m[0]",
        "base_motion:world.amplitude_m[1]",
    ]
    assert names(planar, "joint_axis_error:j1") == ["joint_axis_error:j1.rad[0]", "joint_axis_error:j1.rad[1]"]
    assert len(names(mechanism, "center_of_mass_error:link1")) == 3  # the slider leaves the plane
    (named,) = free_parameters(planar, ["center_of_mass_error:link1.offset_m[2]"]).parameters
    assert named.addresses == (("center_of_mass_error@link1", "offset_m[2]"),)
    (anchor,) = free_parameters(mechanism, ["extension_spring:s1.anchor_b_m[0]"]).parameters
    assert anchor.start == 1.0


def test_a_push_is_free_at_the_first_joint_or_where_it_is_named_in_the_unit_of_the_joint(mechanism):
    assert names(mechanism, "release_velocity") == ["release_velocity:world.rad_per_s"]
    assert names(mechanism, "release_velocity:slide") == ["release_velocity:slide.m_per_s"]


def test_an_error_of_a_spring_stands_on_the_drawn_spring(mechanism):
    assert names(mechanism, "spring_stiffness_error:*") == ["spring_stiffness_error:s1.relative"]
    assert names(mechanism, "spring_preload_error:s1") == ["spring_preload_error:s1.n"]


def test_a_link_that_was_drawn_rigid_begins_to_bend_a_little(mechanism):
    freedom = free_parameters(mechanism, ["link_flexibility:link1"])
    stiffness, damping = freedom.parameters
    length = np.sqrt(12.0)  # of the bar of 1 kg and 1 kg m²
    assert stiffness.start == pytest.approx(0.5 * 9.80665 * length / 0.01)
    assert damping.start == 0.0
    assert freedom.added[0].on == ("link1",)
