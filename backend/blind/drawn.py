"""A mechanism.json as plain numbers, read without a word of our own dynamics."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from backend.blind.contacts import capsules, drawn_play, pads, play
from backend.blind.drawing import WORLD, Drag, Drawing, DrawnBody, DrawnJoint, Drive, Push, Strut
from backend.blind.poses import MET, rotation_matrix

AIR_DENSITY_KG_PER_M3 = 1.225  # ISO 2533 standard atmosphere, sea level: the file's drag areas assume it


def read_drawing(mechanism: Any, inputs: Any = None, *, engine: str, kinds: frozenset[str]) -> Drawing:
    """The mechanism (a backend.mechanism.Mechanism or its JSON document) with every number resolved.

    inputs: columns time_s, effect, parameter, value (a mapping or a table), each value held to the next.
    kinds: the effects that `engine` can imitate; ValueError names any other, and the place it stands at.
    """
    document = mechanism if isinstance(mechanism, Mapping) else mechanism.model_dump(mode="json")
    bodies = [_body(entry) for entry in document["bodies"]]
    index = {body.id: i for i, body in enumerate(bodies)}
    joints = [_joint(entry, index) for entry in document.get("joints", [])]
    drawing = Drawing(
        gravity=np.array(document.get("gravity_m_per_s2", (0.0, 0.0, -9.80665)), float),
        bodies=bodies,
        joints=joints,
        struts=[],
        pushes=[],
        drags=[],
        pads=[],
        capsules=[],
        markers=[(m["id"], index[m["body"]], np.array(m["position_m"], float)) for m in document.get("markers", [])],
    )
    held = _held_values(inputs)
    for effect in document.get("effects", []):
        if effect["kind"] not in kinds:
            raise ValueError(
                f'effect "{effect["id"]}": {engine} has no {effect["kind"]} here. Remove the effect, or use '
                f"one of {', '.join(sorted(kinds))}"
            )
        _add_effect(drawing, index, effect, held)
    for joint in joints:
        if joint.play and joint.rub_radius:
            raise ValueError(
                f'joint "{joint.id}" has both clearance and pin_friction; a loose pin rubs where it touches: '
                "give the clearance a friction_coefficient and remove the pin_friction"
            )
    if unknown := sorted({f"{effect}.{parameter}" for effect, parameter in held}):
        raise ValueError(
            f"inputs drive {', '.join(unknown)}, which no effect takes; drive force_n or torque_n_m "
            "of an applied_force, applied_torque or effort_offset of the mechanism"
        )
    return drawing


def _body(entry: Mapping[str, Any]) -> DrawnBody:
    pose, inertial = entry.get("pose") or {}, entry.get("inertial")
    fixed = bool(entry.get("fixed", False))
    if not inertial and not fixed:
        raise ValueError(f'body "{entry["id"]}" moves but has no mass; give it an inertial, or fix it')
    tensor = (inertial or {}).get("inertia_kg_m2", {})
    xx, yy, zz, xy, xz, yz = (float(tensor.get(key, 0.0)) for key in ("xx", "yy", "zz", "xy", "xz", "yz"))
    return DrawnBody(
        id=entry["id"],
        fixed=fixed,
        p_WB=np.array(pose.get("position_m", (0.0, 0.0, 0.0)), float),
        R_WB=rotation_matrix(np.array(pose.get("quaternion_wxyz", (1.0, 0.0, 0.0, 0.0)), float)),
        mass=float(inertial["mass_kg"]) if inertial else 0.0,
        p_BC=np.array(inertial["center_of_mass_m"] if inertial else (0.0, 0.0, 0.0), float),
        inertia=np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]),
    )


def _joint(entry: Mapping[str, Any], index: Mapping[str, int]) -> DrawnJoint:
    if entry["type"] not in MET:
        raise ValueError(f'joint "{entry["id"]}" is {entry["type"]}; the peers know {", ".join(MET)} joints')
    a, b, fit = entry["frame_a"], entry["frame_b"], entry.get("fit") or {}
    return DrawnJoint(
        id=entry["id"],
        type=entry["type"],
        a=index[entry["body_a"]],
        b=index[entry["body_b"]],
        p_AF=np.array(a["position_m"], float),
        R_AF=rotation_matrix(np.array(a["quaternion_wxyz"], float)),
        p_BF=np.array(b["position_m"], float),
        R_BF=rotation_matrix(np.array(b["quaternion_wxyz"], float)),
        pin_radius=0.5 * float(fit.get("pin_diameter_m") or 0.0),
        drawn_play=drawn_play(fit),
    )


def _held_values(inputs: Any) -> dict[tuple[str, str], tuple[list[float], list[float]]]:
    """The times and the values of each driven parameter, in order of time."""
    held: dict[tuple[str, str], tuple[list[float], list[float]]] = {}
    if inputs is None:
        return held
    rows = zip(inputs["time_s"], inputs["effect"], inputs["parameter"], inputs["value"], strict=True)
    for time_s, effect, parameter, value in sorted(rows, key=lambda row: float(row[0])):
        times, values = held.setdefault((str(effect), str(parameter)), ([], []))
        times.append(float(time_s))
        values.append(float(value))
    return held


def _drive(effect: Mapping[str, Any], parameter: str, held: dict) -> Drive:
    """The drawn value, until the first input of that name; from then on the latest input."""
    drawn = float(effect.get("parameters", {}).get(parameter, 0.0))
    times, values = held.pop((effect["id"], parameter), ([], []))
    steps = [drawn, *values]
    return lambda time_s: steps[bisect_right(times, time_s + 1e-12)]  # a step's time carries rounding


def _add_effect(drawing: Drawing, index: Mapping[str, int], effect: Mapping[str, Any], held: dict) -> None:
    kind, on, given = effect["kind"], effect["on"], effect.get("parameters", {})
    by_id = {joint.id: joint for joint in drawing.joints}
    if kind in ("linear_drag", "air_drag"):
        places = [drawing.bodies[i].id for i in drawing.moving] if on == "all" else on
        linear = float(given.get("n_s_per_m", 0.0))
        quadratic = 0.5 * AIR_DENSITY_KG_PER_M3 * float(given.get("drag_area_m2", 0.0))
        drawing.drags.extend(Drag(index[place], linear, quadratic) for place in places)
    elif kind == "surface_friction":
        places = [drawing.bodies[i].id for i in drawing.moving] if on == "all" else on
        drawing.pads.extend(pads(drawing, index[place], effect) for place in places)
    elif kind == "link_contact":
        drawing.capsules.append(capsules(effect, index))
    elif kind in ("extension_spring", "applied_force", "applied_torque"):
        a, b = [*(index[place] for place in on), WORLD][:2]
        if kind == "extension_spring":
            drawing.struts.append(_strut(a, b, given))
        else:
            drawing.pushes.append(_push(a, b, effect, held))
    else:
        drives: dict[str, Drive] = {}
        for joint in drawing.joints if on == "all" else [by_id[place] for place in on]:
            if joint.type == "revolute" or (joint.moves and kind not in REVOLUTE_ONLY):
                _add_to_joint(joint, effect, held, drives)


def _strut(a: int, b: int, given: Mapping[str, Any]) -> Strut:
    return Strut(
        a=a,
        b=b,
        p_A=np.array(given["anchor_a_m"], float),
        p_B=np.array(given["anchor_b_m"], float),
        stiffness=float(given.get("stiffness_n_per_m", 0.0)),
        free_length=float(given.get("free_length_m", 0.0)),
        damping=float(given.get("damping_n_s_per_m", 0.0)),
    )


def _push(a: int, b: int, effect: Mapping[str, Any], held: dict) -> Push:
    given, torque = effect.get("parameters", {}), effect["kind"] == "applied_torque"
    direction = np.array(given["axis" if torque else "direction"], float)
    size = _drive(effect, "torque_n_m" if torque else "force_n", held)
    p_A = np.array(given.get("point_m", (0.0, 0.0, 0.0)), float)
    return Push(a, b, p_A, direction / np.linalg.norm(direction), size, torque)


def _add_to_joint(joint: DrawnJoint, effect: Mapping[str, Any], held: dict, drives: dict[str, Drive]) -> None:
    given = effect.get("parameters", {})

    def number(turning: str, sliding: str | None = None) -> float:
        name = turning if joint.turns or sliding is None else sliding
        return float(given.get(name, 0.0))

    match effect["kind"]:
        case "viscous_friction":
            joint.damping += number("damping_n_m_s_per_rad", "damping_n_s_per_m")
        case "coulomb_friction":
            joint.friction += number("friction_torque_n_m", "friction_force_n")
        case "torsion_spring":
            joint.stiffness += number("stiffness_n_m_per_rad")
            joint.preload += number("stiffness_n_m_per_rad") * number("rest_rad")
        case "rotor_inertia":
            joint.inertia += number("kg_m2")
        case "pin_friction":
            joint.rub_radius += number("friction_coefficient") * joint.pin_radius
        case "clearance":
            joint.play = play(joint, effect)
        case "joint_stop":
            if more := sorted(set(given) - {"lower", "upper"}):
                told = f'effect "{effect["id"]}": stops are rigid here and keep nothing of a blow'
                raise ValueError(f"{told}; remove {', '.join(more)}")
            joint.lower = max(joint.lower, float(given.get("lower", -np.inf)))
            joint.upper = min(joint.upper, float(given.get("upper", np.inf)))
        case "effort_offset":
            name = "torque_n_m" if joint.turns else "force_n"
            joint.drives.append(drives.setdefault(name, _drive(effect, name, held)))


REVOLUTE_ONLY = ("torsion_spring", "rotor_inertia", "pin_friction", "clearance")
JOINT_KINDS: Sequence[str] = (
    "viscous_friction",
    "coulomb_friction",
    "pin_friction",
    "clearance",
    "torsion_spring",
    "joint_stop",
    "effort_offset",
)
BODY_KINDS: Sequence[str] = (
    "extension_spring",
    "applied_force",
    "applied_torque",
    "linear_drag",
    "air_drag",
    "surface_friction",
    "link_contact",
)
