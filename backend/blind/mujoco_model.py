"""A drawing as MuJoCo's tree: native joints, loops closed by welds, loose pins on tendons, links as capsules."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from backend.blind.closure import roots, spanning_tree
from backend.blind.contacts import Capsules
from backend.blind.drawing import Drawing, DrawnJoint
from backend.blind.peer import peer
from backend.blind.poses import COORDINATE, Poses, joint_frame, joint_rows, quaternion, size_m

STOP_DAMPING = 4.0  # times critical: MuJoCo's stops give back 14% of the speed at 1
DEAD_BLOW = 2.0  # times critical: a wall gives back 5% of the speed
IMPEDANCE = 0.9999  # MuJoCo's largest; its default of 0.9 to 0.95 loses most of a loop's energy
SOLIMP = (IMPEDANCE, IMPEDANCE, 1e-3, 0.5, 2.0)


@dataclass(frozen=True)
class Wall:
    """What stands for a rigid wall: an oscillator of this rate [rad/s], whatever mass leans on it."""

    rate: float

    def solref(self, restitution: float) -> tuple[float, float]:
        """MuJoCo's stiffness and damping per mass, negative as it asks."""
        return -(self.rate**2), -2.0 * damping_ratio(restitution) * self.rate


def damping_ratio(restitution: float) -> float:
    """Damping over critical of a wall that pushes, never pulls, and returns `restitution` of the speed.

    Schwager and Pöschel (2007): e = exp(-ζ θ / √(1 - ζ²)), tan θ = 2 ζ √(1 - ζ²) / (2 ζ² - 1).
    """
    low, high = 0.0, 1.0 - 1e-9

    def returned(ratio: float) -> float:
        root = np.sqrt(1.0 - ratio**2)
        return float(np.exp(-ratio / root * np.arctan2(2.0 * ratio * root, 2.0 * ratio**2 - 1.0)))

    if restitution <= returned(high):
        return DEAD_BLOW
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if returned(middle) > restitution else (low, middle)
    return 0.5 * (low + high)


def mujoco_spec(drawing: Drawing, start: Poses, solref: tuple[float, float], wall: Wall, bare: bool) -> Any:
    """The mechanism as MuJoCo sees it, at its start pose; bare: without the struts."""
    mujoco = peer("mujoco")
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.compiler.balanceinertia = False
    spec.option.gravity = drawing.gravity
    spec.option.tolerance = 1e-14
    spec.option.iterations = 200
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    made: dict[int, Any] = {}
    for i, body in enumerate(drawing.bodies):
        if body.fixed:
            made[i] = _body(spec.worldbody, None, start, i, f"body:{i}")
    tree = spanning_tree(drawing)
    closing = _cuts(drawing, {k for k, _, _ in tree})
    shares = {i: 1.0 / (1 + sum(child == i for _, _, child in closing)) for i in drawing.moving}
    for i in roots(drawing):
        made[i] = _body(spec.worldbody, None, start, i, f"body:{i}")
        made[i].add_freejoint(name=f"free:{i}")
        _give_mass(made[i], drawing, i, shares[i])
    made |= _grow(drawing, start, made, tree, shares, solref)
    for k, parent, child in closing:
        half = _body(made[parent], parent, start, child, f"half:{k}:{child}")
        _give_mass(half, drawing, child, shares[child])
        _joint(half, drawing.joints[k], child, start, solref, k)
        _sites(drawing, made[parent], half, child, k)
        weld = spec.add_equality(type=mujoco.mjtEq.mjEQ_WELD, objtype=mujoco.mjtObj.mjOBJ_BODY)
        weld.name1, weld.name2 = f"body:{child}", f"half:{k}:{child}"
        # Zeros ask for the relative pose of the start; the eleventh number weighs an angle as a length.
        weld.data = np.where(np.arange(len(weld.data)) == 10, size_m(drawing), 0.0)
        weld.solref, weld.solimp = solref, (IMPEDANCE, IMPEDANCE, 1e-3, 0.5, 2.0)
    for n, strut in enumerate([] if bare else drawing.struts):
        tendon = spec.add_tendon(name=f"strut:{n}", stiffness=[strut.stiffness, 0, 0], damping=[strut.damping, 0, 0])
        tendon.springlength = [strut.free_length, strut.free_length]
        for end, i, p in (("a", strut.a, strut.p_A), ("b", strut.b, strut.p_B)):
            (made[i] if i >= 0 else spec.worldbody).add_site(name=f"strut:{n}{end}", pos=p)
            tendon.wrap_site(f"strut:{n}{end}")
    for k, joint in enumerate(drawing.joints):
        if joint.play:
            _play(spec, joint, k, wall)
    for n, pair in enumerate(drawing.capsules):
        _capsules(spec, made, pair, n, wall)
    return spec


