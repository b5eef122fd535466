"""Forces and directions of a mechanism at rest in one pose, as plain matrices: what statics has to balance.

Freedoms are the shift of every body's centre of mass in W, counted in mechanism lengths, and its turn in body axes
[rad]; generalised forces are therefore in N m throughout, and a small and a large copy look alike.
"""

import dataclasses
from dataclasses import dataclass
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from backend.effects.gravity import Gravity
from backend.model.state import Pose
from backend.model.system import System
from backend.simulate import contact, forces, kinematics, law, meeting, touch
from backend.simulate.spectrum import real

TOUCHING = (
    1e-4  # of the room, or mechanism lengths: gap below which parts count as touching; the barrier keeps 1e-8 open
)


@dataclass(frozen=True)
class Contacts:
    """Places where parts touch: rows along which the gap opens and along which friction acts, one row a place."""

    opens: Float[np.ndarray, "places freedoms"]
    rubs: Float[np.ndarray, "places freedoms"]
    friction: Float[np.ndarray, "places"]
    names: tuple[tuple[str, ...], ...]
    """`joint:ID` of each, or both `body:ID` of links that meet."""
    ends: np.ndarray
    """(places,) whether it is an end of travel."""

    def those(self, which: np.ndarray) -> "Contacts":
        """Some of the places."""
        names = tuple(name for name, chosen in zip(self.names, which, strict=True) if chosen)
        return Contacts(self.opens[which], self.rubs[which], self.friction[which], names, self.ends[which])


@dataclass(frozen=True)
class Statics:
    """A pose's rows and loads.  `weight` + `drive` push; weight counts as the drive where nothing else drives."""

    held: Float[np.ndarray, "rows freedoms"]
    """Held rows of the joints, prescribed coordinates last."""
    held_at: np.ndarray
    """(rows, 2) joint and row of each; row 6 is a prescribed coordinate."""
    turns: Float[np.ndarray, "joints freedoms"]
    """Rows of the joints' coordinates; zero where a joint has none."""
    mass: Float[np.ndarray, "freedoms freedoms"]
    weight: Float[np.ndarray, "freedoms"]
    drive: Float[np.ndarray, "freedoms"]
    dry_limit: Float[np.ndarray, "joints"]
    dry_per_load: Float[np.ndarray, "joints"]
    pads: Float[np.ndarray, "pads 2 freedoms"]
    grip: Float[np.ndarray, "pads"]
    contacts: Contacts
    joints: tuple[str, ...]

    @property
    def load(self) -> Float[np.ndarray, "freedoms"]:
        """All that pushes, joints and friction apart."""
        return self.weight + self.drive


class _Raw(NamedTuple):
    jacobian: Array
    weight: Array
    rest: Array
    effort: Array
    limit: Array
    wall_rows: Array
    wall_gap: Array
    touch_gap: Array
    touch_rows: Array
    touch_friction: Array
    pad_rows: Array


def statics(system: System, pose: Pose, q: Array, gravity_drives: bool) -> Statics:
    """Everything that statics needs at a pose.

    q: coordinates of the joints, whole turns counted.  gravity_drives: whether weight is the drive.
    """
    raw = jax.tree.map(np.asarray, _raw(system, pose, q))
    length = float(system.scale.length_m)
    rows = dense(system, raw.jacobian.reshape(-1, 12), system.pairs.repeat(6, 0)).reshape(-1, 6, _freedoms(system))
    rows[:, :3] /= length
    which = np.argwhere(system.rigid_rows)
    turns = np.einsum("jr,jrf->jf", system.coordinate_rows, rows)
    per_unit = np.where(system.coordinate_rows[:, :3].any(-1), length, 1.0)  # of effort, per row in mechanism lengths
    prescribed = np.flatnonzero(system.is_driven)
    unit = np.tile([length] * 3 + [1.0] * 3, system.topology.slots).reshape(-1, 6)
    weight = (raw.weight * unit)[real(system)].ravel()
    rest = (raw.rest * unit)[real(system)].ravel() + (per_unit * raw.effort) @ turns
    drive, weight = (weight, rest) if gravity_drives else (rest, weight)
    return Statics(
        held=np.concatenate([rows[tuple(which.T)], turns[prescribed]]),
        held_at=np.concatenate([which, np.stack([prescribed, np.full_like(prescribed, 6)], 1)]),
        turns=turns,
        mass=_mass(system, length) + (turns.T * np.asarray(system.rotor) * per_unit**2) @ turns,
        weight=weight,
        drive=drive,
        dry_limit=raw.limit * per_unit,
        dry_per_load=np.asarray(system.dry_per_load) * per_unit / length,
        pads=dense(system, raw.pad_rows.reshape(-1, 6), np.array(system.pads.bodies, int).repeat(2)[:, None]).reshape(
            -1, 2, _freedoms(system)
        )
        / length,
        grip=np.asarray(system.pads.grip) * length,
        contacts=_contacts(system, raw, length),
        joints=system.topology.joint_ids,
    )


