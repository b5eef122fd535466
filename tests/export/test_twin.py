"""What is handed to another simulator moves as the twin does, holds its loops, and says what it lacks."""

import json
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from backend.cli import app
from backend.export.fitted import fitted
from backend.export.gather import gather
from backend.export.loops import spanning_tree
from backend.export.markup import quaternion
from backend.export.mjcf import mjcf
from backend.export.twin import physical
from backend.export.urdf import roll_pitch_yaw, urdf
from backend.mechanism.fit_report import FitReport
from backend.mechanism.read import parse_mechanism, write_mechanism
from backend.model.build import build
from backend.model.state import Start, drawn_pose
from backend.model.system import system
from backend.simulate import points
from backend.simulate.rollout import rollout
from benchmarks.twin import apart, follow, follow_urdf
from tests.export.linkages import beside, turned_about
from tests.mechanisms import (
    bead_on_bar,
    bennett,
    body,
    document,
    double_pendulum,
    drawing,
    effect,
    fourbar,
    pendulum,
    scissor,
    slider_crank,
    spatial_fourbar,
)

DURATION_S, STEP_S = 0.15, 5e-4
GREASE = effect("grease", "viscous_friction", "all", damping_n_m_s_per_rad=1e-3)
SEALS = effect("seals", "coulomb_friction", "all", friction_torque_n_m=2e-3)


@pytest.fixture(scope="module")
def side_by_side():
    """Trees and loops with springs, drives, friction and joints drawn the other way round."""
    coil = effect("coil", "torsion_spring", ["elbow"], stiffness_n_m_per_rad=0.02, rest_rad=0.3)
    motor = effect("motor", "effort_offset", ["shoulder"], torque_n_m=0.05)
    rotor = effect("rotor", "rotor_inertia", ["shoulder"], kg_m2=1e-3)
    push = effect("push", "applied_force", ["block"], force_n=0.3, direction=[1, 0.2, 0], point_m=[0.0, 0.01, 0])
    twist = effect("twist", "applied_torque", ["rod", "crank"], torque_n_m=0.002, axis=[0, 0, 1])
    strut = effect(
        "strut", "extension_spring", ["bead", "ground"], anchor_a_m=[0, 0, 0], anchor_b_m=[0.1, 0.1, 0],
        stiffness_n_per_m=30.0, free_length_m=0.05, damping_n_s_per_m=0.1,
    )  # fmt: skip
    linkages = {
        "double": turned_about(double_pendulum([coil, motor, rotor]), "elbow"),
        "bare": fourbar(),
        "rubbing": turned_about(fourbar([GREASE, SEALS]), "j3"),
        "slider": slider_crank(effects=[push, twist]),
        "scissor": scissor(2, stiffness=2.0),
        "bead": turned_about(bead_on_bar([strut]), "rail"),
        "skew": spatial_fourbar(("universal", "spherical")),
        "bennett": bennett(),
    }
    mechanism = beside(linkages, gravity=(0.8, -9.7, 1.1))
    twin = gather(mechanism)
    return twin, moved(mechanism), follow(mjcf(twin).text, DURATION_S)


class Moved(NamedTuple):
    """Our motion: what `apart` compares, and q by joint."""

    step_s: float
    position_m: dict[str, np.ndarray]
    quaternion_wxyz: dict[str, np.ndarray]
    q: dict[str, np.ndarray]


@eqx.filter_jit
def _path(plant, begin, step_s):
    path = rollout(plant, begin, step_s, round(DURATION_S / STEP_S))
    return path, jax.vmap(lambda pose: points.origins(plant, pose))(path.pose)


def moved(mechanism) -> Moved:
    """The bare rollout: no redundancy is looked for and no reaction computed, a third of the program to compile."""
    model = build(mechanism)
    plant = eqx.filter_jit(system)(model)
    begin = Start(drawn_pose(model, plant), jnp.zeros((model.topology.slots, 6)))
    path, origins = jax.tree.map(np.asarray, _path(plant, begin, jnp.asarray(STEP_S)))
    assert not path.lost.any()
    slots = {body: i for i, body in enumerate(model.topology.body_ids) if body}
    turning = {joint: i for i, joint in enumerate(model.topology.joint_ids) if plant.coordinate[i] is not None}
    return Moved(
        STEP_S,
        {body: origins[:, i] for body, i in slots.items()},
        {body: path.pose.quaternion[:, i] for body, i in slots.items()},
        {joint: path.q[:, i] for joint, i in turning.items()},
    )


def test_the_copy_moves_as_the_twin_does(side_by_side):
    """What our step of 0.5 ms leaves, second order in the step; MuJoCo's own error is far below it."""
    _, run, copy = side_by_side
    far, turned = apart(run, copy)
    assert far.max() < 2e-5  # m; the linkages are 0.2 to 0.5 m long
    assert turned.max() < 1e-4


