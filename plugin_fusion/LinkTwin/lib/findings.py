"""What a person should know of an export: sentences that name the part and what to do about it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from .bodies import Body
from .linkage import Linkage

LIGHTEST, HEAVIEST = 10.0, 23_000.0  # kg/m³: the lightest foams; osmium is 22 590
DEFAULT_MATERIAL = "Steel"  # what Fusion gives a new body
SHOWN = 6


def drawing_warnings(snapshot: Mapping, structure: Linkage) -> list[str]:
    """Of bodies: hidden, without material or mass, of unlikely density, or not solid."""
    used = {occurrence["component"] for occurrence in structure.occurrences} | {snapshot["root"]["component"]}
    found, materials = [], []
    for id, component in snapshot["components"].items():
        if id not in used:
            continue
        for body in component["bodies"]:
            what = f'component "{component["name"]}", body "{body["name"]}"'
            if not body["visible"]:
                found.append(f"{what} is hidden and left out; show it if it is part of the mechanism")
            elif body.get("error"):
                found.append(f"{what}: its mass cannot be read ({body['error']}); it is left out: repair the body")
            elif not body["solid"]:
                found.append(f"{what} is a surface or a mesh without mass, and left out; thicken it or make it a solid")
            elif not (body.get("mass_kg") or 0.0) > 0.0:
                found.append(f"{what} has mass 0 and is left out; give it a physical material")
            else:
                materials.append(body.get("material") or "")
                density = 1e6 * body["mass_kg"] / body["volume_cm3"] if body.get("volume_cm3") else 0.0
                if not LIGHTEST <= density <= HEAVIEST:
                    found.append(
                        f"{what} weighs {density:.4g} kg/m³, outside {LIGHTEST:g} (foam) to {HEAVIEST:g} (beyond "
                        "osmium); correct the density of its material"
                    )
    if materials and set(materials) == {DEFAULT_MATERIAL}:
        found.append(
            f'all {len(materials)} bodies are of "{DEFAULT_MATERIAL}", Fusion\'s default; give them their materials '
            "(Modify > Physical Material), or their masses are those of steel"
        )
    return found


def structure_problems(parts: Sequence[Body], joints: Sequence[Mapping]) -> list[str]:
    """Why it is no mechanism."""
    if not parts:
        return ["the design has no component with a solid body that is shown; make each link a component"]
    if not any(body.fixed for body in parts):
        return [
            f"none of the {len(parts)} bodies is grounded; right-click the part that stands still and choose "
            "Ground to Parent or Pin"
        ]
    if all(body.fixed for body in parts):
        return ["everything is grounded or one rigid body, nothing moves; make each link a component and join them"]
    return []


def mass_problems(entries: Sequence[Mapping]) -> list[str]:
    """Bodies that move and weigh nothing."""
    return [
        f'body "{entry["id"]}" moves but has mass 0: none of its components carries a solid body that is shown and has '
        "a material; show or add one, or join something that has one"
        for entry in entries
        if not entry["fixed"] and "inertial" not in entry
    ]


def structure_warnings(parts: Sequence[Body], joints: Sequence[Mapping]) -> list[str]:
    """Of bodies that nothing holds: they fall."""
    held = {body.id for body in parts if body.fixed}
    while True:
        more = {
            body
            for joint in joints
            if (joint["body_a"] in held) != (joint["body_b"] in held)
            for body in (joint["body_a"], joint["body_b"])
        }
        if not more - held:
            break
        held |= more
    loose = [body.id for body in parts if body.id not in held]
    if not loose:
        return []
    rest = f" and {len(loose) - SHOWN} more" if len(loose) > SHOWN else ""
    named = ", ".join(f'"{id}"' for id in loose[:SHOWN]) + rest
    return [f"{named}: tied to nothing that stands still, and will fall freely; add a joint or a rigid group"]
