"""Drawings to ask questions of: a pendulum with every kind of part, and linkages of any shape."""

import math

import numpy as np
import pytest

X_AXIS = [math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0]  # turns z into x
INERTIA = {"xx": 2.25e-6, "yy": 4.545e-5, "zz": 4.68e-5, "xy": 0, "xz": 0, "yz": 0}


def frame(position=(0, 0, 0), quaternion=(1, 0, 0, 0)):
    return {"position_m": [float(x) for x in position], "quaternion_wxyz": [float(x) for x in quaternion]}


def body(id, pose=None, fixed=False):
    drawn = {"id": id, "fixed": fixed, "pose": pose or frame()}
    if not fixed:
        drawn["inertial"] = {
            "mass_kg": 0.054,
            "center_of_mass_m": [0.05, 0, 0],
            "inertia_kg_m2": dict(INERTIA),
        }
    return drawn


def joint(id, a, b, at_a=None, at_b=None, type="revolute"):
    return {
        "id": id,
        "type": type,
        "body_a": a,
        "body_b": b,
        "frame_a": at_a or frame(),
        "frame_b": at_b or frame(),
    }


def document(name, bodies, joints):
    return {"schema_version": "1.0", "name": name, "bodies": bodies, "joints": joints}


def pendulum():
    return {
        "schema_version": "1.0",
        "name": "pendulum",
        "gravity_m_per_s2": [0, 0, -9.80665],
        "provenance": {"tool": "CadQuery", "tool_version": "2.8.0", "warnings": []},
        "bodies": [
            body("ground", fixed=True),
            {**body("link1"), "meshes": [{"uri": "a.stl", "scale_to_m": 0.001}]},
        ],
        "joints": [
            {
                **joint("j1", "ground", "link1"),
                "limits": {"lower": -1.57, "upper": 1.57},
                "fit": {"pin_diameter_m": 0.008, "hole_diameter_m": 0.0081, "radial_clearance_m": 5e-5},
            }
        ],
        "effects": [
            {
                "id": "s1",
                "kind": "extension_spring",
                "on": ["link1", "ground"],
                "parameters": {
                    "anchor_a_m": [0.1, 0, 0],
                    "anchor_b_m": [0.1, 0, 0.2],
                    "stiffness_n_per_m": 2870,
                    "free_length_m": 0.05,
                },
            },
            {
                "id": "f1",
                "kind": "viscous_friction",
                "on": ["j1"],
                "parameters": {"damping_n_m_s_per_rad": 0.01},
            },
        ],
        "markers": [{"id": "tip", "body": "link1", "position_m": [0.095, 0.01, 0]}],
    }


def fourbar(ground=0.08, crank=0.02, coupler=0.07, rocker=0.05, angle=1.0, miss=0.0):
    """Pins A, B, C, D in the xy plane; where the lengths do not close, the coupler points along x.

    miss: distance by which the coupler's frame misses pin C [m].
    """
    B = crank * np.array([math.cos(angle), math.sin(angle)])
    D = np.array([ground, 0.0])
    reach = np.linalg.norm(D - B)
    along = (coupler**2 - rocker**2 + reach**2) / (2 * reach)
    height = math.sqrt(max(coupler**2 - along**2, 0.0))
    e = (D - B) / reach
    C = B + along * e + height * np.array([-e[1], e[0]])
    at_B, at_D = frame([*B, 0]), frame([*D, 0])
    to_C = (C - B) / np.linalg.norm(C - B)
    bodies = [
        body("ground", fixed=True),
        body("crank"),
        body("coupler", frame([*B, 0])),
        body("rocker", frame([*D, 0])),
    ]
    to_rocker = (C - D) / np.linalg.norm(C - D)
    joints = [
        joint("A", "ground", "crank"),
        joint("B", "crank", "coupler", at_B),
        joint("C", "coupler", "rocker", frame([*(coupler + miss) * to_C, 0]), frame([*rocker * to_rocker, 0])),
        joint("D", "ground", "rocker", at_D),
    ]
    return document("fourbar", bodies, joints)