def test_coordinates_of_the_copy_are_q(side_by_side):
    """Also at joints whose child is body_a, and of slides."""
    _, run, copy = side_by_side
    nodes = np.round(copy.time_s / STEP_S).astype(int)
    shared = set(copy.q) & set(run.q)
    assert {"double.elbow", "rubbing.j3", "bead.rail", "slider.slide"} <= shared
    for joint in shared:
        assert np.ptp(run.q[joint]) > 0.01, joint  # it moves, so that agreement means something
        np.testing.assert_allclose(copy.q[joint], run.q[joint][nodes], atol=2e-4, err_msg=joint)


def test_loops_of_the_copy_stay_closed(side_by_side):
    """Nine loops for 0.3 s: a ten-thousandth of a pin's usual play."""
    assert 0.0 < side_by_side[2].open_m < 2e-7


def test_a_loop_is_closed_by_as_little_as_holds_it():
    """One point where the loop keeps the pin's axis itself; a cut body only where every pin has friction."""
    one = effect("one", "viscous_friction", ["j4"], damping_n_m_s_per_rad=1e-3)
    linkages = {
        "four-bar": (fourbar(), ["connect"]),
        "one laden pin": (fourbar([one]), ["connect"]),
        "laden pins": (fourbar([GREASE]), ["halves"]),
        "Bennett": (bennett(), ["connect"]),
        "scissor": (scissor(3), ["connect", "connect"]),
        "slider-crank": (slider_crank(), ["connect"]),
        "RSSR": (spatial_fourbar(), ["connect"]),
        "RURR": (spatial_fourbar(("universal", "revolute")), ["connect twice"]),
    }
    twin = gather(beside({name: linkage for name, (linkage, _) in linkages.items()}, (0, -9.81, 0)))
    found = {name: [] for name in linkages}
    for closing in spanning_tree(twin).closings:
        found[closing.joint.id.split(".")[0]].append(closing.how)
    assert found == {name: closed_by for name, (_, closed_by) in linkages.items()}


def test_a_stop_of_the_copy_holds():
    """A blow pushes MuJoCo's stop in for a step or two: 2 mrad at 5 rad/s and 0.25 ms."""
    stopped = pendulum(0.5, effects=[effect("stop", "joint_stop", ["pin"], lower=-0.6)])
    q = follow(mjcf(gather(stopped)).text, 0.5).q["pin"]
    assert -0.6 - 2e-3 < q.min() < -0.6 + 1e-3


def test_control_adds_to_a_drawn_drive():
    """Against its own size a drive is gone: the pendulum then swings as if none were drawn."""
    model, bare = (
        mujoco.MjModel.from_xml_string(mjcf(gather(pendulum(0.5, effects=drives))).text)
        for drives in ([effect("motor", "effort_offset", ["pin"], torque_n_m=0.05)], [])
    )
    data, free = mujoco.MjData(model), mujoco.MjData(bare)
    data.ctrl[:] = -0.05
    mujoco.mj_step(model, data, nstep=1000)
    mujoco.mj_step(bare, free, nstep=1000)
    np.testing.assert_allclose(data.qpos, free.qpos, atol=1e-12)


def test_a_prescribed_joint_of_the_copy_stays_where_it_is_held():
    held = pendulum(0.5, effects=[effect("hand", "prescribed_motion", ["pin"], q=0.0)])
    written = mjcf(gather(held))
    assert any("prescribed motion" in sentence for sentence in written.left_out)
    assert np.abs(follow(written.text, 0.5).q["pin"]).max() < 1e-6  # rad: the equality's give under the weight


def test_a_prescribed_joint_is_held_where_it_is_drawn():
    """MuJoCo counts what an equality holds from the drawn place."""
    parts = document(pendulum(0.5))
    turned = Rotation.from_euler("z", 0.7)
    frame = parts["joints"][0]["frame_b"]
    frame["quaternion_wxyz"] = quaternion(
        Rotation.from_quat(frame["quaternion_wxyz"], scalar_first=True).as_matrix() @ turned.as_matrix()
    ).tolist()
    parts["effects"] = [effect("hand", "prescribed_motion", ["pin"], q=0.7).model_dump(mode="json")]
    q = follow(mjcf(gather(parse_mechanism(parts))).text, 0.3).q["pin"]
    assert np.abs(q - 0.7).max() < 1e-6