def _grow(drawing: Drawing, start: Poses, made: dict, tree: list, shares: dict, solref: tuple) -> dict[int, Any]:
    """Bodies that hang, joint by joint, on those made so far."""
    grown = dict(made)
    for k, parent, child in tree:
        if parent in grown and child not in grown:
            grown[child] = _body(grown[parent], parent, start, child, f"body:{child}")
            _give_mass(grown[child], drawing, child, shares[child])
            _joint(grown[child], drawing.joints[k], child, start, solref, k)
            _sites(drawing, grown[parent], grown[child], child, k)
    return grown


def _cuts(drawing: Drawing, tree: set[int]) -> list[tuple[int, int, int]]:
    """Joints outside the tree: (joint, body that carries it, body that is cut in halves)."""
    cuts = []
    for k, joint in enumerate(drawing.joints):
        fixed_a, fixed_b = drawing.bodies[joint.a].fixed, drawing.bodies[joint.b].fixed
        if k not in tree and not (fixed_a and fixed_b):
            cuts.append((k, joint.b, joint.a) if fixed_b else (k, joint.a, joint.b))
    return cuts


def _body(parent: Any, parent_index: int | None, start: Poses, i: int, name: str) -> Any:
    p, R = start.p_WB[i], start.R_WB[i]
    if parent_index is not None:
        R_WP = start.R_WB[parent_index]
        p, R = R_WP.T @ (p - start.p_WB[parent_index]), R_WP.T @ R
    return parent.add_body(name=name, pos=p, quat=quaternion(R[None])[0])


def _give_mass(made: Any, drawing: Drawing, i: int, share: float) -> None:
    body = drawing.bodies[i]
    J = share * body.inertia
    made.explicitinertial = True
    made.mass, made.ipos = share * body.mass, body.p_BC
    made.fullinertia = [J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2]]


def _joint(made: Any, joint: DrawnJoint, child: int, start: Poses, solref: tuple, k: int) -> None:
    """Native joints from the parent outwards; the one that carries q is named joint:k."""
    mujoco = peer("mujoco")
    for n, (kind, p, axis, carries) in enumerate(_natives(joint, child, start)):
        native = made.add_joint(name=f"joint:{k}" if carries else f"joint:{k}:{n}", type=kind, pos=p, axis=axis)
        if not carries:
            continue
        q = float(joint_rows(joint, start)[COORDINATE[joint.type]])
        native.damping = [joint.damping, 0, 0]
        native.frictionloss = joint.friction
        native.armature = joint.inertia
        native.solref_friction = solref
        native.solref_limit = (solref[0], STOP_DAMPING)
        native.solimp_friction = native.solimp_limit = SOLIMP
        if joint.stiffness:
            native.stiffness = [joint.stiffness, 0, 0]
            native.springref = joint.preload / joint.stiffness - q
        if joint.lower > -np.inf or joint.upper < np.inf:
            native.limited = mujoco.mjtLimited.mjLIMITED_TRUE
            native.range = [max(joint.lower - q, -1e3), min(joint.upper - q, 1e3)]


