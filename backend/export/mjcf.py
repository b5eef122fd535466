"""The twin as MJCF: MuJoCo's tree of bodies, its loops closed by stiff equalities.

E. Todorov, T. Erez, Y. Tassa, "MuJoCo: a physics engine for model-based control", IROS 2012.
Joint coordinates are the twin's own q.  Drives act by themselves at their drawn size; `ctrl` adds to it.
"""

from collections import Counter
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from backend.export.loops import Branch, Closing, Tree, spanning_tree
from backend.export.markup import Written, document, numbers, quaternion
from backend.export.pace import hasty, steady_step, stiffened
from backend.export.twin import Push, Twin, TwinBody, TwinJoint, physical

CONSTRAINT_STEPS = 4.0  # time in which an equality takes an error back, in steps; docs/twin.md has others
IMPEDANCE = "0.9999 0.9999 0.001 0.5 2"  # MuJoCo's largest; with its default loops open a thousand times more
STOP_DAMPING = 4.0  # over critical: at 1 a stop throws back 14% of the speed
WORLD = "world:axes"  # the site in whose frame forces along W are read
DRAWN = 1e-9  # rad or m: a smaller drawn coordinate is rounding
BONE = 0.015  # thickness of the sticks that stand for bodies, in sizes of the mechanism


def mjcf(twin: Twin, step_s: float | None = None, constraint_steps: float = CONSTRAINT_STEPS) -> Written:
    """An MJCF document that MuJoCo loads as it stands, and a sentence for what it does not hold.

    step_s: MuJoCo's time step [s]; by default 0.25 ms, shorter where springs or dampers ask for it.
    constraint_steps: time constant of equalities and stops, in steps.
    """
    twin, rigid = stiffened(twin)
    step_s = step_s or steady_step(twin)
    tree = spanning_tree(twin)
    left_out = [*twin.left_out, *_sentences(twin), *rigid, *hasty(twin, step_s)]
    root = Element("mujoco", model=twin.name)
    SubElement(root, "compiler", angle="radian", autolimits="true")
    SubElement(
        root, "option", timestep=numbers(step_s), gravity=numbers(twin.gravity), integrator="RK4", tolerance="1e-14",
        iterations="200",
    )  # fmt: skip
    SubElement(SubElement(root, "visual"), "headlight", ambient="0.5 0.5 0.5")
    _defaults(root, constraint_steps * step_s)
    world = SubElement(root, "worldbody")
    made = _grown(twin, tree, world)
    equality = Element("equality")
    for closing in tree.closings:
        _close(twin, tree, closing, made, equality)
    natives = {native.get("name") for native in world.iter("joint")}
    for joint in twin.joints:
        if joint.driven is not None and joint.id in natives:
            held = numbers([joint.driven - joint.q, 0, 0, 0, 0])  # MuJoCo counts from the drawn place
            SubElement(equality, "joint", name=f"{joint.id}:driven", joint1=joint.id, polycoef=held)
    for id_, body, point in twin.markers:
        SubElement(made[body], "site", name=id_, pos=numbers(point))
    if any(body.id == "world" for body in twin.bodies):
        left_out.append(f"body 'world' is called '{_body('world')}' here: MuJoCo keeps that name for its own")
    tendon, actuator = Element("tendon"), Element("actuator")
    _springs(twin, made, tendon)
    several = Counter(effort.id for effort in twin.efforts)
    for effort in twin.efforts:
        name = effort.id if several[effort.id] == 1 else f"{effort.id}@{effort.joint}"
        if effort.joint in natives:
            _drive(actuator, name, effort.size, joint=effort.joint)
        else:
            left_out.append(f"effect '{name}': joint '{effort.joint}' has no coordinate here that it could act along")
    if twin.pushes:
        SubElement(world, "site", name=WORLD)
    for push in twin.pushes:
        _push(twin, push, made, actuator)
    root.extend(part for part in (equality, tendon, actuator) if len(part))
    title = f"{twin.name}: SI units, angles in radians, z of joints as drawn, coordinates as linktwin's q."
    return Written(document(root, title, left_out), tuple(left_out))


def _defaults(root: Element, time_s: float) -> None:
    default = SubElement(root, "default")
    solref, stop = numbers([time_s, 1.0]), numbers([time_s, STOP_DAMPING])
    SubElement(default, "equality", solref=solref, solimp=IMPEDANCE)
    SubElement(
        default, "joint", solreflimit=stop, solimplimit=IMPEDANCE, solreffriction=solref, solimpfriction=IMPEDANCE
    )
    SubElement(default, "geom", contype="0", conaffinity="0", mass="0", rgba="0.6 0.65 0.7 1")