def test_names_that_mujoco_keeps_or_that_stand_twice_are_told_apart():
    effects = [
        effect("motor", "effort_offset", ["j1", "j4"], torque_n_m=1e-3),
        effect("knee", "applied_force", ["coupler"], force_n=0.1, direction=[1, 0, 0], point_m=[0, 0, 0]),
    ]
    parts = document(fourbar(effects))
    parts["bodies"][0]["id"] = "world"
    for joint in parts["joints"]:
        for side in ("body_a", "body_b"):
            joint[side] = "world" if joint[side] == "ground" else joint[side]
    parts["markers"].append({"id": "world", "body": "world", "position_m": [0, 0, 0]})
    written = mjcf(gather(parse_mechanism(parts)))
    model = mujoco.MjModel.from_xml_string(written.text)
    names = {mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, i) for i in range(model.nu)}
    efforts = {name for name in names if name.startswith("motor")}
    told = [sentence for sentence in written.left_out if sentence.startswith("effect 'motor@")]
    assert len(efforts) + len(told) == 2  # a joint that closes the loop has no coordinate there
    assert "knee" in names
    assert any("'world:drawn'" in sentence for sentence in written.left_out)


def test_an_end_of_travel_that_gives_is_told_however_it_answers_a_blow():
    soft = effect("end", "joint_stop", ["pin"], lower=-0.6, stiffness_n_m_per_rad=50.0)
    assert any("'end'" in sentence for sentence in mjcf(gather(pendulum(0.5, effects=[soft]))).left_out)
    rigid = effect("end", "joint_stop", ["pin"], lower=-0.6)
    assert mjcf(gather(pendulum(0.5, effects=[rigid]))).left_out == ()


def test_a_tree_as_urdf_moves_as_it_does_as_mjcf():
    """MuJoCo reads both; URDF's angles are counted from q = 0, and MJCF starts where the twin is drawn.

    Dry friction's size is compared, not its motion: how hard it holds is MuJoCo's own setting, not URDF's.
    """
    drawn = document(
        beside(
            {
                "double": turned_about(double_pendulum([GREASE]), "elbow"),
                "bead": turned_about(bead_on_bar(), "rail"),
            },
            gravity=(0.8, -9.7, 1.1),
        )
    )
    shoulder = next(joint for joint in drawn["joints"] if joint["id"] == "double.shoulder")
    frame = Rotation.from_quat(shoulder["frame_a"]["quaternion_wxyz"], scalar_first=True)
    tilted = frame * Rotation.from_rotvec([0, 0, 0.7])  # drawn away from q = 0: a wrong zero would show
    shoulder["frame_a"]["quaternion_wxyz"] = [float(x) for x in tilted.as_quat(scalar_first=True)]
    tree = parse_mechanism(drawn)
    as_mjcf, as_urdf = follow(mjcf(gather(tree)).text, 0.3), follow_urdf(tree, 0.3)
    assert as_mjcf.q["double.shoulder"][0] == pytest.approx(-0.7, abs=1e-12)
    assert set(as_urdf.q) == set(as_mjcf.q)
    for joint, q in as_mjcf.q.items():
        assert np.ptp(q) > 0.01, joint
        np.testing.assert_allclose(as_urdf.q[joint], q, atol=1e-9, err_msg=joint)
    for name in ("double.lower", "bead.bead"):
        np.testing.assert_allclose(as_urdf.attitude[name], as_mjcf.attitude[name], atol=1e-9)
    rubbing = urdf(gather(pendulum(effects=[SEALS]))).text
    assert mujoco.MjModel.from_xml_string(rubbing).dof_frictionloss[0] == 2e-3


def test_urdf_refuses_loops_and_joints_it_lacks():
    with pytest.raises(ValueError, match=r"'fourbar' has 1 closed loop .*'j3'.* write MJCF"):
        urdf(gather(fourbar()))
    ball = drawing(
        "ball", [body("stone", (0, 0, 0), Rotation.identity(), 0.1, np.array([1e-4, 1e-4, 1e-4]))],
        [("socket", "spherical", "ground", "stone", (0.1, 0, 0), (0, 0, 1))],
    )  # fmt: skip
    with pytest.raises(ValueError, match=r"joint 'socket' is spherical, and URDF has no such joint"):
        urdf(gather(ball))


