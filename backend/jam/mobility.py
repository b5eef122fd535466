"""Mobility along a motion, by every count in use: the gap in the spectrum, the published threshold, the driven row."""

from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from backend.jam.statics import dense, weights
from backend.model.state import Pose
from backend.model.system import System
from backend.simulate import forces, kinematics
from backend.simulate.record import Record
from backend.simulate.rollout import Trajectory
from backend.simulate.spectrum import rank, real, singular_values

PUBLISHED = 1e-6  # singular value below which the published count calls a way free
BATCH = 64  # poses decomposed together


@dataclass(frozen=True)
class Mobility:
    """Per node looked at: singular values of the held rows (falling), ways to move, by their gap and published.

    driven: the singular value that falls to 0, in proportion to the distance, where the drive loses its lever: of the
    held rows with the direction of the drive below them, the first beyond the held rows' own rank.
    """

    singular_values: Float[np.ndarray, "nodes n"]
    mobility: Int[np.ndarray, "nodes"]
    published: Int[np.ndarray, "nodes"]
    driven: Float[np.ndarray, "nodes"]


def mobility_along(
    system: System, path: Trajectory, record: Record | None, gravity_drives: bool, every: int = 1
) -> Mobility:
    """Spectra at every so many nodes of a motion.  gravity_drives: whether weight is the drive."""
    nodes, drives = np.arange(0, path.q.shape[0], every), None
    if record is not None:
        drives = record.values[np.minimum(nodes, record.values.shape[0] - 1)]
    poses = jax.tree.map(lambda leaf: leaf[nodes], path.pose)
    jacobians, push = _along(system, poses, path.q[nodes], drives, record, gravity_drives)
    jacobians, push = np.asarray(jacobians), np.asarray(push)
    parts = [
        _spectra(system, jacobians[at : at + BATCH], push[at : at + BATCH]) for at in range(0, len(jacobians), BATCH)
    ]
    return Mobility(*(np.concatenate([part[k] for part in parts]) for k in range(4)))


def _spectra(system: System, jacobians: np.ndarray, push: np.ndarray) -> tuple[np.ndarray, ...]:
    length, which = float(system.scale.length_m), system.rigid_rows.ravel()
    unit = np.tile([1 / length] * 3 + [1.0] * 3, jacobians.shape[1])
    every_row = np.tile(np.arange(6), (jacobians.shape[1], 1))
    coordinate = every_row[system.coordinate_rows & system.is_driven[:, None]]
    prescribed = 6 * np.flatnonzero(system.is_driven) + coordinate
    rows, below = [], []
    for jacobian, force in zip(jacobians, push, strict=True):
        every = unit[:, None] * dense(system, jacobian.reshape(-1, 12), system.pairs.repeat(6, 0))
        generalised = (force * np.array([length] * 3 + [1.0] * 3))[real(system)].ravel()
        size = float(np.linalg.norm(generalised))
        direction = generalised[None] / size if size > 0.0 else np.zeros((1, generalised.size))
        rows.append(every[which])
        below.append(every[prescribed] if prescribed.size else direction)
    held = np.stack(rows)
    values = singular_values(held)
    known = _ranks(values)
    more = singular_values(np.concatenate([held, np.stack(below)], 1))
    freedoms = held.shape[-1]
    at = np.minimum(known, more.shape[-1] - 1)
    driven = np.where(known < freedoms, np.take_along_axis(more, at[:, None], 1)[:, 0], 0.0)
    published = freedoms - (values >= PUBLISHED).sum(-1)
    return values, freedoms - known, published, driven


def _ranks(values: Float[np.ndarray, "nodes n"]) -> Int[np.ndarray, "nodes"]:
    """`spectrum.rank` of many spectra at once."""
    return np.array([rank(one) for one in values], dtype=int)


@eqx.filter_jit
def _along(
    system: System, poses: Pose, q: Array, drives: Array | None, record: Record | None, gravity_drives: bool
) -> tuple[Float[Array, "nodes joints 6 12"], Float[Array, "nodes slots 6"]]:
    """Row Jacobians, and the drive on every body [N, N m]."""

    def at(pose: Pose, q: Array, now: Array | None) -> tuple[Array, Array]:
        acting = system if record is None or now is None else record.apply(system, now)
        bodies = kinematics.bodies(acting, pose)
        jacobian = kinematics.rows(acting, bodies).jacobian
        weight = weights(acting, bodies)
        if gravity_drives:
            return jacobian, weight
        along = jnp.sum(jnp.where(acting.coordinate_rows[:, :, None], jacobian, 0.0), 1)
        effort = forces.collect(acting.topology.joint_sides, forces.joint_efforts(acting, q)[:, None] * along)
        none = jnp.zeros((acting.topology.slots, 6))
        return jacobian, forces.body_forces(acting, bodies, none) - weight + effort

    return jax.vmap(at)(poses, q, drives)
