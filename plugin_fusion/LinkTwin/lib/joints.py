"""One joint of mechanism.json from one joint of Fusion."""

from __future__ import annotations

from collections.abc import Mapping

from .anchors import BALL, CYLINDRICAL, PIN_SLOT, PLANAR, REVOLUTE, SLIDER, Anchor
from .placement import Placement, cross, frame_along, length, plus, product
from .placement import about_z as turn

HELD = {
    REVOLUTE: "revolute",
    SLIDER: "prismatic",
    CYLINDRICAL: "cylindrical",
    PIN_SLOT: "planar",
    PLANAR: "planar",
    BALL: "spherical",
}
TYPE_NAMES = ("rigid", "revolute", "slider", "cylindrical", "pin-slot", "planar", "ball", "inferred")
ALONG = 1e-6  # a slot along its own pin's axis leaves what a cylindrical joint leaves


def type_name(number: int) -> str:
    """What Fusion's menu calls a joint type."""
    return TYPE_NAMES[number] if 0 <= number < len(TYPE_NAMES) else f"type {number}"


def joint_entry(
    id: str,
    joint: Mapping,
    anchor: Anchor,
    bodies: tuple[str, str],
    places: tuple[Placement, Placement],
    warnings: list,
) -> dict:
    """The joint as mechanism.json writes it.

    bodies: ids of a and b; places: X_WA and X_WB. Part two of a Fusion joint is a, part one, which it moves, is b:
    q is then Fusion's own joint value, and its limits hold as they are.
    """
    type = HELD[joint["type"]]
    slides_along = joint["type"] == PIN_SLOT and anchor.slot and length(cross(anchor.axis, anchor.slot)) < ALONG
    if slides_along:
        type = "cylindrical"
    elif joint["type"] == PIN_SLOT:
        warnings.append(
            f'joint "{id}": a pin-slot joint is not in the format; it is written as a planar one, which also lets the '
            "pin slide across its slot: draw the sliding block as a component, with a revolute and a slider joint"
        )
    turned = float(joint.get("rotation_rad") or 0.0) if type in ("revolute", "cylindrical", "planar") else 0.0
    slid = float(joint.get("slide_cm") or 0.0) if type == "prismatic" else 0.0
    R_WF = frame_along(anchor.axis)
    at_a, at_b = (anchor.two, anchor.two) if anchor.met else (anchor.two, anchor.one)
    X_WF = Placement(R_WF, at_a)
    X_WG = Placement(product(R_WF, turn(turned)), plus(at_b, anchor.axis, slid))
    entry: dict = {
        "id": id,
        "type": type,
        "body_a": bodies[0],
        "body_b": bodies[1],
        "frame_a": (places[0].inverse() @ X_WF).json(),
        "frame_b": (places[1].inverse() @ X_WG).json(),
    }
    limits = _limits(id, joint, type, warnings)
    if limits:
        entry["limits"] = limits
    return entry


def _limits(id: str, joint: Mapping, type: str, warnings: list) -> dict:
    """The limits that the format holds, in rad or m; one side may be open."""
    kept: dict = {}
    for name, unit in (("rotation_limits", 1.0), ("slide_limits", 1e-2)):
        sides = {side: value for side, value in (joint.get(name) or {}).items() if value is not None}
        what = name.partition("_")[0]
        if not sides:
            continue
        if (type == "prismatic") != (name == "slide_limits") or type == "spherical":
            warnings.append(
                f'joint "{id}": its {what} limits ({_words(sides)}) have no place in a {type} joint and are left out; '
                "add a joint_stop effect where they matter"
            )
        elif sides.get("lower", float("-inf")) > sides.get("upper", float("inf")):
            warnings.append(f'joint "{id}": its {what} limits are crossed ({_words(sides)}) and left out; swap them')
        else:
            kept = {side: float(sides[side]) * unit for side in ("lower", "upper") if side in sides}
    for name in joint.get("other_limits") or ():
        warnings.append(f'joint "{id}": its {name} limits have no place in a {type} joint and are left out')
    return kept


def _words(sides: Mapping) -> str:
    return ", ".join(f"{side} {value:g}" for side, value in sides.items())
