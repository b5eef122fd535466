"""From a drawing to arrays."""

import jax
import numpy as np
import pytest

from backend.fit.free import free_parameters
from backend.mechanism.apart import set_apart
from backend.mechanism.read import parse_mechanism
from backend.model.build import build
from backend.model.state import drawn_pose
from backend.model.system import system
from backend.simulate import kinematics, points
from backend.simulate.record import on_steps
from tests.mechanisms import (
    bead_on_bar,
    document,
    double_pendulum,
    effect,
    fourbar,
    pendulum,
    scissor,
    sliding_mass,
)


def test_bodies_stand_in_levels_so_that_joints_link_neighbours():
    topology = build(scissor(6)).topology
    real = [slot for slot, body in enumerate(topology.body_ids) if body is not None]
    assert len(real) == 12
    for a, b in topology.links:
        if max(a, b) < topology.slots:
            assert abs(a // topology.width - b // topology.width) <= 1


def test_a_long_scissor_is_deep_and_narrow():
    assert build(scissor(12)).topology.width <= 3  # the solve costs width³ per level


def test_every_parameter_is_found_by_effect_and_name_with_its_declaration():
    friction = effect("f", "viscous_friction", "all", damping_n_m_s_per_rad=0.02)
    model = build(double_pendulum([friction, effect("g", "air_drag", ["lower"], drag_area_m2=1e-3)]))
    row = model.parameters["f", "damping_n_m_s_per_rad"]
    assert (row.kind, row.on, row.value) == ("viscous_friction", ("shoulder", "elbow"), 0.02)
    assert (row.declaration.unit, row.declaration.lower) == ("N m s/rad", 0.0)
    assert model.parameters["g", "drag_area_m2"].on == ("lower",)


def test_a_parameter_can_be_replaced_without_touching_the_others():
    friction = [effect(name, "viscous_friction", [j]) for name, j in (("f", "shoulder"), ("g", "elbow"))]
    model = build(double_pendulum(friction))
    changed = model.with_parameters({("g", "damping_n_m_s_per_rad"): 0.5})
    assert changed.parameters["g", "damping_n_m_s_per_rad"].value == 0.5
    assert changed.parameters["f", "damping_n_m_s_per_rad"].value == 0.0
    assert model.parameters["g", "damping_n_m_s_per_rad"].value == 0.0


def test_an_unknown_parameter_is_refused_with_those_that_exist():
    model = build(pendulum(effects=[effect("f", "viscous_friction", ["pin"])]))
    with pytest.raises(KeyError, match=r"no parameter 'f.grease'.*f.damping_n_m_s_per_rad"):
        model.with_parameters({("f", "grease"): 1.0})


def test_pin_friction_without_a_pin_size_is_refused():
    drawn = pendulum()
    bare = drawn.model_copy(update={"joints": tuple(j.model_copy(update={"fit": None}) for j in drawn.joints)})
    with pytest.raises(ValueError, match=r"'f'.*joint 'pin' needs the pin's size.*pin_diameter_m"):
        build(bare, [effect("f", "pin_friction", ["pin"])])


def test_an_effect_that_a_joint_cannot_have_is_refused():
    with pytest.raises(ValueError, match=r"'s': torsion_spring cannot act at prismatic joint 'rail'"):
        build(sliding_mass(), [effect("s", "torsion_spring", ["rail"])])


def test_an_effect_on_all_acts_where_it_can():
    model = build(bead_on_bar([effect("p", "pin_friction", "all"), effect("v", "viscous_friction", "all")]))
    on = {id: row.on for (id, _), row in model.parameters.items()}
    assert on == {"p": ("pin",), "v@pin": ("pin",), "v@rail": ("rail",)}


def test_torques_turn_and_forces_slide_whatever_stands_on_all():
    both = effect("rub", "coulomb_friction", "all", friction_torque_n_m=0.01, friction_force_n=2.0)
    model = build(bead_on_bar([both]))
    assert {address: row.value for address, row in model.parameters.items() if "friction" in address[1]} == {
        ("rub@pin", "friction_torque_n_m"): 0.01, ("rub@pin", "friction_force_n"): 0.0,
        ("rub@rail", "friction_torque_n_m"): 0.0, ("rub@rail", "friction_force_n"): 2.0,
    }  # fmt: skip
    np.testing.assert_allclose(system(model).dry_limit, [0.01, 2.0])
    torque = effect("rub", "coulomb_friction", "all", friction_torque_n_m=0.01)
    np.testing.assert_allclose(system(build(bead_on_bar([torque]))).dry_limit, [0.01, 0.0])


def test_an_override_of_a_torque_leaves_what_slides_alone():
    both = effect("rub", "coulomb_friction", "all", friction_torque_n_m=0.01, friction_force_n=2.0)
    model = build(bead_on_bar([both]))
    values = model.overridden({"rub": {"friction_torque_n_m": 0.03}})
    assert values == {("rub@pin", "friction_torque_n_m"): 0.03}
    np.testing.assert_allclose(system(model.with_parameters(values)).dry_limit, [0.03, 2.0])


@pytest.mark.parametrize("parameters", [{}, {"torque_n_m": 0.0, "force_n": 0.0}])
def test_a_recorded_torque_drives_what_turns_whatever_its_effect_stands_on(parameters):
    model = build(bead_on_bar([effect("motor", "effort_offset", "all", **parameters)]))
    times = np.linspace(0.0, 1.0, 3)
    record = on_steps(model, [(("motor", "torque_n_m"), times, times)], 0.5, 2)
    assert record.addresses == (("motor@pin", "torque_n_m"),)
    record.apply(system(model), record.values[-1])
    with pytest.raises(ValueError, match=r"'brake\.torque_n_m' takes no recorded input; inputs here: motor@pin"):
        on_steps(model, [(("brake", "torque_n_m"), times, times)], 0.5, 2)


def test_an_override_stays_with_the_joints_of_its_effect():
    """A drawn effect may be called like its kind, as what a fit adds elsewhere is."""
    drawn = set_apart(fourbar([effect("viscous_friction", "viscous_friction", ["j1", "j2"])]))
    model = build(drawn, free_parameters(drawn, ["viscous_friction:*"]).added)
    values = model.overridden({"viscous_friction": {"damping_n_m_s_per_rad": 0.1}})
    assert set(values) == {(f"viscous_friction@{j}", "damping_n_m_s_per_rad") for j in ("j1", "j2")}


def test_two_effects_of_one_id_are_refused():
    again = effect("f", "viscous_friction", ["pin"])
    with pytest.raises(ValueError, match="'f' is used twice"):
        build(pendulum(effects=[again]), [again])


def test_markers_start_where_they_are_drawn():
    model = build(fourbar())
    plant = system(model)
    at = points.marker_positions(model, plant, drawn_pose(model, plant))
    np.testing.assert_allclose(at, [[0.28, 0.2, 0.0]], atol=1e-15)


def test_two_drawings_of_one_topology_share_one_compiled_program():
    traces = []

    @jax.jit
    def mass(model):
        traces.append(model.topology)
        return system(model).mass

    light, heavy = build(fourbar()), build(fourbar(coupler_to=(0.3, 0.18), density=0.9))
    assert mass(light).sum() < mass(heavy).sum()
    assert len(traces) == 1


def test_a_clearance_takes_its_play_from_each_joints_own_fit():
    drawn = document(fourbar())
    for joint, hole in zip(drawn["joints"], (0.0082, 0.0084, 0.0086, 0.0088), strict=True):
        joint["fit"]["hole_diameter_m"] = hole
    rows = build(parse_mechanism(drawn), [effect("play", "clearance", "all")]).parameters
    drawn_play = [rows[f"play@j{i}", "radial_m"].value for i in (1, 2, 3, 4)]
    np.testing.assert_allclose(drawn_play, [1e-4, 2e-4, 3e-4, 4e-4], rtol=1e-9)
    rows = build(parse_mechanism(drawn), [effect("play", "clearance", ["j3"], radial_m=1e-3)]).parameters
    assert rows["play", "radial_m"].value == 1e-3  # what is stated comes before what is drawn


def test_two_clearances_at_one_joint_are_refused():
    plays = [effect(name, "clearance", ["pin"], radial_m=1e-3) for name in "ab"]
    with pytest.raises(ValueError, match="two clearances act at one joint"):
        system(build(pendulum(), plays))


def test_a_joint_that_is_told_twice_where_to_be_is_refused_by_name():
    paths = [effect(name, "prescribed_motion", ["pin"]) for name in "ab"]
    with pytest.raises(ValueError, match="effects 'a' and 'b' both prescribe the motion of joint 'pin'; keep one"):
        build(pendulum(), paths)


def test_the_shape_of_a_hole_and_the_rings_of_a_bearing_decide_its_walls():
    counts = []
    for given in ({}, {"shape": "rectangle"}, {"bearing_length_m": 0.01}):
        play = effect("play", "clearance", ["pin"], radial_m=1e-3, **given)
        counts.append(system(build(pendulum(), [play])).contacts.count)
    assert counts == [1, 4, 2]


@pytest.mark.parametrize(("drawn", "wanted"), [({}, 0.01), ({"bearing_length_m": 0.01}, 0.0)])
def test_an_override_that_would_need_other_walls_than_drawn_is_refused(drawn, wanted):
    model = build(pendulum(), [effect("play", "clearance", ["pin"], radial_m=1e-3, **drawn)])
    assert model.overridden({"play": {"radial_m": 2e-3}})
    with pytest.raises(ValueError, match=f"'play': bearing_length_m {wanted} decides how the effect is built"):
        model.overridden({"play": {"bearing_length_m": wanted}})


def test_an_override_of_the_axis_about_which_a_link_was_cut_is_refused():
    model = build(pendulum(effects=[effect("bend", "link_flexibility", ["link"], stiffness_n_m_per_rad=5.0)]))
    with pytest.raises(ValueError, match=r"'bend': axis .* decides how the effect is built"):
        model.overridden({"bend": {"axis": (0.0, 1.0, 0.0)}})


def test_a_capsule_reaches_from_a_bars_first_joint_to_its_last():
    meet = effect("meet", "link_contact", ["a1", "b1"], radius_a_m=0.005, radius_b_m=0.004)
    plant = system(build(scissor(3), [meet]))
    for capsule, radius in ((plant.touches.first, 0.005), (plant.touches.second, 0.004)):
        # Bars of 0.2 m between their outer pins; points count from the centre of mass.
        np.testing.assert_allclose(np.abs(np.stack([capsule.start[0], capsule.end[0]])[:, 0]), 0.1, atol=1e-12)
        np.testing.assert_allclose(capsule.start, -capsule.end, atol=1e-12)
        assert float(capsule.radius[0]) == radius


def test_a_capsule_that_joints_cannot_tell_is_refused():
    meet = effect("meet", "link_contact", ["link", "ground"], radius_a_m=0.005, radius_b_m=0.004)
    with pytest.raises(ValueError, match="'meet': body 'link' has fewer than two joints"):
        build(pendulum(), [meet])


def test_one_number_of_several_has_an_address_of_its_own():
    offset = effect("lean", "center_of_mass_error", ["link"], offset_m=[0.01, 0.02, 0.0])
    model = build(pendulum(effects=[offset])).with_parameters({("lean", "offset_m[1]"): 0.05})
    assert model.parameters[("lean", "offset_m")].value == (0.01, 0.05, 0.0)
    row = model.parameters[("lean", "offset_m[1]")]
    assert row.value == 0.05
    assert row.expected == pytest.approx(row.declaration.expected * row.natural)


def test_a_camera_looks_at_the_middle_of_what_is_drawn_with_weight_down_the_picture():
    camera = build(pendulum(angle=0.0, length=0.2)).camera
    np.testing.assert_allclose(camera.center, [0.0, -0.1, 0.0], atol=1e-12)
    np.testing.assert_allclose(camera.down, [0.0, -1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(np.cross(camera.right, camera.down), camera.axis, atol=1e-12)
    assert float(camera.reach) == pytest.approx(0.2)


def test_an_error_of_a_spring_on_something_else_is_refused():
    grease = effect("grease", "viscous_friction", ["pin"], damping_n_m_s_per_rad=0.1)
    wrong = effect("soft", "spring_stiffness_error", ["grease"], relative=0.1)
    with pytest.raises(ValueError, match=r"cannot act on 'grease'.*extension_spring or torsion_spring"):
        build(pendulum(effects=[grease]), [wrong])


def test_a_spring_that_names_one_body_ends_in_the_axes_of_the_ground():
    given = {"anchor_a_m": [0.1, 0.0, 0.0], "anchor_b_m": [0.3, 0.0, 0.0], "stiffness_n_per_m": 10.0}
    drawn = document(pendulum(effects=[effect("s", "extension_spring", ["link"], **given)]))
    drawn["bodies"][0]["pose"]["position_m"] = [1.0, 2.0, 0.5]
    drawn["joints"][0]["frame_a"]["position_m"] = [-1.0, -2.0, -0.5]
    plant = system(model := build(parse_mechanism(drawn)))
    ((_, end),) = plant.topology.struts
    placed = kinematics.bodies(plant, drawn_pose(model, plant))
    at = placed.position[end] + placed.rotation[end] @ plant.strut_b[0]
    np.testing.assert_allclose(at, [1.3, 2.0, 0.5], atol=1e-12)
