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

    tree: dict[str, None] = {}
    closing: list[tuple[str, str, Joint]] = []
    floating: list[tuple[str, ...]] = []
    reached: dict[str, int] = {}
    used = set(idle)
    for root in neighbours:
        if root in reached:
            continue
        group, queue = [root], deque([root])
        reached[root] = len(reached)
        while queue:
            body = queue.popleft()
            for other, joint in neighbours[body]:
                if joint.id in used:
                    continue
                used.add(joint.id)
                if other in reached:
                    closing.append((body, other, joint))
                    continue
                reached[other] = len(reached)
                tree[joint.id] = None
                group.append(other)
                queue.append(other)
        if root != GROUND:
            floating.append(tuple(group))
    order = {joint.id: at for at, joint in enumerate(mechanism.joints)}
    walked, loops = set(tree), []
    for a, b, joint in closing:
        ring = [(b, joint), *_shortest(b, a, neighbours, walked)]
        loops.append(_loop(ring, fixed, reached, order))
        walked.add(joint.id)  # later loops may use it, so that they come out short; they stay independent
    return Connectivity(tuple(loops), tuple(tree), tuple(idle), tuple(floating))


def _shortest(
    start: str, goal: str, neighbours: dict[str, list[tuple[str, Joint]]], walked: set[str]
) -> list[tuple[str, Joint]]:
    """The steps (body reached, joint taken) from start to goal over the joints in `walked`."""
    came: dict[str, tuple[str, Joint]] = {}
    queue = deque([start])
    while goal not in came:
        body = queue.popleft()
        for other, joint in neighbours[body]:
            if joint.id in walked and other != start and other not in came:
                came[other] = (body, joint)
                queue.append(other)
    steps, body = [], goal
    while body != start:
        before, joint = came[body]
        steps.append((body, joint))
        body = before
    return steps[::-1]


def _loop(ring: list[tuple[str, Joint]], fixed: set[str], reached: dict[str, int], order: dict[str, int]) -> Loop:
    """The ring of (body reached, joint taken), from its innermost body, in the direction it was drawn."""
    first = min(range(len(ring)), key=lambda at: reached[ring[at][0]])
    bodies = [ring[(first + at) % len(ring)][0] for at in range(len(ring))]
    joints = [ring[(first + 1 + at) % len(ring)][1] for at in range(len(ring))]
    if order[joints[0].id] > order[joints[-1].id]:
        bodies[1:], joints = bodies[:0:-1], joints[::-1]
    if bodies[0] == GROUND:
        bodies[0] = next(body for body in (joints[0].body_a, joints[0].body_b) if body in fixed)
    return Loop(tuple(bodies), tuple(joint.id for joint in joints))
