"""The twin as URDF, where it is a tree of joints that URDF knows.

A URDF link's frame is that of the joint it hangs on, so origins lie in the joints; axes stay those of the CAD part.
q = 0 of a URDF joint is q = 0 of the twin: where the twin starts is said in the preface.
"""

from typing import NamedTuple
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from backend.export.loops import Branch, Tree, spanning_tree
from backend.export.markup import Written, document, numbers
from backend.export.twin import Matrix, Twin, TwinJoint, Vector, physical

TYPES = {"revolute": "continuous", "prismatic": "prismatic", "fixed": "fixed"}
ROOT = "world"
WIDE = 1e3  # rad, m, N, N m, per second: URDF asks for bounds where the twin has none


class _Placed(NamedTuple):
    """A link's frame seen from its body: where its origin lies, in body axes."""

    p_BL: Vector


def urdf(twin: Twin) -> Written:
    """A URDF document, and a sentence for what it does not hold.

    Raises ValueError for loops, for joint types and for names that URDF lacks.
    """
    tree = spanning_tree(twin)
    _refuse(twin, tree)
    left_out = [*twin.left_out, *_sentences(twin)]
    robot = Element("robot", name=twin.name)
    SubElement(robot, "link", name=ROOT)
    links = {body.id: _Placed(np.zeros(3)) for body in twin.bodies}
    for branch in tree.branches:
        joint = branch.joint
        links[branch.child] = _Placed(joint.p_B if branch.child == joint.b else joint.p_A)
    for body in twin.bodies:
        link = SubElement(robot, "link", name=body.id)
        if not body.fixed:
            inertial = SubElement(link, "inertial")
            SubElement(inertial, "origin", xyz=numbers(body.center - links[body.id].p_BL), rpy="0 0 0")
            SubElement(inertial, "mass", value=numbers(body.mass))
            J = physical(body.inertia)
            moments = {
                f"i{a}{b}": numbers(J["xyz".index(a), "xyz".index(b)]) for a, b in ("xx", "xy", "xz", "yy", "yz", "zz")
            }
            SubElement(inertial, "inertia", moments)
        if body.fixed or body.id in tree.roots:
            type_ = "fixed" if body.fixed else "floating"
            _joint(robot, f"{ROOT}:{body.id}", type_, ROOT, body.id, body.p_WB, body.R_WB)
    for branch in tree.branches:
        _hang(robot, branch, links)
    starts = ", ".join(f"{j.id} {j.q:.6g}" for j in twin.joints if abs(j.q) > 1e-9)
    title = f"{twin.name}: SI units. It starts at rest at {starts or 'q = 0 of every joint'}."
    return Written(document(robot, title, left_out), tuple(left_out))


def _refuse(twin: Twin, tree: Tree) -> None:
    if tree.closings:
        joints = ", ".join(f"'{closing.joint.id}'" for closing in tree.closings[:4])
        more = f" and {len(tree.closings) - 4} more" if len(tree.closings) > 4 else ""
        raise ValueError(
            f"'{twin.name}' has {len(tree.closings)} closed loop{'s' if len(tree.closings) > 1 else ''} "
            f"(closed by joint {joints}{more}), and URDF holds trees only; write MJCF, which holds loops"
        )
    for joint in twin.joints:
        if joint.type not in TYPES:
            raise ValueError(
                f"joint '{joint.id}' is {joint.type}, and URDF has no such joint; write MJCF, or draw it as "
                f"{', '.join(TYPES)}"
            )
    if any(body.id == ROOT for body in twin.bodies):
        raise ValueError(f"body '{ROOT}' has the name of URDF's root link; rename it")


def _hang(robot: Element, branch: Branch, links: dict[str, _Placed]) -> None:
    joint, on_b = branch.joint, branch.child == branch.joint.b
    parent_frame, child_frame = ((joint.p_A, joint.R_AF), (joint.p_B, joint.R_BF))[:: 1 if on_b else -1]
    # With q = 0 both frames coincide: the child's axes in the parent's.
    R_PC = parent_frame[1] @ child_frame[1].T
    p = parent_frame[0] - links[branch.parent].p_BL
    type_ = TYPES[joint.type]
    if type_ == "continuous" and joint.stopped:
        type_ = "revolute"
    made = _joint(robot, joint.id, type_, branch.parent, branch.child, p, R_PC)
    if type_ == "fixed":
        return
    SubElement(made, "axis", xyz=numbers((1.0 if on_b else -1.0) * child_frame[1][:, 2]))
    SubElement(made, "dynamics", damping=numbers(joint.damping), friction=numbers(joint.dry))
    if type_ != "continuous":
        ends = np.clip([joint.lower, joint.upper], -WIDE, WIDE)
        SubElement(
            made, "limit", lower=numbers(ends[0]), upper=numbers(ends[1]), effort=numbers(WIDE), velocity=numbers(WIDE)
        )


def _joint(robot: Element, name: str, type_: str, parent: str, child: str, p: Vector, R: Matrix) -> Element:
    made = SubElement(robot, "joint", name=name, type=type_)
    SubElement(made, "parent", link=parent)
    SubElement(made, "child", link=child)
    SubElement(made, "origin", xyz=numbers(p), rpy=numbers(roll_pitch_yaw(R)))
    return made


def roll_pitch_yaw(R: Matrix) -> Vector:
    """Turns about fixed x, then y, then z [rad]; at a pitch of ±90 degrees, where two coincide, roll is 0."""
    pitch = np.arctan2(-R[2, 0], np.hypot(R[0, 0], R[1, 0]))
    if np.hypot(R[0, 0], R[1, 0]) < 1e-9:
        return np.array([0.0, pitch, np.arctan2(-R[0, 1], R[1, 1])])
    return np.array([np.arctan2(R[2, 1], R[2, 2]), pitch, np.arctan2(R[1, 0], R[0, 0])])


def _sentences(twin: Twin) -> list[str]:
    """What URDF alone does not hold."""
    g = " ".join(f"{x:g}" for x in twin.gravity)
    said = [f"gravity ({g} m/s²): URDF has none, set it in the simulator", *(_joint_sentences(twin.joints))]
    said += [f"effect '{spring.id}': URDF has no springs between bodies" for spring in twin.springs]
    said += [f"effect '{drive.id}': URDF has no drives" for drive in (*twin.efforts, *twin.pushes)]
    said += [f"marker '{id_}': URDF has no points on bodies" for id_, _, _ in twin.markers]
    return said


def _joint_sentences(joints: tuple[TwinJoint, ...]) -> list[str]:
    said = []
    for joint in joints:
        if joint.stiffness or joint.preload:
            said.append(f"joint '{joint.id}': URDF has no springs at joints")
        if joint.rotor:
            said.append(f"joint '{joint.id}': URDF has no rotor inertia")
        if joint.driven is not None:
            said.append(f"joint '{joint.id}': URDF has no prescribed motion, the joint is free")
    return said
