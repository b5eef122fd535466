"""How many ways a mechanism can move: by counting, and by the rank of its constraints at a pose."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from backend.mechanism.constraints import Placement, body_index, jacobian, rows
from backend.mechanism.joint import Joint
from backend.mechanism.mechanism import Mechanism

FALLBACK = 1e-7  # relative threshold of a spectrum without a clear gap
CLEAR_GAP = 1e3  # a ratio of neighbouring singular values that geometry does not produce by itself
STRESSED = 1e-6  # of a unit stress that no freedom of the mechanism feels: more of it is no rounding
PARALLEL = 1e-6  # sine of the angle up to which axes count as parallel: a drawing rounded to 1e-7 passes


@dataclass(frozen=True)
class Rank:
    """Rank of the constraint rows at a pose, and the evidence for it.

    singular_values: descending, (min(rows, columns),). threshold: absolute, what lies below counts as zero.
    gap: ratio of the smallest singular value kept to the largest dropped (infinite when that is zero).
    """

    rows: int
    columns: int
    rank: int
    threshold: float
    gap: float
    singular_values: np.ndarray

    @property
    def mobility(self) -> int:
        """Freedoms left at this pose."""
        return self.columns - self.rank

    @property
    def redundant(self) -> int:
        """Rows that repeat others; more than the spectrum's zeros, as it is min(rows, columns) long."""
        return self.rows - self.rank


def rank_at(mechanism: Mechanism, joints: list[Joint], placement: Placement, length: float) -> Rank:
    """Rank of the constraint Jacobian, cut at the largest gap of its spectrum, 1e-7 relative without one."""
    matrix = jacobian(mechanism, joints, placement, length)
    if not matrix.size:
        return Rank(matrix.shape[0], matrix.shape[1], 0, 0.0, np.inf, np.zeros(0))
    values = np.linalg.svd(matrix, compute_uv=False)
    floor = values[0] * np.finfo(float).eps * max(matrix.shape)
    clipped = np.maximum(values, floor)  # below lies rounding, whose ratios mean nothing
    ratios = clipped[:-1] / clipped[1:]
    threshold = FALLBACK * values[0]
    small = clipped[1:] < np.sqrt(FALLBACK) * values[0]
    candidates = np.where(small & (ratios >= CLEAR_GAP), ratios, 0.0)
    if candidates.size and candidates.max() > 0.0:
        at = int(np.argmax(candidates))
        threshold = float(np.sqrt(clipped[at] * clipped[at + 1]))
    rank = int(np.sum(values > threshold))
    gap = np.inf if rank == len(values) or values[rank] == 0.0 else float(values[rank - 1] / values[rank])
    return Rank(matrix.shape[0], matrix.shape[1], rank, float(threshold), gap, values)


def redundant_by_joint(
    mechanism: Mechanism, joints: list[Joint], placement: Placement, length: float, rank: Rank
) -> dict[str, int]:
    """Joint id -> how many of its rows the joints before it already impose.

    Which row of a dependent set is the redundant one is a matter of order: put tree joints first, and the
    joints that close the loops are named.
    """
    if not rank.redundant:
        return {}
    matrix = jacobian(mechanism, joints, placement, length)
    basis = np.zeros((matrix.shape[1], rank.rank + 6), order="F")
    known = 0
    found: dict[str, int] = {}
    row = 0
    for joint in joints:
        block = matrix[row : row + rows(joint)].T
        row += rows(joint)
        for _ in range(2):  # once loses digits to cancellation, twice is enough (Kahan and Parlett)
            block = block - basis[:, :known] @ (basis[:, :known].T @ block)
        u, values, _ = np.linalg.svd(block, full_matrices=False)
        new = min(int(np.sum(values > rank.threshold)), basis.shape[1] - known)
        basis[:, known : known + new] = u[:, :new]
        known += new
        if new < rows(joint):
            found[joint.id] = rows(joint) - new
    return found


def binding_joints(mechanism: Mechanism, placement: Placement, length: float) -> frozenset[str]:
    """Joints some of whose rows repeat what others impose. Rigid parts bind where one of them is not as drawn: any axis
    of a planar loop that leans.
    """
    joints = list(mechanism.joints)
    rank = rank_at(mechanism, joints, placement, length)
    if not rank.redundant:
        return frozenset()
    stresses = np.linalg.svd(jacobian(mechanism, joints, placement, length))[0][:, rank.rank :]
    ends = np.cumsum([rows(joint) for joint in joints])
    blocks = np.split(stresses, ends[:-1])
    return frozenset(j.id for j, block in zip(joints, blocks, strict=True) if np.linalg.norm(block) > STRESSED)


def count_in_space(mechanism: Mechanism, joints: list[Joint]) -> int:
    """Kutzbach's count in 3-D: six for each moving body, less the rows of the joints."""
    return 6 * len(mechanism.moving_bodies()) - sum(rows(joint) for joint in joints)


def joint_axes(mechanism: Mechanism, joints: list[Joint], placement: Placement) -> np.ndarray:
    """The joints' axes as their first bodies stand (joints, 3), in W."""
    index = body_index(mechanism)
    axes = [placement.rotations[index[joint.body_a]] @ joint.frame_a.rotation()[:, 2] for joint in joints]
    return np.array(axes).reshape(-1, 3)


def plane_normal(joints: list[Joint], axes: np.ndarray) -> np.ndarray | None:
    """Normal of the common plane of motion, or None when the axes (joints, 3, in W) do not share one.

    Spherical and universal joints let bodies turn out of any plane: a mechanism with one is not counted in the plane.
    """
    if any(joint.type in ("spherical", "universal") for joint in joints):
        return None
    along = [
        axis for joint, axis in zip(joints, axes, strict=True) if joint.type in ("revolute", "cylindrical", "planar")
    ]
    across = [axis for joint, axis in zip(joints, axes, strict=True) if joint.type == "prismatic"]
    if not along and not across:
        return None
    # A normal is parallel to the former and perpendicular to the latter.
    normal = along[0] if along else np.linalg.svd(np.array(across))[2][-1]
    parallel = all(np.linalg.norm(np.cross(normal, axis)) <= PARALLEL for axis in along)
    perpendicular = all(abs(normal @ axis) <= PARALLEL for axis in across)
    return normal if parallel and perpendicular else None


def count_in_plane(mechanism: Mechanism, joints: list[Joint]) -> int:
    """Grübler's count for a mechanism whose bodies all move in parallel planes."""
    taken = {"fixed": 3, "planar": 0}
    return 3 * len(mechanism.moving_bodies()) - sum(taken.get(joint.type, 2) for joint in joints)