def _grown(twin: Twin, tree: Tree, world: Element) -> dict[str, Element]:
    """Every body as an element, on the world or on the body that carries it."""
    cuts = [closing.child for closing in tree.closings if closing.how == "halves"]
    made: dict[str, Element] = {}
    for body in twin.bodies:
        if body.fixed or body.id in tree.roots:
            made[body.id] = _placed(world, body.id, body.p_WB, body.R_WB)
        if body.id in tree.roots:
            SubElement(made[body.id], "freejoint", name=f"{body.id}:free")
    for branch in tree.branches:
        child = twin.body(branch.child)
        made[child.id] = _on(twin, made[branch.parent], branch, child.id)
        _natives(twin, made[child.id], branch)
    for body in twin.bodies:
        if not body.fixed:
            _weigh(made[body.id], body, 1.0 / (1 + cuts.count(body.id)))
        _bones(twin, body, made[body.id])
    return made


def _placed(parent: Element, name: str, p: np.ndarray, R: np.ndarray) -> Element:
    return SubElement(parent, "body", name=_body(name), pos=numbers(p), quat=numbers(quaternion(R)))


def _body(id: str) -> str:
    """A body's name: one that MuJoCo keeps for its own gets another."""
    return f"{id}:drawn" if id == "world" else id


def _on(twin: Twin, carrier: Element, branch: Branch | Closing, name: str) -> Element:
    parent, child = twin.body(branch.parent), twin.body(branch.child)
    p = parent.R_WB.T @ (child.p_WB - parent.p_WB)
    return _placed(carrier, name, p, parent.R_WB.T @ child.R_WB)


def _weigh(element: Element, body: TwinBody, share: float) -> None:
    J = share * physical(body.inertia)
    moments = [J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2]]
    inertial = Element(
        "inertial", pos=numbers(body.center), mass=numbers(share * body.mass), fullinertia=numbers(moments)
    )
    element.insert(0, inertial)


def _bones(twin: Twin, body: TwinBody, element: Element) -> None:
    """Sticks from a first joint to the others, the markers, or the centre of mass: to be seen and nothing else."""
    ends = [p for j in twin.joints for b, p in ((j.a, j.p_A), (j.b, j.p_B)) if b == body.id]
    ends += [p for _, b, p in twin.markers if b == body.id]
    if not body.fixed and len(ends) == 1:
        ends.append(body.center)
    for end in ends[1:]:
        if np.linalg.norm(end - ends[0]) > BONE * twin.size:
            size = numbers(0.5 * BONE * twin.size)
            SubElement(element, "geom", type="capsule", fromto=numbers([*ends[0], *end]), size=size)


def _natives(twin: Twin, element: Element, branch: Branch | Closing) -> None:
    """MuJoCo's own joints from the parent outwards; the one that carries q has the joint's name.

    MuJoCo turns the child against its parent: where the child is body_a, axes point the other way.
    """
    joint, child = branch.joint, twin.body(branch.child)
    (p_A, A), (p_B, B) = twin.frame_a(joint), twin.frame_b(joint)
    sign = 1.0 if branch.child == joint.b else -1.0
    x, y, z = (child.R_WB.T @ A).T * sign
    x_B = child.R_WB.T @ B[:, 0]
    offset = A.T @ (p_B - p_A)
    parts: list[tuple[str, str, np.ndarray, float]] = {
        "fixed": [],
        "revolute": [("", "hinge", z, joint.q)],
        "prismatic": [("", "slide", z, joint.q)],
        "cylindrical": [(":slide", "slide", z, offset[2]), ("", "hinge", z, joint.q)],
        "spherical": [("", "ball", z, 0.0)],
        "planar": [(":x", "slide", x, offset[0]), (":y", "slide", y, offset[1]), ("", "hinge", z, joint.q)],
        "universal": [(":about_y", "hinge", y, 0.0), (":about_x", "hinge", x_B, 0.0)],
    }[joint.type]
    where = numbers(child.R_WB.T @ (p_B - child.p_WB))
    for suffix, type_, axis, ref in parts if sign > 0 else parts[::-1]:
        given = {"name": joint.id + suffix, "type": type_, "pos": where}
        if type_ != "ball":
            given |= {"axis": numbers(axis), "ref": numbers(ref)}
        native = SubElement(element, "joint", given)
        if not suffix and type_ != "ball":
            _act(native, joint)


