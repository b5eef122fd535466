"""A three-dimensional scissor of any number of cells, drawn by formula: no CAD kernel stands between cells."""

import math

from backend.mechanism.mechanism import Mechanism
from backend.mechanism.read import parse_mechanism

LENGTH_M, MASS_KG, WIDTH_M = 0.2, 0.05, 0.01
SQUARE = MASS_KG / 12
INERTIA = {
    "xx": 2 * WIDTH_M**2 * SQUARE,
    "yy": (LENGTH_M**2 + WIDTH_M**2) * SQUARE,
    "zz": (LENGTH_M**2 + WIDTH_M**2) * SQUARE,
}


def scissor(cells: int, angle_rad: float = 0.9, spring_n_per_m: float = 50.0, guided: bool = True) -> Mechanism:
    """Bars A and B per cell in the xy plane, pins along z, 3 (cells - 1) redundant rows and more at the guide.

    Bar A0 is pinned to the ground; guided: B0's end slides along y, which leaves one degree of freedom; otherwise the
    scissor also swings about the ground pin.  A spring across the first end opens it.
    """
    c, s = 0.5 * LENGTH_M * math.cos(angle_rad), 0.5 * LENGTH_M * math.sin(angle_rad)
    half = 0.5 * LENGTH_M
    bodies: list[dict] = [{"id": "ground", "fixed": True}]
    joints: list[dict] = []
    for i in range(cells):
        for bar, turn in ((f"a{i}", angle_rad), (f"b{i}", -angle_rad)):
            bodies.append(_body(bar, ((2 * i + 1) * c, 0.0, 0.0), turn, INERTIA))
    angle = {body["id"]: body.pop("turn", 0.0) for body in bodies}
    for i in range(cells):
        joints.append(_pin(f"mid{i}", angle, (f"a{i}", 0.0), (f"b{i}", 0.0)))
        if i < cells - 1:
            joints.append(_pin(f"top{i}", angle, (f"a{i}", half), (f"b{i + 1}", -half)))
            joints.append(_pin(f"low{i}", angle, (f"b{i}", half), (f"a{i + 1}", -half)))
    joints.append(_pin("start", angle, ("ground", (0.0, -s, 0.0)), ("a0", -half)))
    if guided:
        small = {"xx": 1e-6, "yy": 1e-6, "zz": 1e-6}
        bodies.append(_body("slider", (0.0, s, 0.0), 0.0, small, 0.01))
        bodies[-1].pop("turn")
        angle["slider"] = 0.0
        joints.append(_pin("guide_pin", angle, ("slider", 0.0), ("b0", -half)))
        along_y = [math.sqrt(0.5), -math.sqrt(0.5), 0.0, 0.0]
        joints.append(
            {
                "id": "guide",
                "type": "prismatic",
                "body_a": "ground",
                "body_b": "slider",
                "frame_a": {"position_m": [0.0, s, 0.0], "quaternion_wxyz": along_y},
                "frame_b": {"position_m": [0.0, 0.0, 0.0], "quaternion_wxyz": along_y},
            }
        )
    spring = {
        "id": "spring",
        "kind": "extension_spring",
        "on": ["a0", "b0"],
        "parameters": {
            "anchor_a_m": [-half, 0.0, 0.0],
            "anchor_b_m": [-half, 0.0, 0.0],
            "stiffness_n_per_m": spring_n_per_m,
            "free_length_m": 1.2 * s,
        },
    }
    return parse_mechanism(
        {
            "schema_version": "1.0",
            "name": f"scissor of {cells} cells",
            "gravity_m_per_s2": [0.0, 0.0, -9.80665],
            "bodies": bodies,
            "joints": joints,
            "effects": [spring],
            "markers": [{"id": f"m{i}", "body": f"a{i}", "position_m": [0.0, 0.0, 0.0]} for i in range(cells)],
        }
    )


def _about_z(angle: float) -> list[float]:
    return [math.cos(0.5 * angle), 0.0, 0.0, math.sin(0.5 * angle)]


def _body(id: str, position: tuple, turn: float, inertia: dict, mass: float = MASS_KG) -> dict:
    return {
        "id": id,
        "turn": turn,
        "pose": {"position_m": list(position), "quaternion_wxyz": _about_z(turn)},
        "inertial": {"mass_kg": mass, "center_of_mass_m": [0.0, 0.0, 0.0], "inertia_kg_m2": inertia},
    }


def _pin(id: str, angle: dict, a: tuple, b: tuple) -> dict:
    """A pin along z between points of two bodies, each given as x along the bar or as a whole point."""
    made = {"id": id, "type": "revolute", "body_a": a[0], "body_b": b[0]}
    for name, (body, place) in (("frame_a", a), ("frame_b", b)):
        point = [place, 0.0, 0.0] if isinstance(place, float) else list(place)
        made[name] = {"position_m": point, "quaternion_wxyz": _about_z(-angle[body])}
    made["fit"] = {"pin_diameter_m": 0.008}
    return made