def test_what_a_file_does_not_hold_is_said_in_it_and_in_the_result():
    effects = [
        effect("play", "clearance", ["j1"], radial_m=1e-4),
        effect("rub", "pin_friction", ["j2"], friction_coefficient=0.1),
        effect("grip", "stribeck_friction", ["j3"], static_torque_n_m=0.02, friction_torque_n_m=0.01),
        effect("give", "coulomb_friction", ["j4"], friction_torque_n_m=0.01, presliding_rad=1e-3),
        effect("wind", "air_drag", ["coupler"], drag_area_m2=0.01),
        effect("no_wind", "air_drag", ["crank"], drag_area_m2=0.0),
        effect("bounce", "joint_stop", ["j4"], lower=-2.0, upper=2.0, restitution=0.5),
        effect("zoom", "camera_scale", ["camera"], relative=0.01),
    ]
    drawn = document(fourbar(effects))
    drawn["joints"][1]["limits"] = {"lower": -1.0, "upper": 1.0}
    written = mjcf(gather(parse_mechanism(drawn)))
    for words in ("play", "rub", "grip", "give", "wind", "bounce", "zoom", "joint 'j2': its drawn limits"):
        assert sum(f"'{words}'" in s or s.startswith(words) for s in written.left_out) == 1, words
    assert not any("no_wind" in sentence for sentence in written.left_out)
    assert all(sentence in written.text for sentence in written.left_out)
    assert mjcf(gather(fourbar([GREASE, SEALS]))).left_out == ()


def _found(name: str, value: float, unit: str = "1") -> dict:
    kind, rest = name.split(":")
    on, parameter = rest.rsplit(".", 1)
    return {"name": name, "kind": kind, "on": [on], "parameter": parameter, "value": value, "unit": unit}


def _fit(*parameters: dict) -> FitReport:
    return FitReport.model_validate({"parameters": parameters, "converged": True, "wall_s": 1.0})


def test_fitted_values_take_the_place_of_drawn_ones():
    drawn = pendulum(effects=[effect("grease", "viscous_friction", ["pin"], damping_n_m_s_per_rad=1.0)])
    report = _fit(
        _found("viscous_friction:pin.damping_n_m_s_per_rad", 0.01),
        _found("coulomb_friction:pin.friction_torque_n_m", 0.002),
        _found("mass_error:link.relative", 0.1),
    )
    model = mujoco.MjModel.from_xml_string(mjcf(gather(fitted(drawn, report))).text)
    assert model.dof_damping.ravel()[0] == 0.01
    assert model.dof_frictionloss[0] == 0.002
    np.testing.assert_allclose(model.body("link").mass, 0.11, rtol=1e-12)


def test_a_fit_of_another_drawing_is_refused():
    with pytest.raises(ValueError, match=r"fit\.json does not belong to 'pendulum': .*'knee'"):
        fitted(pendulum(), _fit(_found("viscous_friction:knee.damping_n_m_s_per_rad", 0.01)))


def test_a_link_too_stiff_to_bend_within_a_step_is_rigid_and_one_that_bends_has_a_hinge():
    stiff, soft = (
        mjcf(gather(pendulum(effects=[effect("bend", "link_flexibility", ["link"], stiffness_n_m_per_rad=k)])))
        for k in (1e9, 2.0)
    )
    assert "link:section" in stiff.left_out[0]
    assert mujoco.MjModel.from_xml_string(stiff.text).nv == 1
    assert mujoco.MjModel.from_xml_string(soft.text).nv == 2
    assert soft.left_out == ()


def test_a_flat_plate_has_an_inertia_that_mujoco_takes():
    flat = np.diag([1e-4, 2e-4, 3e-4 * (1 + 4e-7)])  # rounding broke the triangle inequality
    moments = np.linalg.eigvalsh(physical(flat))
    assert moments[2] < moments[0] + moments[1]
    np.testing.assert_allclose(physical(flat), flat, rtol=1e-6, atol=1e-12)


def test_attitudes_are_written_as_they_are():
    turns = Rotation.random(200, rng=np.random.default_rng(3)).as_matrix()
    for R in (*turns, *Rotation.from_euler("y", [[90], [-90]], degrees=True).as_matrix()):
        np.testing.assert_allclose(Rotation.from_quat(quaternion(R), scalar_first=True).as_matrix(), R, atol=1e-12)
        np.testing.assert_allclose(Rotation.from_euler("xyz", roll_pitch_yaw(R)).as_matrix(), R, atol=1e-12)


def test_the_command_writes_a_file_and_says_what_it_lacks(tmp_path):
    write_mechanism(fourbar([effect("play", "clearance", ["j1"], radial_m=1e-4)]), tmp_path / "mechanism.json")
    (tmp_path / "fit.json").write_text(_fit(_found("clearance:j1.radial_m", 2e-4, "m")).model_dump_json())
    asked = ["twin", str(tmp_path / "mechanism.json"), "--fit", str(tmp_path / "fit.json"), "--out", str(tmp_path)]
    done = CliRunner().invoke(app, [*asked, "--json"])
    assert done.exit_code == 0, done.output
    told = json.loads(done.stdout)
    assert "sits tight" in told["left_out"][0]
    assert mujoco.MjModel.from_xml_path(told["file"]).nbody == 5  # the world and four links
    refused = CliRunner().invoke(app, [*asked, "--format", "urdf"])
    assert refused.exit_code == 2
    assert "closed loop" in refused.stderr
