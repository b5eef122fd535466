"""A CadQuery drawing as Fusion would give it: in cm, moments about the component's origin, products last.

Moments about the origin are taken from OpenCASCADE by axes through it, so that they share nothing with the shift
that the add-in makes.
"""

import cadquery as cq
import numpy as np
from OCP.BRepAdaptor import BRepAdaptor_Surface
from OCP.BRepGProp import BRepGProp
from OCP.gp import gp_Ax1, gp_Dir, gp_Pnt
from OCP.GProp import GProp_GProps

from backend.mechanism.mechanism import Mechanism
from cad_export.drawing import Drawing
from tests.plugin_fusion import fakes

CM_PER_MM = 0.1


def fusion_properties(shape: cq.Shape, density_kg_per_m3: float) -> fakes.Fake:
    """PhysicalProperties of a shape about its own origin."""
    props = GProp_GProps(gp_Pnt(0, 0, 0))
    BRepGProp.VolumeProperties_s(shape.wrapped, props)
    per_mm3 = density_kg_per_m3 * 1e-9

    def about(*axis: float) -> float:
        moment = props.MomentOfInertia(gp_Ax1(gp_Pnt(0, 0, 0), gp_Dir(*axis)))
        return moment * per_mm3 * CM_PER_MM**2

    xx, yy, zz = about(1, 0, 0), about(0, 1, 0), about(0, 0, 1)
    # I(n) = n I n, so that a diagonal axis holds the product of its plane.
    products = (about(1, 1, 0) - (xx + yy) / 2, about(0, 1, 1) - (yy + zz) / 2, about(1, 0, 1) - (xx + zz) / 2)
    center = props.CentreOfMass()
    return fakes.properties(
        props.Mass() * per_mm3,
        props.Mass() * CM_PER_MM**3,
        np.array([center.X(), center.Y(), center.Z()]) * CM_PER_MM,
        (xx, yy, zz, *products),
    )


def fusion_body(name: str, shape: cq.Shape, density_kg_per_m3: float) -> fakes.Fake:
    """A BRepBody of a shape, with its cylindrical faces."""
    box = shape.BoundingBox()
    corners = np.array([[box.xmin, box.ymin, box.zmin], [box.xmax, box.ymax, box.zmax]]) * CM_PER_MM
    faces = [_face(face) for face in shape.Faces() if face.geomType() == "CYLINDER"]
    return fakes.body(name, fusion_properties(shape, density_kg_per_m3), corners, faces, shape=shape)


def fusion_design(drawing: Drawing, density_kg_per_m3: float, groups=()) -> fakes.Fake:
    """A Design of a drawing's parts and revolute joints; what the drawing grounds is pinned."""
    mechanism = drawing.mechanism()
    occurrences = {path: _occurrence(drawing, mechanism, path, density_kg_per_m3) for path in drawing.parts}
    joints = []
    for joint in mechanism.joints:
        if joint.type == "revolute":
            origin, axis = world_line(mechanism, joint.body_a, joint.frame_a)
            motion = fakes.revolute(axis)
            joints.append(
                fakes.joint(joint.id, motion, occurrences[joint.body_b], occurrences[joint.body_a], 100 * origin)
            )
    grouped = [
        fakes.Fake(
            name=f"Group{n}",
            isSuppressed=False,
            assemblyContext=None,
            occurrences=fakes.Things(*map(occurrences.get, group)),
        )
        for n, group in enumerate(groups, 1)
    ]
    return fakes.design(mechanism.name, occurrences.values(), joints, groups=grouped, write_mesh=write_stl)


def world_line(mechanism: Mechanism, body: str, frame) -> tuple[np.ndarray, np.ndarray]:
    """Origin [m] and axis of a joint's frame in the world."""
    pose = mechanism.body(body).pose
    return (
        np.array(pose.position_m) + pose.rotation() @ np.array(frame.position_m),
        pose.rotation() @ frame.rotation()[:, 2],
    )


def write_stl(body: fakes.Fake, path: str) -> None:
    """What Fusion's STL export writes: millimetres."""
    body.shape.exportStl(path, 0.01, 0.05, relative=False, parallel=False)


def _occurrence(drawing: Drawing, mechanism: Mechanism, path: str, density: float) -> fakes.Fake:
    part = drawing.parts[path]
    rows = np.eye(4)
    rows[:3, :3], rows[:3, 3] = part.X_WP.rotation, part.X_WP.position_mm * CM_PER_MM
    fixed = path in [body.id for body in mechanism.bodies if body.fixed]
    component = fakes.component(path, fusion_body("Body1", part.shape, density))
    return fakes.occurrence(f"{path}:1", component, rows.ravel(), isGrounded=fixed)


def _face(face: cq.Face) -> fakes.Fake:
    cylinder = BRepAdaptor_Surface(face.wrapped).Cylinder()
    axis, start = cylinder.Axis().Direction(), cylinder.Axis().Location()
    foot = face.positionAt(0.5, 0.5)
    normal = face.normalAt(foot)
    surface = fakes.Fake(
        surfaceType=1,
        origin=fakes.point(np.array([start.X(), start.Y(), start.Z()]) * CM_PER_MM),
        axis=fakes.point((axis.X(), axis.Y(), axis.Z())),
        radius=cylinder.Radius() * CM_PER_MM,
    )
    edges = [_edge(edge) for edge in face.Edges()]
    return fakes.Fake(
        geometry=surface,
        edges=fakes.Things(*edges),
        area=face.Area() * CM_PER_MM**2,
        pointOnFace=fakes.point(np.array(foot.toTuple()) * CM_PER_MM),
        evaluator=fakes.Fake(getNormalAtPoint=lambda _: (True, fakes.point(normal.toTuple()))),
    )


def _edge(edge: cq.Edge) -> fakes.Fake:
    if edge.geomType() == "CIRCLE":
        return fakes.Fake(
            geometry=fakes.Fake(curveType=2, center=fakes.point(np.array(edge.arcCenter().toTuple()) * CM_PER_MM))
        )
    ends = [
        fakes.Fake(geometry=fakes.point(np.array(p.toTuple()) * CM_PER_MM))
        for p in (edge.startPoint(), edge.endPoint())
    ]
    return fakes.Fake(geometry=fakes.Fake(curveType=0), startVertex=ends[0], endVertex=ends[1])
