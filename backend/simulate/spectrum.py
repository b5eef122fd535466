"""Singular values of the held rows: how many of them say something new, at a pose or along a motion (numpy)."""

from dataclasses import dataclass

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float, Int

from backend.joints.joint import ROWS
from backend.model.state import Pose
from backend.model.system import System
from backend.simulate import kinematics
from backend.simulate.rollout import Trajectory

NULL_FALLBACK = 1e-7  # relative singular value that counts as zero where the spectrum shows no gap
BATCH = 64  # poses whose matrices are decomposed together

Row = tuple[str, str]
"""A row of the joints: joint id, and its name (`backend.joints.joint.ROWS`)."""


def held_rows(system: System) -> tuple[Row, ...]:
    """The rows that the joints' kinds hold, in the order of `matrix`."""
    joints, rows = np.nonzero(system.rigid_rows)
    return tuple((system.topology.joint_ids[j], ROWS[r]) for j, r in zip(joints, rows, strict=True))


def units(system: System) -> Float[np.ndarray, "slots 6"]:
    """What one of a body's freedoms is measured in: mechanism lengths and radians."""
    return np.tile([float(system.scale.length_m)] * 3 + [1.0] * 3, (system.topology.slots, 1))


def real(system: System) -> np.ndarray:
    """(slots,) whether a slot holds a body."""
    return np.array([body is not None for body in system.topology.body_ids])


def matrix(system: System, pose: Pose) -> Float[np.ndarray, "rows freedoms"]:
    """Jacobian of the held rows with respect to shift [mechanism lengths] and turn [rad] of the bodies.

    Offsets are in mechanism lengths too, so that a small and a large copy of a mechanism have the same spectrum.
    """
    return _dense(system, np.asarray(_jacobian(system, pose)))


def singular_values(matrix: Float[np.ndarray, "*poses rows freedoms"]) -> Float[np.ndarray, "*poses n"]:
    """Falling; n is the smaller of rows and freedoms."""
    if 0 in matrix.shape[-2:]:
        return np.zeros((*matrix.shape[:-2], 0))
    return np.linalg.svd(matrix, compute_uv=False)


def rank(singular_values: Float[np.ndarray, "n"], threshold: float | None = None) -> int:
    """How many singular values are not zero.

    threshold: relative to the first, what lies below counts as zero.  Without one it is the largest gap in the
    spectrum, below a thousandth of the first; 1e-7 where there is no gap.
    """
    if singular_values.size == 0 or singular_values[0] == 0.0:
        return 0
    relative = np.maximum(singular_values / singular_values[0], 1e-17)
    if threshold is not None:
        return int(np.sum(relative > threshold))
    gaps = relative[:-1] / relative[1:]
    small = np.flatnonzero((relative[1:] < 1e-3) & (gaps > 1e3))
    if small.size:
        return int(small[gaps[small].argmax()]) + 1
    return int(np.sum(relative > NULL_FALLBACK))


@dataclass(frozen=True)
class RankAlong:
    """Rank of the held rows at nodes of a motion."""

    time_s: Float[np.ndarray, "seen"]
    singular_values: Float[np.ndarray, "seen n"]
    rank: Int[np.ndarray, "seen"]
    mobility: Int[np.ndarray, "seen"]

    @property
    def margin(self) -> Float[np.ndarray, "seen"]:
        """The smallest singular value that counts at most nodes, over the largest: falls to 0 at a change point."""
        usual = int(np.bincount(self.rank).argmax())
        if usual == 0:
            return np.zeros(self.time_s.shape)
        return self.singular_values[:, usual - 1] / self.singular_values[:, 0]


def rank_along(system: System, trajectory: Trajectory, every: int = 1, threshold: float | None = None) -> RankAlong:
    """Spectrum, rank and mobility of the held rows at every so many nodes of a motion.

    threshold: as for `rank`.  A node a little beside a change point has a small singular value, not a zero; give a
    threshold (1e-3, say) to count it as lost already.
    """
    if every < 1:
        raise ValueError(f"every is {every}; look at every node with 1, at every tenth with 10")
    poses = jax.tree.map(lambda leaf: leaf[::every], trajectory.pose)
    jacobians = np.asarray(_jacobians(system, poses))
    values = [
        singular_values(np.stack([_dense(system, one) for one in jacobians[at : at + BATCH]]))
        for at in range(0, len(jacobians), BATCH)
    ]
    spectrum = np.concatenate(values)
    ranks = np.array([rank(one, threshold) for one in spectrum], dtype=int)
    return RankAlong(np.asarray(trajectory.time_s)[::every], spectrum, ranks, 6 * int(real(system).sum()) - ranks)


@eqx.filter_jit
def _jacobian(system: System, pose: Pose) -> Float[Array, "joints 6 12"]:
    return kinematics.rows(system, kinematics.bodies(system, pose)).jacobian


@eqx.filter_jit
def _jacobians(system: System, poses: Pose) -> Float[Array, "nodes joints 6 12"]:
    return jax.vmap(lambda pose: kinematics.rows(system, kinematics.bodies(system, pose)).jacobian)(poses)


def _dense(system: System, jacobian: Float[np.ndarray, "joints 6 12"]) -> Float[np.ndarray, "rows freedoms"]:
    slots, length = system.topology.slots, float(system.scale.length_m)
    dense = np.zeros((jacobian.shape[0] * 6, (slots + 1) * 6))
    for joint, (a, b) in enumerate(system.pairs):
        for side, slot in enumerate((a, b)):
            column = 6 * min(slot, slots)
            dense[6 * joint : 6 * joint + 6, column : column + 6] += jacobian[joint, :, 6 * side : 6 * side + 6]
    row_unit = np.tile([1 / length] * 3 + [1.0] * 3, jacobian.shape[0])
    scaled = row_unit[:, None] * dense[:, : 6 * slots] * units(system).ravel()
    return scaled[system.rigid_rows.ravel()][:, np.repeat(real(system), 6)]
