"""Snapshots of Fusion designs, written by hand in Fusion's units: cm, kg, rad, kg cm².

Parts are boxes of aluminium, so that every number can be checked on paper.
"""

import copy
import itertools
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from tests.plugin_fusion.addin import room

ALUMINIUM = 2.7e-3  # kg/cm³
RIGID, REVOLUTE, SLIDER, CYLINDRICAL, PIN_SLOT, PLANAR, BALL, INFERRED = range(8)
Record = dict[str, Any]


def solid(low, high, name="Body1", density=ALUMINIUM, material="Aluminum 6061", **more) -> Record:
    """A box between two corners of its component's frame."""
    low, high = np.array(low, float), np.array(high, float)
    size, center = high - low, 0.5 * (low + high)
    mass = density * float(np.prod(size))
    about_center = (
        mass / 12 * np.diag([size[1] ** 2 + size[2] ** 2, size[0] ** 2 + size[2] ** 2, size[0] ** 2 + size[1] ** 2])
    )
    tensor = about_center + mass * (center @ center * np.eye(3) - np.outer(center, center))
    return {
        "name": name,
        "visible": True,
        "solid": True,
        "material": material,
        "mass_kg": mass,
        "volume_cm3": float(np.prod(size)),
        "center_cm": center.tolist(),
        "moments_kg_cm2": [tensor[0, 0], tensor[1, 1], tensor[2, 2], tensor[0, 1], tensor[1, 2], tensor[0, 2]],
        "box_cm": [low.tolist(), high.tolist()],
        "mesh": f"meshes/{name}.stl",
        **more,
    }  # fmt: skip


def component(name: str, *bodies: Record, **more) -> Record:
    """A component of its own bodies; their meshes get names that tell them apart."""
    named = [{**body, "mesh": body.get("mesh") and f"meshes/{name}-{body['name']}.stl"} for body in bodies]
    return {"name": name, "bodies": named, "cylinders": [], "markers": [], **more}


def bar(name: str, length: float, **more) -> Record:
    """A bar along x, 1.6 wide and 0.5 thick, its pins at 0 and `length`."""
    return component(name, solid((-0.8, -0.8, 0.0), (length + 0.8, 0.8, 0.5)), **more)


def rows(position=(0.0, 0.0, 0.0), turn=None) -> list[float]:
    """A Matrix3D as an array: sixteen numbers, row by row. turn: a scipy Rotation."""
    matrix = np.eye(4)
    matrix[:3, 3] = position
    if turn is not None:
        matrix[:3, :3] = turn.as_matrix()
    return matrix.ravel().tolist()


def about(axis: str, degrees: float) -> Rotation:
    """A turn about a coordinate axis."""
    return Rotation.from_euler(axis, degrees, degrees=True)


def occurrence(path: str, of: str | None = None, transform=None, **more) -> Record:
    """An occurrence; its component's id is by default its name without the number."""
    parent, _, name = path.rpartition("+")
    return {
        "path": path,
        "parent": parent,
        "component": of or name.rpartition(":")[0],
        "transform": transform or rows(),
        "pinned": False,
        "ground_to_parent": None,
        "suppressed": False,
        **more,
    }


def joint(
    name: str, type: int, one: str | None, two: str | None, origin=(0.0, 0.0, 0.0), axis=(0.0, 0.0, 1.0), **more
) -> Record:
    """A joint at a place of the world, both origins there."""
    directions = {
        "rotation_axis": list(axis) if type in (REVOLUTE, CYLINDRICAL, PIN_SLOT) else None,
        "slide_direction": list(axis) if type == SLIDER else None,
        "normal": list(axis) if type == PLANAR else None,
    }
    places = [{"origin_cm": list(origin), "vectors": []} for _ in range(2)]
    return {
        "name": name, "kind": "joint", "type": type, "context": "", "one": one, "two": two,
        "suppressed": False, "locked": False, "flipped": False, "message": "", "offset_cm": 0.0, "angle_rad": 0.0,
        "other_limits": [], "geometry_one": places[0], "geometry_two": places[1], **directions,
        "rotation_rad": 0.0, "slide_cm": 0.0, "rotation_limits": None, "slide_limits": None, **more,
    }  # fmt: skip


def as_built(name: str, type: int, one: str, two: str, origin=(0.0, 0.0, 0.0), **more) -> Record:
    """An as-built joint: one origin, and none where it is rigid."""
    place = None if type == RIGID else {"origin_cm": list(origin), "vectors": []}
    return joint(
        name, type, one, two, origin, **{"kind": "as_built", "geometry_one": None, "geometry_two": place, **more}
    )


def snapshot(components: dict[str, Record], occurrences: list[Record], joints: list[Record], **more) -> Record:
    """A design; its root component carries nothing unless told."""
    return {
        "snapshot_version": "1.0",
        "units": {"length": "cm", "mass": "kg", "angle": "rad"},
        "fusion_version": "2.0.20000",
        "document": {"name": "design v1", "saved": True},
        "up": "z",
        "root": {"component": "root"},
        "occurrences": occurrences,
        "components": {"root": component("root"), **components},
        "joints": joints,
        "rigid_groups": [],
        "unread": [],
        **more,
    }


def box_mesh(low, high) -> list[tuple[float, ...]]:
    """The twelve triangles of a box, outward."""
    corners = np.array(list(itertools.product(*zip(low, high, strict=True))))
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return [tuple(corners[list(t)].ravel()) for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]


def meshes(of: Record, unit_cm: float = 0.1, moved=None):
    """Reads the meshes of a snapshot's boxes. moved: a function on the triangles, such as out of their frame."""
    boxes = {
        body["mesh"]: body["box_cm"]
        for part in of["components"].values()
        for body in part["bodies"]
        if body.get("mesh")
    }

    def mesh_of(name: str):
        triangles = [tuple(entry / unit_cm for entry in t) for t in box_mesh(*boxes[name])]
        return triangles if moved is None else moved(triangles)

    return mesh_of


def export(of: Record, **reading):
    """What the add-in makes of a snapshot, through JSON as it does."""
    return room("lib.mechanism").export(copy.deepcopy(of), meshes(of, **reading))


def fourbar(**more) -> Record:
    """Ground 10, crank 4, coupler 9, rocker 7 cm in the plane of x and y, the crank at 65°; its pins by hand."""
    crank, coupler, rocker = 65.0, 22.022164322006617, 89.72315474382123
    B = (1.6904730469627978, 3.625231148146601)
    C = (10.033822897061698, 6.99991828606837)
    bars = {
        "Frame": bar("Frame", 10.0),
        "Crank": bar("Crank", 4.0),
        "Coupler": bar("Coupler", 9.0),
        "Rocker": bar("Rocker", 7.0),
    }
    return snapshot(
        bars,
        [
            occurrence("Frame:1", pinned=True),
            occurrence("Crank:1", transform=rows((0, 0, 0.55), about("z", crank))),
            occurrence("Coupler:1", transform=rows((*B, 1.1), about("z", coupler))),
            occurrence("Rocker:1", transform=rows((10, 0, 0.55), about("z", rocker))),
        ],
        [
            joint("A", REVOLUTE, "Crank:1", "Frame:1", (0, 0, 0.5)),
            joint("B", REVOLUTE, "Coupler:1", "Crank:1", (*B, 1.05)),
            joint("C", REVOLUTE, "Coupler:1", "Rocker:1", (*C, 1.05)),
            joint("D", REVOLUTE, "Rocker:1", "Frame:1", (10, 0, 0.5)),
        ],
        **more,
    )  # fmt: skip
