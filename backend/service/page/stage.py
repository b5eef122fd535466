"""The mechanism in three dimensions: what was drawn, and a recorded motion played back by the browser."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import nicegui.elements.scene  # noqa: F401  three.js comes with it, under the import name nicegui-scene
import numpy as np
from nicegui.element import Element

from backend.mechanism.body import SURFACES, Body
from backend.mechanism.mechanism import Mechanism

BROWSER = Path(__file__).parent / "browser"
PARALLEL = 1e-6  # 1 - |cosine| of two axes that count as one direction

Drawn = dict[str, Any]


class StageView(Element, component="stage.js", esm={"linktwin-page": str(BROWSER)}):
    """A mechanism on stage.

    drawn: from `on_stage`. replay: address of a pictures.json, whose motions are fetched once and played by the
    browser. heat: `joint:ID`, `body:ID` or `marker:ID` -> how much it is to stand out, from 0 to 1. calm: one colour
    for all bodies. start_s: time at which the first motion is shown before it is played.
    """

    def __init__(
        self,
        drawn: Drawn,
        title: str,
        *,
        replay: str | None = None,
        heat: Mapping[str, float] | None = None,
        calm: bool = False,
        start_s: float | None = None,
    ) -> None:
        super().__init__()
        warm = dict(heat or {})
        given = {"drawn": drawn, "title": title, "replay": replay, "heat": warm, "calm": calm, "start_s": start_s}
        for name, value in given.items():
            if value is not None:
                self._props[name] = value


def on_stage(mechanism: Mechanism, mesh_address: Callable[[str], str | None]) -> Drawn:
    """What the browser needs of a drawing: bodies with their meshes, joints, markers, what must be in view.

    mesh_address: the mesh's uri in the drawing -> where the browser finds the file; None where there is none.
    meshes: each has a `url` that answers with STL, or a `fault`, a sentence; neither where the file did not come.
    points_m: in body axes, what a body without a mesh is drawn through. normal: of the plane of motion, in W; None for
    a spatial mechanism.
    """
    poses = {body.id: (np.array(body.pose.position_m), body.pose.rotation()) for body in mechanism.bodies}
    points: dict[str, list[tuple[float, ...]]] = {body.id: [] for body in mechanism.bodies}
    for joint in mechanism.joints:
        points[joint.body_a].append(tuple(joint.frame_a.position_m))
        points[joint.body_b].append(tuple(joint.frame_b.position_m))
    for marker in mechanism.markers:
        points[marker.body].append(tuple(marker.position_m))
    for body in mechanism.bodies:
        if len(points[body.id]) < 2 and body.inertial is not None and not body.fixed:
            points[body.id].append(tuple(body.inertial.center_of_mass_m))
    extent = [poses[id][0] + poses[id][1] @ np.array(p) for id, ps in points.items() for p in ps]
    extent = extent or [poses[body.id][0] for body in mechanism.bodies]
    return {
        "bodies": [
            {
                "id": body.id,
                "name": body.name or body.id,
                "fixed": body.fixed,
                "position_m": list(body.pose.position_m),
                "quaternion_wxyz": list(body.pose.quaternion_wxyz),
                "meshes": _meshes(body, mesh_address),
                "points_m": [list(p) for p in points[body.id]],
            }
            for body in mechanism.bodies
        ],
        "joints": [
            {"id": j.id, "type": j.type, "body_b": j.body_b, "frame_b": j.frame_b.model_dump(mode="json")}
            for j in mechanism.joints
        ],
        "markers": [{"id": m.id, "body": m.body, "position_m": list(m.position_m)} for m in mechanism.markers],
        "extent_m": [list(map(float, p)) for p in extent],
        "normal": plane_of_motion(mechanism),
    }


def _meshes(body: Body, mesh_address: Callable[[str], str | None]) -> list[dict[str, Any]]:
    return [
        {"uri": mesh.uri, "scale_to_m": mesh.scale_to_m, **_source(mesh.uri, mesh_address(mesh.uri))}
        for mesh in body.meshes
    ]


def _source(uri: str, address: str | None) -> dict[str, str]:
    if not uri.lower().endswith(SURFACES):
        return {"fault": f'"{uri}" is no mesh that is drawn here; export it as {", ".join(SURFACES)}.'}
    if address is None:
        return {}
    return {"url": address if uri.lower().endswith(".stl") else f"{address}?as=stl"}


def plane_of_motion(mechanism: Mechanism) -> list[float] | None:
    """Unit normal, in W, of the plane in which all joints move their bodies; None where there is no such plane."""
    turning, sliding = [], []
    for joint in mechanism.joints:
        axis = mechanism.body(joint.body_a).pose.rotation() @ joint.frame_a.rotation()[:, 2]
        if joint.type in ("revolute", "planar"):
            turning.append(axis)
        elif joint.type == "prismatic":
            sliding.append(axis)
        elif joint.type != "fixed":
            return None
    if not turning:
        return None
    normal = turning[0]
    flat = all(abs(axis @ normal) > 1 - PARALLEL for axis in turning)
    flat = flat and all(abs(axis @ normal) < PARALLEL**0.5 for axis in sliding)
    return [float(c) for c in normal] if flat else None