def slider_crank(crank=0.05, rod=0.15, angle=0.7):
    """Crank and rod in the xy plane, slider along x."""
    B = crank * np.array([math.cos(angle), math.sin(angle)])
    x = B[0] + math.sqrt(rod**2 - B[1] ** 2)
    bodies = [body("ground", fixed=True), body("crank"), body("rod"), body("slider", frame([x, 0, 0]))]
    joints = [
        joint("A", "ground", "crank"),
        joint("B", "crank", "rod", frame([*B, 0]), frame([*B, 0])),
        joint("C", "rod", "slider", frame([x, 0, 0])),
        joint("S", "ground", "slider", frame((0, 0, 0), X_AXIS), frame((0, 0, 0), X_AXIS), "prismatic"),
    ]
    return document("slider_crank", bodies, joints)


def scissor(cells, half=0.05, angle=0.6):
    """Crossed bars in the xy plane, opening along x; the first bar is held."""
    dx, dy = half * math.cos(angle), half * math.sin(angle)
    bodies, joints = [], []
    for cell in range(cells):
        centre = frame([2 * cell * dx, 0, 0])
        bodies += [body(f"up{cell}", centre, fixed=cell == 0), body(f"down{cell}", centre)]
        joints.append(joint(f"m{cell}", f"up{cell}", f"down{cell}"))
        if cell:
            low, high = frame([-dx, -dy, 0]), frame([-dx, dy, 0])
            joints.append(joint(f"t{cell}", f"up{cell - 1}", f"down{cell}", frame([dx, dy, 0]), high))
            joints.append(joint(f"b{cell}", f"down{cell - 1}", f"up{cell}", frame([dx, -dy, 0]), low))
    return document(f"scissor{cells}", bodies, joints)


def bennett(a=0.1, alpha=0.6, b=0.15, theta=1.1):
    """Bennett (1903): opposite links equal, length over sine of the twist the same for all four.

    Denavit-Hartenberg: Rz(theta) Tx(length) Rx(twist) once around is the identity.
    """
    beta = math.asin(b * math.sin(alpha) / a)
    other = 2 * math.atan(math.sin((beta + alpha) / 2) / math.sin((beta - alpha) / 2) / math.tan(theta / 2))
    R, p = np.eye(3), np.zeros(3)
    frames = []
    for turn, length, twist in zip(
        (theta, other, -theta, -other), (a, b, a, b), (alpha, beta, alpha, beta), strict=True
    ):
        frames.append(frame(p, quaternion(R)))  # its z is the joint before the link
        c, s = math.cos(turn), math.sin(turn)
        R = R @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        p = p + R @ [length, 0, 0]
        c, s = math.cos(twist), math.sin(twist)
        R = R @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    names = ["ground", "link1", "link2", "link3"]
    bodies = [body(name, fixed=name == "ground") for name in names]
    joints = [joint(f"j{at + 1}", names[at - 1], names[at], frames[at], frames[at]) for at in range(4)]
    return document("bennett", bodies, joints)


def quaternion(R):
    """Of a rotation by less than half a turn."""
    w = 0.5 * math.sqrt(1 + np.trace(R))
    return [w, (R[2, 1] - R[1, 2]) / (4 * w), (R[0, 2] - R[2, 0]) / (4 * w), (R[1, 0] - R[0, 1]) / (4 * w)]


class Drawings:
    """Hand-written drawings as documents, ready to be spoiled."""

    body, joint, frame, document = (
        staticmethod(body),
        staticmethod(joint),
        staticmethod(frame),
        staticmethod(document),
    )
    pendulum, fourbar, slider_crank = (
        staticmethod(pendulum),
        staticmethod(fourbar),
        staticmethod(slider_crank),
    )
    scissor, bennett = staticmethod(scissor), staticmethod(bennett)


@pytest.fixture(scope="session")
def drawings():
    return Drawings
