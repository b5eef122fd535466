"""A mechanism with loops as a tree: which joints hang bodies on bodies, and what closes the rest.

A joint that closes a loop has no coordinate in a tree.  So joints at which something acts (friction, a spring, a stop,
a drive) go into the tree first, and where one of them still closes a loop, a body is cut in halves that are welded.
"""

from collections import deque
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from backend.export.twin import Twin, TwinJoint
from backend.mechanism.constraints import HELD

GROUND = ""  # no id is empty
RANK = 1e-7  # of the largest singular value: below, a row repeats others

How = Literal["connect", "connect twice", "weld", "halves"]


@dataclass(frozen=True)
class Branch:
    """A joint of the tree, from the body that carries it to the one that hangs on it."""

    joint: TwinJoint
    parent: str
    child: str


@dataclass(frozen=True)
class Closing:
    """A joint outside the tree.  How: points held together, bodies welded, or the child cut in halves at a weld."""

    joint: TwinJoint
    parent: str
    child: str
    how: How


@dataclass(frozen=True)
class Tree:
    """roots: floating bodies that nothing holds; branches, parents first; closings, one per loop."""

    roots: tuple[str, ...]
    branches: tuple[Branch, ...]
    closings: tuple[Closing, ...]


def spanning_tree(twin: Twin) -> Tree:
    """Hang every moving body on the ground, or on the first body of a group that floats."""
    fixed = {body.id for body in twin.bodies if body.fixed}
    driven = {effort.joint for effort in twin.efforts}
    binding = [j for j in twin.joints if not (j.a in fixed and j.b in fixed)]
    chosen = _chosen(binding, fixed, driven)
    roots, branches = _hung(twin, fixed, [j for j in binding if j.id in chosen])
    above = {branch.child: branch for branch in branches}
    closings = tuple(_closing(twin, j, fixed, driven, above) for j in binding if j.id not in chosen)
    return Tree(roots, branches, closings)


def _needs_coordinate(joint: TwinJoint, driven: set[str]) -> bool:
    return joint.laden or joint.id in driven or joint.type not in ("revolute", "spherical", "fixed")


def _chosen(joints: list[TwinJoint], fixed: set[str], driven: set[str]) -> set[str]:
    """Kruskal's tree: joints that need a coordinate first, each as near the ground as the drawing has it."""
    group: dict[str, str] = {}

    def end(body: str) -> str:
        body = GROUND if body in fixed else body
        while group.get(body, body) != body:
            body = group[body]
        return body

    near = _distances(joints, fixed)
    kept = set()
    for joint in sorted(joints, key=lambda j: (not _needs_coordinate(j, driven), near[j.id])):
        a, b = end(joint.a), end(joint.b)
        if a != b:
            group[max(a, b)] = min(a, b)
            kept.add(joint.id)
    return kept


def _distances(joints: list[TwinJoint], fixed: set[str]) -> dict[str, int]:
    """Joints by how many joints lie between them and the ground."""
    reached, near, rest = set(fixed), {}, list(joints)
    while rest:
        at = [j for j in rest if j.a in reached or j.b in reached] or rest[:1]
        for joint in at:
            near[joint.id] = len(near)
            reached |= {joint.a, joint.b}
        rest = [j for j in rest if j.id not in near]
    return near


def _hung(twin: Twin, fixed: set[str], joints: list[TwinJoint]) -> tuple[tuple[str, ...], tuple[Branch, ...]]:
    at: dict[str, list[TwinJoint]] = {body.id: [] for body in twin.bodies}
    for joint in joints:
        at[joint.a].append(joint)
        at[joint.b].append(joint)
    reached, roots, branches, used = set(fixed), [], [], set()
    for start in (*sorted(fixed), *(body.id for body in twin.bodies)):
        if start not in reached:
            roots.append(start)
            reached.add(start)
        queue = deque([start])
        while queue:
            parent = queue.popleft()
            for joint in at[parent]:
                child = joint.b if joint.a == parent else joint.a
                if joint.id not in used and child not in reached:
                    used.add(joint.id)
                    reached.add(child)
                    branches.append(Branch(joint, parent, child))
                    queue.append(child)
    return tuple(roots), tuple(branches)


def _closing(twin: Twin, joint: TwinJoint, fixed: set[str], driven: set[str], above: dict[str, Branch]) -> Closing:
    parent, child = (joint.b, joint.a) if joint.b in fixed else (joint.a, joint.b)
    how: How
    if _needs_coordinate(joint, driven):
        how = "halves"
    elif joint.type == "fixed":
        how = "weld"
    elif joint.type == "spherical" or _repeats(twin, joint, fixed, above):
        how = "connect"
    else:
        how = "connect twice"
    return Closing(joint, parent, child, how)


def _repeats(twin: Twin, joint: TwinJoint, fixed: set[str], above: dict[str, Branch]) -> bool:
    """Whether the loop that a pin closes keeps the pin's axis by itself, once one point of it is held."""
    path = set(_upwards(joint.a, above)) ^ set(_upwards(joint.b, above))
    chain = [above[child].joint for child in path]
    moving = sorted({b for j in (*chain, joint) for b in (j.a, j.b)} - fixed)
    held = [_rows(twin, j, j.type, moving) for j in chain]
    whole = np.concatenate([*held, _rows(twin, joint, "revolute", moving)])
    point = np.concatenate([*held, _rows(twin, joint, "spherical", moving)])
    return _rank(point) == _rank(whole)


def _upwards(body: str, above: dict[str, Branch]) -> list[str]:
    way = []
    while body in above:
        way.append(body)
        body = above[body].parent
    return way


def _rank(rows: Float[np.ndarray, "n m"]) -> int:
    values = np.linalg.svd(rows, compute_uv=False)
    return int(np.sum(values > RANK * values[0]))


def _rows(twin: Twin, joint: TwinJoint, type_: str, moving: list[str]) -> Float[np.ndarray, "rows columns"]:
    """Wrenches (force, moment about W's origin over the size) that a joint passes on to the twists of its bodies."""
    (p, A), (_, B) = twin.frame_a(joint), twin.frame_b(joint)
    shifts, turns = HELD[type_]
    p = (p - twin.frame_a(twin.joints[0])[0]) / twin.size  # from a point of the mechanism, which may lie far away
    square = np.cross(B[:, 0], A[:, 1])
    wrenches = [np.concatenate([A[:, k], np.cross(p, A[:, k])]) for k in shifts]
    wrenches += [np.concatenate([np.zeros(3), square if type_ == "universal" else A[:, k]]) for k in turns]
    rows = np.zeros((len(wrenches), 6 * len(moving)))
    for body, sign in ((joint.a, -1.0), (joint.b, 1.0)):
        if body in moving:
            at = 6 * moving.index(body)
            rows[:, at : at + 6] = sign * np.array(wrenches)
    return rows
