"""The facts of a drawing's graph: loops, mobility, redundancy, closure, and what is wrong with it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from backend.mechanism.closure import (
    CLOSED_M,
    CLOSED_RAD,
    OPEN_RAD,
    OPEN_SHARE,
    Assembly,
    assemble,
    gaps,
    too_long,
)
from backend.mechanism.constraints import JointGap, drawn, size_m
from backend.mechanism.drawing_error import DrawingError
from backend.mechanism.findings import part_findings
from backend.mechanism.found_contacts import FoundContacts, found_contacts
from backend.mechanism.joint import WITHOUT_COORDINATE, Joint
from backend.mechanism.loops import Connectivity, connectivity
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.mobility import (
    count_in_plane,
    count_in_space,
    joint_axes,
    plane_normal,
    rank_at,
    redundant_by_joint,
)
from backend.mechanism.part import Part
from backend.mechanism.turns import begins_near, nearest

ALONG = 0.999  # cosine of the angle between gravity and an axis up to which it moves nothing about that


class LoopReport(Part):
    """`joints[i]` connects `bodies[i]` to the next body, the last one back to the first."""

    bodies: tuple[str, ...]
    joints: tuple[str, ...]


class Closure(Part):
    """How far a joint's two frames are apart as drawn, in the directions that its type holds.

    q: where the joint stands as drawn [rad, or m for `prismatic`]; null for types without a coordinate.
    """

    joint: str
    gap_mm: float
    turn_deg: float
    q: float | None


class MobilityReport(Part):
    """Freedoms by count in space (Kutzbach), in the plane (Grübler; null when not planar), and by rank.

    pose: where the rank was taken: as drawn, or as assembled. spectrum_gap: singular value kept over singular
    value dropped at the cut (null when none was dropped or the dropped one is exactly zero).
    """

    by_count_in_space: int
    by_count_in_plane: int | None
    by_rank: int
    rank: int
    rows: int
    redundant_rows: int
    redundant_by_joint: dict[str, int]
    pose: Literal["drawn", "assembled"]
    threshold: float
    spectrum_gap: float | None


class GraphReport(Part):
    """What `linktwin check` tells about a drawing that could be read.

    gravity_idle: gravity lies along the axes of all joints, as for what lies on a table: nothing falls.
    """

    name: str
    moving_bodies: int
    fixed_bodies: int
    joints: dict[str, int]
    effects: int
    markers: int
    size_mm: float
    loops: tuple[LoopReport, ...]
    mobility: MobilityReport
    closure: tuple[Closure, ...]
    closes: bool
    floating: tuple[tuple[str, ...], ...]
    contacts: tuple[FoundContacts, ...] = ()
    gravity_idle: bool = False
    errors: Annotated[tuple[str, ...], Field(description="the mechanism cannot be built as drawn")] = ()
    warnings: tuple[str, ...] = ()

    @property
    def ok(self) -> bool:
        """Whether the drawing can be assembled and simulated."""
        return not self.errors

    def with_errors(self, found: Sequence[str]) -> GraphReport:
        """The same report with further errors, each told once."""
        return self.model_copy(update={"errors": tuple(dict.fromkeys([*self.errors, *found]))})


def describe(mechanism: Mechanism) -> GraphReport:
    """Loops, mobility by count and by rank, redundant rows, closure error, and what stands out."""
    graph = connectivity(mechanism)
    length = size_m(mechanism)
    joints = _tree_first(mechanism, graph)
    at_drawing = drawn(mechanism)
    opened = gaps(mechanism, at_drawing)
    q = _begins(mechanism, opened)
    assembly = assemble(mechanism, joints, length)
    moved = assembly.closed and not _all_closed(opened)
    placement = assembly.placement if assembly.closed else at_drawing
    normal = plane_normal(joints, joint_axes(mechanism, joints, placement))
    rank = rank_at(mechanism, joints, placement, length)
    errors, warnings = _closure_findings(mechanism, graph, opened, assembly, normal, length)
    warnings += _graph_findings(mechanism, graph) + part_findings(mechanism, q, length)
    contacts: tuple[FoundContacts, ...] = ()
    try:
        contacts = found_contacts(mechanism)
    except DrawingError as error:
        errors += error.problems
    warnings += [sentence for found in contacts for sentence in _contact_findings(found)]
    if mechanism.provenance is not None:
        warnings += [f"the exporter says: {text}" for text in mechanism.provenance.warnings]
    return GraphReport(
        name=mechanism.name,
        moving_bodies=len(mechanism.moving_bodies()),
        fixed_bodies=len(mechanism.bodies) - len(mechanism.moving_bodies()),
        joints=dict(Counter(joint.type for joint in mechanism.joints)),
        effects=len(mechanism.effects),
        markers=len(mechanism.markers),
        size_mm=1e3 * length,
        loops=tuple(LoopReport(bodies=loop.bodies, joints=loop.joints) for loop in graph.loops),
        mobility=MobilityReport(
            by_count_in_space=count_in_space(mechanism, joints),
            by_count_in_plane=None if normal is None else count_in_plane(mechanism, joints),
            by_rank=rank.mobility,
            rank=rank.rank,
            rows=rank.rows,
            redundant_rows=rank.redundant,
            redundant_by_joint=redundant_by_joint(mechanism, joints, placement, length, rank),
            pose="assembled" if moved else "drawn",
            threshold=rank.threshold,
            spectrum_gap=rank.gap if np.isfinite(rank.gap) else None,
        ),
        closure=tuple(_closure(joint, opened[joint.id], q.get(joint.id)) for joint in mechanism.joints),
        closes=assembly.closed,
        floating=graph.floating,
        contacts=contacts,
        gravity_idle=_is_along(mechanism.gravity_m_per_s2, normal) and "revolute" in {j.type for j in joints},
        errors=tuple(errors),
        warnings=tuple(warnings),
    )


def _tree_first(mechanism: Mechanism, graph: Connectivity) -> list[Joint]:
    """The joints that bind something, the spanning tree first, so that redundancy is told of the loops."""
    by_id = {joint.id: joint for joint in mechanism.joints}
    rest = [id for id in by_id if id not in graph.tree and id not in graph.idle]
    return [by_id[id] for id in (*graph.tree, *rest)]


def _begins(mechanism: Mechanism, opened: dict[str, JointGap]) -> dict[str, float]:
    """Joint -> q as drawn, in the whole turn that it begins in; without those that have none."""
    near = begins_near(mechanism)
    able = [joint.id for joint in mechanism.joints if joint.type not in WITHOUT_COORDINATE]
    return {id: nearest(opened[id].q, near[id]) if id in near else opened[id].q for id in able}


def _closure(joint: Joint, found: JointGap, q: float | None) -> Closure:
    return Closure(
        joint=joint.id,
        gap_mm=1e3 * float(np.linalg.norm(found.gap)),
        turn_deg=float(np.degrees(np.linalg.norm(found.turn))),
        q=q,
    )


def _all_closed(found: dict[str, JointGap]) -> bool:
    return all(np.linalg.norm(gap.gap) <= CLOSED_M and np.linalg.norm(gap.turn) <= CLOSED_RAD for gap in found.values())


def _apart(found: JointGap) -> str:
    return f"{1e3 * np.linalg.norm(found.gap):.4g} mm and {np.degrees(np.linalg.norm(found.turn)):.3g} deg"


def _is_along(vector: Sequence[float], normal: np.ndarray | None) -> bool:
    size = float(np.linalg.norm(vector))
    return normal is not None and size > 0.0 and abs(float(normal @ np.array(vector))) > ALONG * size


def _closure_findings(
    mechanism: Mechanism,
    graph: Connectivity,
    opened: dict[str, JointGap],
    assembly: Assembly,
    normal: np.ndarray | None,
    length: float,
) -> tuple[list[str], list[str]]:
    """Errors and warnings about joints that do not meet as drawn."""
    impossible = [sentence for loop in graph.loops if (sentence := too_long(mechanism, loop, normal))]
    if _all_closed(opened):
        return [], []
    limit_m = OPEN_SHARE * length
    worst = max(opened, key=lambda id: np.linalg.norm(opened[id].gap) / length + np.linalg.norm(opened[id].turn))
    loop = next((loop for loop in graph.loops if worst in loop.joints), None)
    where = f'joint "{worst}"' + (f" of loop {'-'.join(loop.joints)}" if loop else "")
    apart = f"{where}: its two frames are drawn {_apart(opened[worst])} apart"
    limits = f"{1e3 * limit_m:.3g} mm (5% of the size) and {np.degrees(OPEN_RAD):g} deg"
    if not assembly.closed:
        if impossible:
            return impossible, []
        return [f"{apart}, and no nearby pose closes all joints; check its frames and the pin spacing"], []
    rough = any(np.linalg.norm(gap.gap) > limit_m or np.linalg.norm(gap.turn) > OPEN_RAD for gap in opened.values())
    if rough:
        return [f"{apart}, more than {limits}; draw the bodies closer to the pose in which the joints meet"], []
    return [], [f"{apart}; assembly closes it by shifting bodies up to {1e3 * assembly.moved_m:.4g} mm"]


def _graph_findings(mechanism: Mechanism, graph: Connectivity) -> list[str]:
    found = [
        f"bodies {', '.join(group)} are tied to nothing fixed and will fall freely; add a joint if that is not meant"
        for group in graph.floating
    ]
    return found + [
        f'joint "{id}" connects two fixed bodies and does nothing; remove it, or let one of them move'
        for id in graph.idle
    ]


def _contact_findings(found: FoundContacts) -> list[str]:
    if found.overlapping:
        pairs = ", ".join("-".join(pair) for pair in found.overlapping)
        return [
            f'effect "{found.effect}": {pairs} overlap as drawn and will not meet; correct the radius, or name them'
        ]
    if not found.pairs:
        return [f'effect "{found.effect}": no two links can meet; name the pairs that do']
    return []