def dense(system: System, rows: Float[np.ndarray, "n k"], bodies: np.ndarray) -> Float[np.ndarray, "n freedoms"]:
    """Rows over one or two bodies each -> rows over all freedoms of the moving bodies; shifts in mechanism lengths.

    bodies: (n, 1) or (n, 2) slots; fixed bodies are left out.
    """
    slots = system.topology.slots
    wide = np.zeros((rows.shape[0], slots + 1, 6))
    for side in range(bodies.shape[1]):
        wide[np.arange(rows.shape[0]), np.minimum(bodies[:, side], slots)] += rows[:, 6 * side : 6 * side + 6]
    wide[:, :, :3] *= float(system.scale.length_m)
    return wide[:, :slots][:, real(system)].reshape(rows.shape[0], _freedoms(system))


@eqx.filter_jit
def _raw(system: System, pose: Pose, q: Array) -> _Raw:
    bodies = kinematics.bodies(system, pose)
    rows = kinematics.rows(system, bodies)
    contacts = system.contacts
    here = law.at_walls(system, jnp.where(system.coordinate_rows, 0.0, rows.value))
    face = contact.face(contacts, contacts.room, here, here)
    travels = np.array(contacts.travels, dtype=bool)
    gap = jnp.where(travels, contacts.room - contacts.normal[:, 0] * q[contacts.at], face.gap)
    eta = jnp.einsum("wcr,wrk->wck", contacts.selection, rows.jacobian[contacts.at])
    opens = -jnp.einsum("wc,wck->wk", face.normal, eta[:, :2])
    rubs = jnp.einsum("wc,wck->wk", face.along, eta[:, :2]) + eta[:, 2]
    places, none = touch.PLACES * system.touches.count, jnp.zeros(())
    met = meeting.meet(system, bodies, jnp.zeros(places), jnp.zeros(places), 0.0, none, jnp.full(places, jnp.inf))
    bend = system.stiffness * (system.rest - q)
    return _Raw(
        jacobian=rows.jacobian,
        weight=weights(system, bodies),
        rest=forces.body_forces(system, bodies, jnp.zeros((system.topology.slots, 6))) - weights(system, bodies),
        effort=forces.joint_efforts(system, q) + bend,
        limit=forces.dry_limits(system, jnp.zeros_like(q)),
        wall_rows=jnp.stack([opens, rubs], 1),
        wall_gap=gap,
        touch_gap=met.reach.room,
        touch_rows=met.rows,
        touch_friction=touch.walls(system).friction,
        pad_rows=met.pads,
    )


def weights(system: System, bodies: kinematics.Bodies) -> Float[Array, "slots 6"]:
    """Weight of every body about its centre of mass [N, N m]."""
    only = tuple(group for group in system.forces if isinstance(group.effect, Gravity))
    none = jnp.zeros((system.topology.slots, 6))
    bare = dataclasses.replace(system, forces=only)
    return forces.body_forces(bare, bodies, none) - forces.strut_pull(system, forces.strut_lines(system, bodies))


def _contacts(system: System, raw: _Raw, length: float) -> Contacts:
    """Places where parts touch at this pose."""
    ids, bodies = system.topology.joint_ids, system.topology.body_ids + system.topology.fixed_ids
    pairs = np.array(system.topology.touches, dtype=int).reshape(-1, 2).repeat(touch.PLACES, 0)
    at = system.contacts.at
    # An end of turning opens in rad: its row and its push are of a turn, not of a length.
    lengths = np.where(_turning_ends(system), 1.0, length)
    walls = dense(system, np.asarray(raw.wall_rows).reshape(-1, 12), system.pairs[at].repeat(2, 0)).reshape(
        -1, 2, _freedoms(system)
    )
    met = (
        dense(system, np.asarray(raw.touch_rows).reshape(-1, 12), pairs.repeat(2, 0)).reshape(-1, 2, _freedoms(system))
        / length
    )
    ends = np.array(system.contacts.travels, dtype=bool)
    room = np.where(ends, lengths, np.asarray(system.contacts.room))
    every = Contacts(
        opens=np.concatenate([walls[:, 0] / lengths[:, None], met[:, 0]]),
        rubs=np.concatenate([walls[:, 1] / lengths[:, None], met[:, 1]]),
        friction=np.concatenate([np.asarray(system.contacts.friction), raw.touch_friction]),
        names=(
            *((f"joint:{ids[j]}",) for j in at),
            *((f"body:{bodies[a]}", f"body:{bodies[b]}") for a, b in pairs),
        ),
        ends=np.concatenate([ends, np.zeros(len(pairs), dtype=bool)]),
    )
    return every.those(np.concatenate([raw.wall_gap < TOUCHING * room, raw.touch_gap < TOUCHING * length]))


def _turning_ends(system: System) -> np.ndarray:
    selection = np.asarray(system.contacts.selection)
    return np.array(system.contacts.travels, dtype=bool) & (selection[:, 0, 3:] != 0.0).any(-1)


def _mass(system: System, length: float) -> np.ndarray:
    every = np.arange(np.count_nonzero(real(system)))
    whole = np.zeros((every.size, 6, every.size, 6))
    whole[every, :3, every, :3] = np.asarray(system.mass)[real(system), None, None] * length**2 * np.eye(3)
    whole[every, 3:, every, 3:] = np.asarray(system.inertia)[real(system)]
    return whole.reshape(6 * every.size, -1)


def _freedoms(system: System) -> int:
    return 6 * int(real(system).sum())
