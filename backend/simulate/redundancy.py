"""Rows of an overconstrained mechanism that say nothing new, and what that leaves open about its reactions.

A left null vector n of the constraint Jacobian J (nᵀ J = 0) is a set of row impulses that does nothing to any body:
self-stress, which rigid parts leave undetermined.  A row's reaction is unique where every left null vector has a zero
there (Wojtyra 2005, Mechanism and Machine Theory 40, 1268; Wojtyra 2009, Multibody System Dynamics 21, 153).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.linalg import qr, solve_triangular

from backend.joints.joint import ROWS
from backend.model.state import Pose
from backend.model.system import System
from backend.simulate.spectrum import Row, held_rows, matrix, rank, real, singular_values, units

DIGITS = 9  # of a row's entries, the largest being 1, by which rows are chosen
MIXED = 1.001  # of a kept row in a dropped one, above which they are exchanged
EXCHANGES = 1000
SHARE = 1e-6  # entry of a null vector, its largest being 1, below which a row or a body takes no part in it
SHOWN = 6  # names in a sentence


@dataclass(frozen=True)
class NullMotion:
    """A way the closed mechanism can move: which bodies move, and their rates (slots, 6), largest entry 1.

    idle: it moves one body alone and no joint's coordinate answers for it, such as a coupler between two balls that
    spins about its own axis.
    """

    bodies: tuple[str, ...]
    rates: Float[np.ndarray, "slots 6"]
    idle: bool


@dataclass(frozen=True)
class Redundancy:
    """What the joints' held rows say at one pose, and what they repeat.

    rows: held rows, as (joint, row name).  redundant: those that follow from the others; which of a dependent set is
    named is a choice, made so that the kept rows are as independent as possible.  shared: for each redundant row, the
    joints that it is a combination of, itself included.  unique: (joints, 6), whether a row's reaction is the same in
    every rigid solution.  singular_values: falling, lengths measured in mechanism lengths.
    """

    rows: tuple[Row, ...]
    freedoms: int
    rank: int
    singular_values: Float[np.ndarray, "n"]
    redundant: tuple[Row, ...]
    shared: tuple[tuple[str, ...], ...]
    unique: Bool[np.ndarray, "joints 6"]
    joints: tuple[str, ...]
    motions: tuple[NullMotion, ...]
    kept_margin: float
    """Smallest singular value of the kept rows over the smallest that counts of all rows: 1 loses nothing."""

    @property
    def mobility(self) -> int:
        """Ways the mechanism can move at this pose."""
        return self.freedoms - self.rank

    @property
    def gap(self) -> float:
        """Smallest singular value that counts over the largest that does not; infinite where none is dropped."""
        values = self.singular_values
        if self.rank in (0, values.size) or values[self.rank] == 0.0:
            return float("inf")
        return float(values[self.rank - 1] / values[self.rank])

    @property
    def not_unique(self) -> dict[str, tuple[str, ...]]:
        """Joint -> its rows whose reactions are not unique; joints with unique reactions are left out."""
        found = {
            joint: tuple(name for name, sure in zip(ROWS, row, strict=True) if not sure)
            for joint, row in zip(self.joints, self.unique, strict=True)
        }
        return {joint: names for joint, names in found.items() if names}

    def sentence(self) -> str:
        """One line for a summary; empty where nothing is redundant."""
        if not self.redundant:
            return ""
        count = len(self.redundant)
        named = _listed([f"{joint} {row}" for joint, row in self.redundant])
        by_rows: dict[tuple[str, ...], list[str]] = {}
        for joint, rows in self.not_unique.items():
            by_rows.setdefault(rows, []).append(joint)
        parts = [f"{', '.join(rows)} at {_listed(ids)}" for rows, ids in by_rows.items()]
        rest = "; ".join(parts[:3]) + (f"; and at {len(self.not_unique)} joints in all" if len(parts) > 3 else "")
        return f"{count} redundant row{'s' * (count > 1)}: {named}; reactions along {rest} are not unique"


class LetGo(NamedTuple):
    """Redundant rows that a reduced solve leaves out, and the part of its own compliance that each other row keeps."""

    rows: Bool[np.ndarray, "joints 6"]
    share: Float[np.ndarray, "joints 6"]


def redundancy(system: System, pose: Pose, threshold: float | None = None) -> Redundancy:
    """Rank, redundant rows, mobility and null motions of a mechanism at a closed pose.

    threshold: relative singular value below which a row counts as repeated; by default the largest gap in the
    spectrum decides (`spectrum.rank`).  Raises ValueError for a threshold outside 0 to 1.
    """
    if threshold is not None and not 0.0 < threshold < 1.0:
        raise ValueError(f"threshold is {threshold:g}; give a part of the largest singular value, between 0 and 1")
    J, rows = matrix(system, pose), held_rows(system)
    values = singular_values(J)
    known = rank(values, threshold)
    kept, dropped, combination = _split(J, known)
    null = np.zeros((dropped.size, len(rows)))  # one left null vector for each redundant row
    null[np.arange(dropped.size), dropped] = 1.0
    null[:, kept] = -combination
    takes_part = np.abs(null) > SHARE * np.abs(null).max(1, initial=1.0)[:, None]
    unique = np.ones(system.rigid_rows.shape, dtype=bool)
    unique[system.rigid_rows] = ~takes_part.any(0)
    margin = singular_values(J[kept])[-1] / values[known - 1] if known else 1.0
    return Redundancy(
        rows=rows,
        freedoms=J.shape[1],
        rank=known,
        singular_values=values,
        redundant=tuple(rows[i] for i in dropped),
        shared=tuple(tuple(dict.fromkeys(rows[i][0] for i in np.flatnonzero(part))) for part in takes_part),
        unique=unique,
        joints=system.topology.joint_ids,
        motions=_motions(system, J, known),
        kept_margin=float(margin),
    )


def let_go_at(system: System, pose: Pose, threshold: float | None = None) -> LetGo:
    """The redundant rows alone, which the reduced solve leaves out, and how much stiffer the kept ones then stand.

    Rows let go = combination @ kept rows, so a kept row and its shares of those let go were springs side by side; it
    takes over their stiffness, or it would give way to what all of them carried.
    """
    J = matrix(system, pose)
    kept, dropped, combination = _split(J, rank(singular_values(J), threshold))
    held = np.argwhere(system.rigid_rows)
    rows = np.zeros(system.rigid_rows.shape, dtype=bool)
    rows[tuple(held[dropped].T)] = True
    unit = np.array([float(system.scale.length_m) ** 2] * 3 + [1.0] * 3)  # combination is in mechanism lengths
    stiffness = (unit / np.asarray(system.compliance))[system.rigid_rows]
    share = np.ones(rows.shape)
    share[tuple(held[kept].T)] = 1.0 / (1.0 + stiffness[dropped] @ combination**2 / stiffness[kept])
    return LetGo(rows, share)


def null_space(system: System, pose: Pose) -> Float[np.ndarray, "slots 6 mobility"]:
    """Ways the closed mechanism can move: one rate each, in bodies' rows, largest entry 1 mechanism length or rad."""
    J = matrix(system, pose)
    return _rates(system, _null(J, rank(singular_values(J))))