def _act(native: Element, joint: TwinJoint) -> None:
    """What acts along q."""
    sizes = {"damping": joint.damping, "frictionloss": joint.dry, "armature": joint.rotor}
    for name, size in sizes.items():
        if size:
            native.set(name, numbers(size))
    if joint.stiffness:
        native.set("stiffness", numbers(joint.stiffness))
        native.set("springref", numbers(joint.preload / joint.stiffness))
    if joint.stopped and joint.driven is None:
        # MuJoCo wants both ends; the open one is put where no linkage comes.
        ends = np.clip([joint.lower, joint.upper], -1e3, 1e3)
        native.set("range", numbers(ends))


def _close(twin: Twin, tree: Tree, closing: Closing, made: dict[str, Element], equality: Element) -> None:
    joint, parent, child = closing.joint, closing.parent, closing.child
    if closing.how in ("connect", "connect twice"):
        p_A, axis = joint.p_A, joint.R_AF[:, 2]
        points = [p_A] if closing.how == "connect" else [p_A, p_A + 0.25 * twin.size * axis]
        for n, point in enumerate(points):
            name = joint.id + (":axis" if n else "")
            ends = {"body1": _body(joint.a), "body2": _body(joint.b)}
            SubElement(equality, "connect", {"name": name, **ends, "anchor": numbers(point)})
        return
    other = child
    if closing.how == "halves":
        cuts = sum(c.how == "halves" and c.child == child for c in tree.closings)
        half = _on(twin, made[parent], closing, f"{child}:{joint.id}")
        _natives(twin, half, closing)
        _weigh(half, twin.body(child), 1.0 / (1 + cuts))
        other, parent = f"{child}:{joint.id}", child
    ends = {"body1": _body(parent), "body2": _body(other)}
    SubElement(equality, "weld", {"name": f"{joint.id}:weld", **ends, "torquescale": numbers(twin.size)})


def _springs(twin: Twin, made: dict[str, Element], tendon: Element) -> None:
    for spring in twin.springs:
        line = SubElement(
            tendon, "spatial", name=spring.id, stiffness=numbers(spring.stiffness), damping=numbers(spring.damping),
            springlength=numbers(spring.free),
        )  # fmt: skip
        for side, body, point in (("a", spring.a, spring.p_A), ("b", spring.b, spring.p_B)):
            SubElement(made[body], "site", name=f"{spring.id}:{side}", pos=numbers(point))
            SubElement(line, "site", site=f"{spring.id}:{side}")


def _drive(actuator: Element, name: str, size: float, **on: str) -> None:
    """ctrl adds to the drawn size: without any control the copy moves as the twin does."""
    SubElement(actuator, "general", {"name": name, "biastype": "affine", "biasprm": numbers([size, 0, 0]), **on})


def _push(twin: Twin, push: Push, made: dict[str, Element], actuator: Element) -> None:
    """A force along W's own axes: the world's site is the frame in which MuJoCo reads the gear."""
    p_W = twin.body(push.a).p_WB + twin.body(push.a).R_WB @ push.p_A
    for suffix, id_, sign in (("", push.a, 1.0), (":reaction", push.b, -1.0)):
        body = twin.body(id_)
        if body.fixed:
            continue
        point = body.R_WB.T @ (p_W - body.p_WB)
        site = f"{push.id}{suffix}:push"  # a marker may have the effect's name
        SubElement(made[id_], "site", name=site, pos=numbers(point))
        gear = np.concatenate([np.zeros(3), push.direction] if push.torque else [push.direction, np.zeros(3)])
        _drive(actuator, push.id + suffix, push.size, site=site, refsite=WORLD, gear=numbers(sign * gear))


def _sentences(twin: Twin) -> list[str]:
    """What MJCF alone does not hold, or holds otherwise."""
    said = [
        f"joint '{joint.id}': its prescribed motion is the equality '{joint.id}:driven', held at {joint.driven:g}; "
        f"another path{f', less {joint.q:g},' if abs(joint.q) > DRAWN else ''} is set through eq_data, as no ctrl "
        "reaches it"
        for joint in twin.joints
        if joint.driven is not None and not (twin.body(joint.a).fixed and twin.body(joint.b).fixed)
    ]
    said += [
        f"effect '{push.id}': its reaction on '{push.b}' follows a point of that body, not the point pushed"
        for push in twin.pushes
        if not push.torque and not twin.body(push.b).fixed
    ]
    return said
