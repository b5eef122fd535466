"""Can joints and contacts, with friction, hold the load in this pose?  A linear programme over the friction cones.

Unknown are the forces of the held rows λ, the friction at the joints' coordinates τ, push γ >= 0 and friction f of
everything that touches: Jᵀλ + Cᵀτ + ... = -F with |τ| <= s (D + c |λ_xy|), |f| <= s μ γ.  Where friction grows with the
radial load of a tight pin the set |τ| <= c |λ_xy| is not convex; its part u·λ_xy >= |τ| / c is, for every direction u,
and lies inside.  u starts where the simulated load points and follows the programme's own answer.

Forces of rigid parts need not be unique: "can hold" means that some forces do (Erdmann 1994 for friction; Or and Rimon
2006 for what it leaves open).  HiGHS solves the programmes (Huangfu and Hall 2018).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.optimize import linprog

from backend.jam.statics import Statics

FACETS = 16  # of the polygon inside the circle of a pad's friction: 2% inside at worst
TURNS = 12  # of u
HELD = 1e-7  # of the load: shortage of friction below which it holds
MOST = 1e4  # factor on drive or friction beyond which none is looked for
SHARP = 1e-4  # relative width of a bracket


@dataclass(frozen=True)
class Answer:
    """One programme: what it minimised, and the radial loads of the joints that came with it."""

    value: float
    radial: Float[np.ndarray, "joints 2"]


def can_hold(at: Statics, radial: Float[np.ndarray, "joints 2"], drive: float = 1.0, friction: float = 1.0) -> bool:
    """Whether some forces within the cones balance weight and `drive` times the drive, friction times `friction`."""
    return shortage(at, radial, drive, friction) < HELD


def shortage(at: Statics, radial: Float[np.ndarray, "joints 2"], drive: float = 1.0, friction: float = 1.0) -> float:
    """How much friction is short of holding the load, in parts of the load; infinite where no forces balance it.

    radial: loads of the joints in the plane of their pins, to begin with [N].
    """
    least = float("inf")
    for _ in range(TURNS):
        answer = _programme(at, _directions(radial), friction, drive)
        if answer is None:
            break
        least = min(least, answer.value)
        if least < HELD or np.allclose(_directions(answer.radial), _directions(radial), atol=1e-6):
            break
        radial = answer.radial
    return least


def friction_needed(at: Statics, radial: Float[np.ndarray, "joints 2"]) -> float:
    """The least factor on friction that still holds the load; infinite where none does."""
    low, high = 0.0, 1.0
    while not can_hold(at, radial, friction=high):
        low, high = high, 4.0 * high
        if high > MOST:
            return float("inf")
    if low == 0.0 and can_hold(at, radial, friction=0.0):
        return 0.0
    while high - low > SHARP * high:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if can_hold(at, radial, friction=middle) else (middle, high)
        if high < SHARP:
            return 0.0
    return high


def drive_held(at: Statics, radial: Float[np.ndarray, "joints 2"]) -> float:
    """The greatest factor on the drive, from 1 up, that friction still holds; 0 where it does not hold it at 1."""
    if not can_hold(at, radial):
        return 0.0
    low, high = 1.0, 2.0
    while can_hold(at, radial, drive=high):
        low, high = high, 4.0 * high
        if high > MOST:
            return float("inf")
    while high - low > SHARP * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if can_hold(at, radial, drive=middle) else (low, middle)
    return low


def _directions(radial: np.ndarray) -> np.ndarray:
    size = np.linalg.norm(radial, axis=-1, keepdims=True)
    return np.where(size > 0.0, radial / np.maximum(size, 1e-300), 0.0)


def _programme(at: Statics, u: np.ndarray, friction: float, drive: float) -> Answer | None:
    """Least shortage of friction, in parts of the load; None where no forces balance it at all."""
    load = at.weight + drive * at.drive
    scale = float(np.abs(load).max(initial=0.0)) or 1.0
    rubbing = np.flatnonzero((at.dry_limit > 0.0) | (at.dry_per_load > 0.0))
    touching, pads = at.contacts, at.grip.size
    blocks = [at.held, at.turns[rubbing], touching.opens, touching.rubs, at.pads.reshape(2 * pads, load.size)]
    counts = [len(block) for block in blocks]
    start = np.concatenate([[0], np.cumsum(counts)])
    shortage = int(start[-1])
    balance = np.concatenate([*blocks, np.zeros((1, load.size))]).T
    rows, bounds = [], []

    def bounded(at_most: np.ndarray, right: float) -> None:
        at_most[shortage] = -1.0
        rows.append(at_most)
        bounds.append(right / scale)

    for i, joint in enumerate(rubbing):
        grows = np.zeros(shortage + 1)
        for row in range(2):
            where = np.flatnonzero((at.held_at[:, 0] == joint) & (at.held_at[:, 1] == row))
            grows[where] = -friction * at.dry_per_load[joint] * u[joint, row]
        for sign in (1.0, -1.0):
            one = grows.copy()
            one[start[1] + i] = sign
            bounded(one, friction * at.dry_limit[joint])
    for i, coefficient in enumerate(touching.friction):
        for sign in (1.0, -1.0):
            one = np.zeros(shortage + 1)
            one[start[3] + i], one[start[2] + i] = sign, -friction * coefficient
            bounded(one, 0.0)
    for i in range(pads):
        for angle in 2.0 * np.pi * np.arange(FACETS) / FACETS:
            one = np.zeros(shortage + 1)
            one[start[4] + 2 * i : start[4] + 2 * i + 2] = np.cos(angle), np.sin(angle)
            bounded(one, friction * at.grip[i] * np.cos(np.pi / FACETS))
    free: list[tuple[float | None, float | None]] = [(None, None)] * (shortage + 1)
    free[start[2] : start[3]] = [(0.0, None)] * counts[2]
    free[shortage] = (0.0, None)
    cost = np.zeros(shortage + 1)
    cost[shortage] = 1.0
    limits = {"A_ub": np.array(rows), "b_ub": np.array(bounds)} if rows else {}
    found = linprog(cost, A_eq=balance, b_eq=-load / scale, bounds=free, method="highs", **limits)
    if found.status != 0:
        return None
    forces = found.x[: counts[0]]
    radial = np.zeros((len(at.joints), 2))
    for force, (joint, row) in zip(forces, at.held_at, strict=True):
        if row < 2:
            radial[joint, row] = force
    return Answer(float(found.x[shortage]), radial)
