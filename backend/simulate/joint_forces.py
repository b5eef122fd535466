"""Forces that joints put on their bodies, as a part's designer wants them: on each body, at its own joint point.

A joint gives its two bodies equal and opposite forces along one line through the point of body B (the child), and
opposite torques.  The point of body A (the parent) stands elsewhere where the joint slides or has play, so the torque
there takes up the moment of that offset: τ_A = -τ_B + (p_B - p_A) x (-f).
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from backend.joints.joint import ROWS
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.pose import Pose
from backend.model.build import build
from backend.model.flexible import split
from backend.model.system import system
from backend.simulate.run import Run

CARRIES: dict[str, str] = dict(
    zip(ROWS, ("force x", "force y", "force z", "torque y", "torque x", "torque z"), strict=True)
)
"""What a row of a joint carries, in the joint's frame on body A: a tilt along x is held by a torque about y."""


@dataclass(frozen=True)
class Load:
    """What a joint puts on one body, friction and springs in the joint included; T nodes, SI.

    point_W, force_W, torque_W (T, 3): world axes, the torque about the point.  R_WB (T, 3, 3): body to world.
    point_B (3,): the same point in body axes, from the body's origin.
    """

    body: str
    point_W: Float[np.ndarray, "T 3"]
    force_W: Float[np.ndarray, "T 3"]
    torque_W: Float[np.ndarray, "T 3"]
    R_WB: Float[np.ndarray, "T 3 3"]
    point_B: Float[np.ndarray, "3"]

    @property
    def force_B(self) -> Float[np.ndarray, "T 3"]:
        """The force in body axes [N]."""
        return np.einsum("tji,tj->ti", self.R_WB, self.force_W)

    @property
    def torque_B(self) -> Float[np.ndarray, "T 3"]:
        """The torque about the point, in body axes [N m]."""
        return np.einsum("tji,tj->ti", self.R_WB, self.torque_W)


@dataclass(frozen=True)
class JointLoad:
    """The loads of one joint on its parent (body A) and its child (body B).

    not_unique: what rigid parts leave undetermined, such as "force z", in the joint's frame on the parent; empty
    where all of it is unique, None where nobody looked.  sure_W (T, 3, 3): takes the unique part of a
    force, in W; all of it where nobody looked.
    """

    joint: str
    type: str
    parent: Load
    child: Load
    not_unique: tuple[str, ...] | None
    sure_W: Float[np.ndarray, "T 3 3"]

    @property
    def sides(self) -> tuple[tuple[Literal["parent", "child"], Load], ...]:
        """Parent and child, by name."""
        return ("parent", self.parent), ("child", self.child)

    @property
    def force_n(self) -> Float[np.ndarray, "T"]:
        """Size of the force, alike on both bodies [N]."""
        return np.linalg.norm(self.child.force_W, axis=-1)

    @property
    def unique_force_n(self) -> Float[np.ndarray, "T"]:
        """Size of the force's unique part [N]."""
        return np.linalg.norm(np.einsum("tij,tj->ti", self.sure_W, self.child.force_W), axis=-1)

    @property
    def torque_n_m(self) -> Float[np.ndarray, "T"]:
        """Size of the torque, the larger of both bodies' [N m]."""
        return np.maximum(*(np.linalg.norm(load.torque_W, axis=-1) for _, load in self.sides))

    @property
    def uniqueness(self) -> str:
        """In words: "unique", what is not, or that nobody looked."""
        if self.not_unique is None:
            return "not examined"
        return f"not unique: {', '.join(self.not_unique)}" if self.not_unique else "unique"


def joint_forces(mechanism: Mechanism, run: Run) -> tuple[JointLoad, ...]:
    """The loads of every joint of a run of this drawing, in drawn order; halves of bending links are bodies."""
    plant = system(build(mechanism))
    topology, drawn = plant.topology, split(mechanism)
    nodes, ids = len(run.time_s), topology.body_ids + topology.fixed_ids
    center = np.asarray(plant.center_of_mass)
    open_rows = run.redundancy.not_unique if run.redundancy else {}
    found = []
    for i, joint in enumerate(topology.joint_ids):
        force, torque = run.reaction_force_n[joint], run.reaction_torque_n_m[joint]
        placed = []
        for slot, point in zip(topology.joints[i], (plant.point_a[i], plant.point_b[i]), strict=True):
            body, p_B = str(ids[slot]), np.asarray(point) + center[slot]
            p_WB, R_WB = _pose(drawn, run, body, nodes)
            placed.append((body, p_WB + R_WB @ p_B, R_WB, p_B))
        (a, p_A, R_WA, in_A), (b, p_B, R_WB, in_B) = placed
        parent = Load(a, p_A, -force, -torque + np.cross(p_B - p_A, -force), R_WA, in_A)
        rows = open_rows.get(joint, ())
        sure = np.array([row not in rows for row in ROWS[:3]], dtype=float)
        axes_W = R_WA @ np.asarray(plant.axes_a[i])
        found.append(
            JointLoad(
                joint=joint,
                type=topology.joint_types[i],
                parent=parent,
                child=Load(b, p_B, force, torque, R_WB, in_B),
                not_unique=tuple(sorted(CARRIES[row] for row in rows)) if run.redundancy else None,
                sure_W=axes_W @ (sure[:, None] * np.swapaxes(axes_W, 1, 2)),
            )
        )
    return tuple(found)


def strongest(loads: tuple[JointLoad, ...]) -> list[JointLoad]:
    """Joints by the peak of their force, largest first."""
    return sorted(loads, key=lambda load: -float(load.force_n.max()))


def _pose(drawn: Mechanism, run: Run, body: str, nodes: int) -> tuple[np.ndarray, np.ndarray]:
    """Position (T, 3) and rotation (T, 3, 3) of a body; a fixed one stands where it is drawn."""
    if body in run.position_m:
        return run.position_m[body], _rotations(run.quaternion_wxyz[body])
    pose = drawn.body(body).pose if body in {b.id for b in drawn.bodies} else Pose()
    return np.tile(pose.position_m, (nodes, 1)), np.tile(pose.rotation(), (nodes, 1, 1))


def _rotations(quaternion_wxyz: Float[np.ndarray, "T 4"]) -> Float[np.ndarray, "T 3 3"]:
    w, x, y, z = quaternion_wxyz.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)
