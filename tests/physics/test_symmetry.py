"""Where a drawing's axes and origins stand is a choice; the motion is not."""

import equinox as eqx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from backend.mechanism.read import parse_mechanism
from backend.model.build import build
from backend.model.system import system
from backend.simulate import points
from tests.mechanisms import Document, attitude, document, double_pendulum, effect, pose
from tests.motions import follow

STEP_S, STEPS = 1e-3, 200
SAME = 1e-8  # m, rad: each run stops its iterations at 1e-10, 200 steps long
angles = st.tuples(*[st.floats(-3.0, 3.0)] * 3)
offsets = st.tuples(*[st.floats(-0.3, 0.3)] * 3)
few = settings(max_examples=5, deadline=None)


@pytest.fixture(scope="module")
def drawn() -> Document:
    spring = effect(
        "spring",
        "extension_spring",
        ["upper", "lower"],
        anchor_a_m=[0.05, 0.02, 0.01],
        anchor_b_m=[0.1, 0.03, -0.01],
        stiffness_n_per_m=20.0,
        free_length_m=0.1,
    )
    push = effect("push", "applied_force", ["lower"], force_n=0.3, direction=[0.1, 1, 0], point_m=[0.15, 0, 0])
    return document(double_pendulum([spring, push, effect("f", "pin_friction", "all", friction_coefficient=0.2)]))


def motion(drawing: Document):
    """Joint coordinates and the path of the tip."""
    model = build(parse_mechanism(drawing))
    path = follow(model, STEP_S, STEPS).path
    return path.q, np.array(_markers(model, path))[:, 0]


_markers = eqx.filter_jit(lambda model, path: points.marker_paths(model, system(model), path))


@pytest.fixture(scope="module")
def answer(drawn):
    return motion(drawn)


@few
@given(angles, offsets)
def test_turning_the_whole_world_turns_the_answer(drawn, answer, turn, shift):
    R = Rotation.from_rotvec(turn)
    moved = parse_mechanism(drawn).model_dump(mode="json", exclude_none=True)
    moved["gravity_m_per_s2"] = R.apply(moved["gravity_m_per_s2"]).tolist()
    for body in moved["bodies"]:
        body["pose"] = pose(R.apply(body["pose"]["position_m"]) + shift, R * attitude(body["pose"]))
    (push,) = [e for e in moved["effects"] if e["id"] == "push"]
    push["parameters"]["direction"] = R.apply(push["parameters"]["direction"]).tolist()
    q, tip = motion(moved)
    np.testing.assert_allclose(q, answer[0], atol=10 * SAME)
    np.testing.assert_allclose(tip, R.apply(answer[1]) + shift, atol=SAME)


@few
@given(angles, offsets)
def test_a_bodys_cad_origin_and_axes_change_nothing(drawn, answer, turn, shift):
    R, p = Rotation.from_rotvec(turn), np.array(shift)  # of the new part frame in the old one

    def point(old):
        return R.inv().apply(np.subtract(old, p)).tolist()

    moved = parse_mechanism(drawn).model_dump(mode="json", exclude_none=True)
    (lower,) = [b for b in moved["bodies"] if b["id"] == "lower"]
    old = attitude(lower["pose"])
    lower["pose"] = pose(np.add(lower["pose"]["position_m"], old.apply(p)), old * R)
    inertial = lower["inertial"]
    inertial["center_of_mass_m"] = point(inertial["center_of_mass_m"])
    J = inertial["inertia_kg_m2"]
    tensor = np.array([[J["xx"], J["xy"], J["xz"]], [J["xy"], J["yy"], J["yz"]], [J["xz"], J["yz"], J["zz"]]])
    tensor = R.as_matrix().T @ tensor @ R.as_matrix()
    for name, (i, k) in {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}.items():
        J[name] = tensor[i, k]
    (elbow,) = [j for j in moved["joints"] if j["id"] == "elbow"]
    elbow["frame_b"] = pose(point(elbow["frame_b"]["position_m"]), R.inv() * attitude(elbow["frame_b"]))
    (tip_marker,) = moved["markers"]
    tip_marker["position_m"] = point(tip_marker["position_m"])
    parameters = {e["id"]: e["parameters"] for e in moved["effects"]}
    parameters["spring"]["anchor_b_m"] = point(parameters["spring"]["anchor_b_m"])
    parameters["push"]["point_m"] = point(parameters["push"]["point_m"])
    q, tip = motion(moved)
    np.testing.assert_allclose(q, answer[0], atol=10 * SAME)
    np.testing.assert_allclose(tip, answer[1], atol=SAME)