def _split(J: np.ndarray, known: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows kept, rows dropped (both in drawn order), and dropped = combination @ kept.

    Column-pivoted QR of Jᵀ (Businger and Golub 1965) takes the rows that stand furthest from those taken before; alike
    links leave it ties, which must not depend on rounding (`DIGITS`).  Then rows are exchanged until no dropped row
    holds more than `MIXED` of a kept one (Gu and Eisenstat 1996): each exchange makes the kept rows span more.
    """
    if not J.size or known == 0:
        return np.zeros(0, int), np.arange(J.shape[0]), np.zeros((J.shape[0], 0))
    alike = np.round(J.T / np.abs(J).max(), DIGITS)
    _, R, order = qr(alike, mode="economic", pivoting=True)  # pyright: ignore[reportAssignmentType]: pivoting gives three
    kept, dropped = order[:known], order[known:]
    combination = solve_triangular(R[:known, :known], R[:known, known:]).T
    for _ in range(EXCHANGES if combination.size else 0):
        i, j = np.unravel_index(np.abs(combination).argmax(), combination.shape)
        if abs(combination[i, j]) <= MIXED:
            break
        kept[j], dropped[i] = dropped[i], kept[j]
        row, column = combination[i].copy(), combination[:, j].copy()
        row[j] -= 1.0
        column[i] += 1.0
        combination = combination - np.outer(column, row) / combination[i, j]
    kept, dropped = np.sort(kept), np.sort(dropped)
    return kept, dropped, np.linalg.lstsq(J[kept].T, J[dropped].T, rcond=None)[0].T


def _motions(system: System, J: np.ndarray, known: int) -> tuple[NullMotion, ...]:
    """Null motions: idle ones of single bodies first, the others orthogonal to them."""
    names = [body for body in system.topology.body_ids if body is not None]
    bodies = len(names)
    whole = _null(J, known)
    alone = np.concatenate([np.zeros((J.shape[1], 0)), *(_alone(J, names.index(b)) for b in _between(system))], 1)
    rest, share, _ = np.linalg.svd(whole - alone @ (alone.T @ whole), full_matrices=False)
    found = []
    for vectors, idle in ((alone, True), (rest[:, share > 0.5], False)):
        for vector in vectors.T:
            size = np.abs(vector.reshape(bodies, 6)).max(1)
            movers = tuple(name for name, s in zip(names, size, strict=True) if s > SHARE * size.max())
            found.append(NullMotion(movers, _rates(system, vector[:, None])[:, :, 0], idle))
    return tuple(found)


def _between(system: System) -> list[str]:
    """Bodies that joints tie to two others or more, all fixed ones counted as one."""
    slots = system.topology.slots
    ends = np.minimum(system.pairs, slots)
    tied = [{*ends[(ends == slot).any(1)].ravel()} - {slot} for slot in range(slots)]
    return [b for b, others in zip(system.topology.body_ids, tied, strict=True) if b is not None and len(others) > 1]


def _alone(J: np.ndarray, body: int) -> np.ndarray:
    """Orthonormal motions of one body that no held row notices."""
    own = J[:, 6 * body : 6 * body + 6]
    moves = np.zeros((J.shape[1], 6))
    moves[6 * body : 6 * body + 6] = np.eye(6)
    return moves @ _null(own, rank(singular_values(own)))


def _null(J: np.ndarray, known: int) -> np.ndarray:
    """Orthonormal null space, (freedoms, mobility)."""
    if not J.size:
        return np.eye(J.shape[1])
    return np.linalg.svd(J, full_matrices=True)[2][known:].T


def _rates(system: System, null: np.ndarray) -> Float[np.ndarray, "slots 6 ways"]:
    """Null vectors over the real bodies as rates of all slots, in m and rad, the largest entry 1 before units."""
    ways = null.shape[1]
    rates = np.zeros((system.topology.slots, 6, ways))
    rates[real(system)] = (null / np.maximum(np.abs(null).max(0, initial=0.0), 1e-300)).reshape(-1, 6, ways)
    return rates * units(system)[:, :, None]


def _listed(names: list[str]) -> str:
    rest = len(names) - SHOWN
    return ", ".join(names) if rest <= 0 else f"{', '.join(names[:SHOWN])} and {rest} more"