def _natives(joint: DrawnJoint, child: int, start: Poses) -> Sequence[tuple[Any, np.ndarray, np.ndarray, bool]]:
    """(kind, point and axis in the child's frame at the start, whether its coordinate is q), parent side first.

    What is fixed in the parent comes first and what is fixed in the child last.  MuJoCo turns the child against its
    parent: a child that is body_a needs z the other way round.
    """
    Kind = peer("mujoco").mjtJoint
    hinge, slide = Kind.mjJNT_HINGE, Kind.mjJNT_SLIDE
    on_b = child == joint.b
    p_WB, R_WB = joint_frame(start, joint.b, joint.p_BF, joint.R_BF)
    _, R_WA = joint_frame(start, joint.a, joint.p_AF, joint.R_AF)
    R = start.R_WB[child].T
    p = R @ (p_WB - start.p_WB[child])  # the pin's centre, where frame_b stands
    z = (R @ R_WA[:, 2]) * (1.0 if on_b else -1.0)
    x_a, y_a, x_b = R @ R_WA[:, 0], R @ R_WA[:, 1], R @ R_WB[:, 0]
    if joint.play or joint.type == "planar":
        parts = [(slide, p, x_a, False), (slide, p, y_a, False), (hinge, p, z, True)]
    else:
        parts = {
            "fixed": [],
            "revolute": [(hinge, p, z, True)],
            "prismatic": [(slide, p, z, True)],
            "cylindrical": [(slide, p, z, False), (hinge, p, z, True)],
            "spherical": [(Kind.mjJNT_BALL, p, z, False)],
            "universal": [(hinge, p, y_a, False), (hinge, p, x_b, False)],
        }[joint.type]
    return parts if on_b else parts[::-1]


def _sites(drawing: Drawing, parent: Any, made: Any, child: int, k: int) -> None:
    """The middle of a loose pin and of its hole."""
    joint = drawing.joints[k]
    if joint.play:
        hole, pin = (parent, made) if child == joint.b else (made, parent)
        hole.add_site(name=f"hole:{k}", pos=joint.p_AF)
        pin.add_site(name=f"pin:{k}", pos=joint.p_BF)


def _play(spec: Any, joint: DrawnJoint, k: int, wall: Wall) -> None:
    """A tendon from the hole's middle to the pin's, no longer than the play; or a spring that starts there."""
    play, tendon = joint.play, spec.add_tendon(name=f"play:{k}")
    if play is None:
        return
    tendon.wrap_site(f"hole:{k}")
    tendon.wrap_site(f"pin:{k}")
    if np.isfinite(play.stiffness):
        tendon.stiffness = [play.stiffness, 0, 0]
        tendon.springlength = [0.0, play.radial]
    else:
        tendon.limited = peer("mujoco").mjtLimited.mjLIMITED_TRUE
        tendon.range = [-1.0, play.radial]
        tendon.solref_limit, tendon.solimp_limit = wall.solref(play.restitution), SOLIMP


def _capsules(spec: Any, made: dict[int, Any], pair: Capsules, n: int, wall: Wall) -> None:
    """Two capsules that see each other only."""
    mujoco = peer("mujoco")
    for side, i, ends, radius in (("a", pair.a, pair.ends_A, pair.radius_a), ("b", pair.b, pair.ends_B, pair.radius_b)):
        geom = made[i].add_geom(name=f"capsule:{n}{side}", type=mujoco.mjtGeom.mjGEOM_CAPSULE)
        geom.fromto, geom.size = [*ends[0], *ends[1]], [radius, 0, 0]
        geom.contype = geom.conaffinity = 0
        geom.mass = 0.0
    touch = spec.add_pair(geomname1=f"capsule:{n}a", geomname2=f"capsule:{n}b")
    touch.condim = 3 if pair.friction else 1
    touch.friction = [pair.friction, pair.friction, 0, 0, 0]
    touch.solref, touch.solimp = wall.solref(pair.restitution), SOLIMP
