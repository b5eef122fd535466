"""Who is joined to whom: bodies laid out in breadth-first levels from the ground.

Every joint (and every strut) then links bodies of one level or of neighbouring levels, so the step's linear
system is block tridiagonal over levels and costs O(bodies).  Levels are padded to one width.
"""

import dataclasses
from collections import deque
from functools import cached_property

import numpy as np


@dataclasses.dataclass(frozen=True)
class Topology:
    """Static layout of a mechanism; equal topologies share one compiled program.

    Moving bodies have slots 0..slots-1 (level x width, padded), fixed bodies follow.  `joints` and `struts`
    hold pairs of slots.
    """

    levels: int
    width: int
    body_ids: tuple[str | None, ...]
    fixed_ids: tuple[str, ...]
    joint_ids: tuple[str, ...]
    joint_types: tuple[str, ...]
    joints: tuple[tuple[int, int], ...]
    struts: tuple[tuple[int, int], ...]
    touches: tuple[tuple[int, int], ...]

    @property
    def slots(self) -> int:
        """Number of slots for moving bodies, empty ones included."""
        return self.levels * self.width

    def slot(self, body_id: str) -> int:
        """Where a body's numbers stand, fixed bodies after all moving ones."""
        return (self.body_ids + self.fixed_ids).index(body_id)

    @cached_property
    def links(self) -> np.ndarray:
        """(links, 2) slots: joints first, then struts, then links that may touch."""
        return np.array(self.joints + self.struts + self.touches, dtype=int).reshape(-1, 2)

    @cached_property
    def joint_sides(self) -> np.ndarray:
        """(slots, k) table: which joint sides (2 j + side) touch a body; 2 x joints where none does."""
        return self.sides_of(np.array(self.joints, dtype=int).reshape(-1, 2))

    @cached_property
    def strut_sides(self) -> np.ndarray:
        """The same for struts."""
        return self.sides_of(np.array(self.struts, dtype=int).reshape(-1, 2))

    def sides_of(self, pairs: np.ndarray) -> np.ndarray:
        """(slots, k) table of pair sides (2 i + side) by moving body, filled up with 2 x len(pairs)."""
        rows: list[list[int]] = [[] for _ in range(self.slots)]
        for i, pair in enumerate(pairs):
            for side, slot in enumerate(pair):
                if slot < self.slots:
                    rows[slot].append(2 * i + side)
        return _padded(rows, 2 * len(pairs))

    @cached_property
    def blocks(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Where the 6 x 6 blocks (4 link + 2 side_row + side_column) go: diagonal, upper, lower level blocks.

        Each table is (levels, width, width, k), filled up with 4 x links; the last upper and lower rows are empty.
        """
        places: tuple[dict[tuple[int, int, int], list[int]], ...] = ({}, {}, {})
        for link, pair in enumerate(self.links):
            for row_side, row in enumerate(pair):
                for column_side, column in enumerate(pair):
                    if max(row, column) >= self.slots:
                        continue
                    level_row, level_column = row // self.width, column // self.width
                    which = 0 if level_row == level_column else (1 if level_row < level_column else 2)
                    key = (min(level_row, level_column), row % self.width, column % self.width)
                    places[which].setdefault(key, []).append(4 * link + 2 * row_side + column_side)
        return tuple(self._block_table(p) for p in places)  # type: ignore[return-value]

    def _block_table(self, places: dict[tuple[int, int, int], list[int]]) -> np.ndarray:
        deepest = max([1, *(len(v) for v in places.values())])
        table = np.full((self.levels, self.width, self.width, deepest), 4 * len(self.links))
        for key, blocks in places.items():
            table[key][: len(blocks)] = blocks
        return table


def _padded(rows: list[list[int]], fill: int) -> np.ndarray:
    deepest = max([1, *(len(row) for row in rows)])
    return np.array([row + [fill] * (deepest - len(row)) for row in rows], dtype=int).reshape(-1, deepest)


def breadth_first(moving: list[str], fixed: list[str], pairs: list[tuple[str, str]]) -> dict[str, int]:
    """Level of each moving body: steps away from the ground; a free-flying group starts at its first body."""
    neighbours: dict[str, list[str]] = {body: [] for body in moving}
    queue: deque[str] = deque()
    level: dict[str, int] = {}
    for a, b in pairs:
        for one, other in ((a, b), (b, a)):
            if one in neighbours and other in neighbours:
                neighbours[one].append(other)
            elif one in neighbours and one not in level:
                level[one] = 0
                queue.append(one)
    for seed in [None, *moving]:
        if seed is not None and seed not in level:
            level[seed] = 0
            queue.append(seed)
        while queue:
            body = queue.popleft()
            for other in neighbours[body]:
                if other not in level:
                    level[other] = level[body] + 1
                    queue.append(other)
    return level


def lay_out(
    moving: list[str],
    fixed: list[str],
    joints: list[tuple[str, str, str, str]],
    struts: list[tuple[str, str]],
    touches: list[tuple[str, str]] | None = None,
) -> Topology:
    """Lay bodies out by level.  joints: (id, type, body_a, body_b); struts, touches: (body_a, body_b)."""
    touches = touches or []
    level = breadth_first(moving, fixed, [(a, b) for _, _, a, b in joints] + struts + touches)
    members: list[list[str]] = [[] for _ in range(max(level.values(), default=-1) + 1)]
    for body in moving:
        members[level[body]].append(body)
    width = max((len(m) for m in members), default=0)
    body_ids = tuple(b for m in members for b in [*m, *[None] * (width - len(m))])
    slot = {body: i for i, body in enumerate([*body_ids, *fixed]) if body is not None}
    return Topology(
        levels=len(members),
        width=width,
        body_ids=body_ids,
        fixed_ids=tuple(fixed),
        joint_ids=tuple(j[0] for j in joints),
        joint_types=tuple(j[1] for j in joints),
        joints=tuple((slot[a], slot[b]) for _, _, a, b in joints),
        struts=tuple((slot[a], slot[b]) for a, b in struts),
        touches=tuple((slot[a], slot[b]) for a, b in touches),
    )
