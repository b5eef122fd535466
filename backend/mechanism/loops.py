"""Which bodies hang together, and which joints close loops."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from backend.mechanism.joint import Joint
from backend.mechanism.mechanism import Mechanism


@dataclass(frozen=True)
class Loop:
    """A closed loop: `joints[i]` connects `bodies[i]` to the next body, and the last joint back to the first.

    All fixed bodies are one body here; it goes by the name of the first of them that the loop touches.
    """

    bodies: tuple[str, ...]
    joints: tuple[str, ...]


@dataclass(frozen=True)
class Connectivity:
    """Fundamental loops (one for each joint beyond a spanning tree) and what no joint ties to the ground.

    tree: joints of the spanning tree, in the order they were reached. idle: joints between two fixed bodies.
    floating: groups of connected moving bodies that no chain of joints ties to a fixed one.
    """

    loops: tuple[Loop, ...]
    tree: tuple[str, ...]
    idle: tuple[str, ...]
    floating: tuple[tuple[str, ...], ...]


GROUND = ""  # no id is empty


def connectivity(mechanism: Mechanism) -> Connectivity:
    """Walk the joints breadth first from the ground, then from every body not yet reached."""
    fixed = {body.id for body in mechanism.bodies if body.fixed}
    neighbours: dict[str, list[tuple[str, Joint]]] = {GROUND: []}
    neighbours |= {body.id: [] for body in mechanism.bodies if not body.fixed}
    idle = []
    for joint in mechanism.joints:
        a, b = (GROUND if body in fixed else body for body in (joint.body_a, joint.body_b))
        if a == b:
            idle.append(joint.id)
            continue
        neighbours[a].append((b, joint))
        neighbours[b].append((a, joint))

    parent: dict[str, tuple[str, Joint] | None] = {}
    tree: dict[str, None] = {}
    closing: dict[str, tuple[str, str, Joint]] = {}
    floating = []
    for root in neighbours:
        if root in parent:
            continue
        parent[root] = None
        reached, queue = [root], deque([root])
        while queue:
            body = queue.popleft()
            for other, joint in neighbours[body]:
                if joint.id in tree or joint.id in closing:
                    continue
                if other in parent:
                    closing[joint.id] = (body, other, joint)
                    continue
                parent[other] = (body, joint)
                tree[joint.id] = None
                reached.append(other)
                queue.append(other)
        if root != GROUND:
            floating.append(tuple(reached))
    order = {joint.id: at for at, joint in enumerate(mechanism.joints)}
    loops = tuple(_loop(a, b, joint, parent, fixed, order) for a, b, joint in closing.values())
    return Connectivity(loops, tuple(tree), tuple(idle), tuple(floating))


def _loop(
    a: str,
    b: str,
    closing: Joint,
    parent: dict[str, tuple[str, Joint] | None],
    fixed: set[str],
    order: dict[str, int],
) -> Loop:
    """Down the tree from the common ancestor to a, across the closing joint to b, and back up."""
    down, up = _ascent(a, parent), _ascent(b, parent)
    while down and up and down[-1][1] is up[-1][1]:  # the shared way to the root is no part of the loop
        down.pop()
        up.pop()
    ancestor = down[-1][0] if down else a
    start = parent[ancestor][0] if down and parent[ancestor] else ancestor  # type: ignore[index]
    bodies = [start, *(body for body, _ in reversed(down)), *(body for body, _ in up)]
    joints = [*(joint for _, joint in reversed(down)), closing, *(joint for _, joint in up)]
    if order[joints[0].id] > order[joints[-1].id]:  # told the way round in which it was drawn
        bodies[1:], joints = bodies[:0:-1], joints[::-1]
    if bodies[0] == GROUND:
        bodies[0] = next(body for body in (joints[0].body_a, joints[0].body_b) if body in fixed)
    return Loop(tuple(bodies), tuple(joint.id for joint in joints))


def _ascent(body: str, parent: dict[str, tuple[str, Joint] | None]) -> list[tuple[str, Joint]]:
    """The bodies from here up to below the root, each with the joint to its parent."""
    path = []
    while (step := parent[body]) is not None:
        path.append((body, step[1]))
        body = step[0]
    return path
