"""Start poses that close every loop, and the motion that follows a release.

Smooth realities, and what a witness tries, move together through DOP853 (Hairer, Nørsett, Wanner 1993); crisp bristles
and contacts one by one through LSODA (Petzold 1983), which turns implicit where they are stiff.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from backend.blind.withheld.forces import base_place
from backend.blind.withheld.laws import Laws
from backend.blind.withheld.linkage import Linkage
from backend.blind.withheld.plane import turned
from backend.blind.withheld.plant import Plant

GRID_S = 2.5e-3  # nodes between which a cubic is drawn: 1e-8 m at 20 rad/s
BRISTLE_EXACT = 1e-3  # of what a bristle bears: its error averages out within milliseconds
TOUCHING = ("lower", "upper", "play")


class Stuck(ValueError):
    """A pose that does not close, or a motion that does not go on."""


@dataclass(frozen=True)
class Motion:
    """Rows of motion: time_s (T), since each release; state (rows, T, width)."""

    plant: Plant
    time_s: np.ndarray
    state: np.ndarray

    def at(self, time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """q and q̇ (rows, times, n) at times since the release (rows, times); held at both ends."""
        n, h = self.plant.n, self.time_s[1] - self.time_s[0]
        s = np.clip(time_s / h, 0, len(self.time_s) - 1)
        k = np.clip(s.astype(int), 0, len(self.time_s) - 2)
        u = (s - k)[..., None]
        row = np.arange(len(self.state))[:, None]
        one, two = self.state[row, k], self.state[row, k + 1]
        q0, q1, v0, v1 = one[..., :n], two[..., :n], one[..., n : 2 * n], two[..., n : 2 * n]
        q = q0 * (1 + 2 * u) * (1 - u) ** 2 + h * v0 * u * (1 - u) ** 2 + q1 * u**2 * (3 - 2 * u)
        return q - h * v1 * u**2 * (1 - u), v0 * (1 - u) + v1 * u

    def markers(self, time_s: np.ndarray) -> np.ndarray:
        """Where every marker is in the world (rows, times, markers), complex [m]."""
        laws, tree = self.plant.laws, self.plant.tree
        q, v = self.at(time_s)
        rows, times, n = q.shape
        marks = self.plant.linkage.markers
        inside = np.stack([tree.stretched(b, p, laws) for _, b, p in marks], 1) + laws.shifted
        D = tree.points([b for _, b, _ in marks], inside, laws)
        U = tree.shifts([b for _, b, _ in marks])
        now = turned(tree, q.reshape(-1, n), v.reshape(-1, n))
        E = now.E.reshape(rows, times, -1)
        p = E @ D.transpose(0, 2, 1)
        for k, s in enumerate(tree.slides):
            p = p + (q[..., s.coordinate] * E[..., s.parent])[..., None] * U[:, k]
        moved = {n: v[:, None] if v.ndim == 1 else v for n, v in laws.numbers.items() if n.startswith("sway")}
        return p + base_place(Laws({**laws.numbers, **moved}), np.maximum(time_s, 0.0))[:, :, None]

    def energy(self) -> np.ndarray:
        """Kinetic plus potential energy (rows, T) of links in gravity and drawn springs [J]."""
        plant = self.plant
        rows = []
        for k in range(self.state.shape[1]):
            q, v = (self.state[:, k, s] for s in (slice(0, plant.n), slice(plant.n, 2 * plant.n)))
            now = turned(plant.tree, q, v)
            p, J, _ = now.motion(plant.centres)
            speed = (J @ v[:, :, None])[..., 0]
            kinetic = 0.5 * (plant.mass * np.abs(speed) ** 2).sum(1) + 0.5 * np.einsum(
                "rn,rnm,rm->r", v, plant.rotary, v
            )
            high = -(plant.mass * np.real(np.conj(plant.gravity)[:, None] * p)).sum(1)
            length = np.abs(now.place(plant.struts))
            springs = [
                0.5 * s.stiffness * (length[:, i] - s.free_length) ** 2 for i, s in enumerate(plant.linkage.springs)
            ]
            rows.append(kinetic + high + sum(springs))
        return np.array(rows).T

    def open_m(self) -> float:
        """How far any loop is open at any time [m]."""
        n = self.plant.n
        misses = [
            np.abs(turned(self.plant.tree, s[:, :n], s[:, n : 2 * n]).place(self.plant.loops))
            for s in np.moveaxis(self.state, 1, 0)
        ]
        return float(np.max(misses, initial=0.0))


def close(plant: Plant, wanted: np.ndarray, near: np.ndarray | None = None) -> np.ndarray:
    """Tree coordinates (rows, n) with the movers at `wanted` (rows, movers), loops closed, loose pins at rest in holes.

    near: coordinates to begin from (the drawn pose).  Raises Stuck where no pose closes.
    """
    tree, linkage, laws = plant.tree, plant.linkage, plant.laws
    rows, n = laws.rows, tree.n
    q = np.zeros((rows, n)) if near is None else near.copy()
    start = (q @ tree.turned.T)[:, linkage.movers]
    steps = max(1, int(np.ceil(np.abs(wanted - start).max() / 0.15)))
    rest = np.zeros((rows, len(tree.loose)), complex)
    for k, j in enumerate(tree.loose):
        # The part that hangs sags to the bottom of its hole, or with its hole onto the pin.
        rest[:, k] = (1j if linkage.pins[j].b == 0 else -1j) * laws.play[:, j]
    for step in range(1, steps + 1):
        goal = start + (wanted - start) * step / steps
        for _ in range(25):
            now = turned(tree, q, np.zeros_like(q))
            phi, J, _ = now.motion(plant.loops)
            off, Jh, _ = now.motion(plant.holes)
            miss = [
                np.real(phi),
                np.imag(phi),
                np.real(off - rest),
                np.imag(off - rest),
                (q @ tree.turned.T)[:, linkage.movers] - goal,
            ]
            slopes = [
                np.real(J),
                np.imag(J),
                np.real(Jh),
                np.imag(Jh),
                np.broadcast_to(tree.turned[list(linkage.movers)], (rows, len(linkage.movers), n)),
            ]
            r, A = np.concatenate(miss, 1), np.concatenate(slopes, 1)
            if np.abs(r).max() < 1e-12:
                break
            q = q - np.einsum("rnm,rm->rn", np.linalg.pinv(A, 1e-9), r)
        else:
            raise Stuck(f"the {linkage.family} stays open by {np.abs(r).max():.3g} m in the pose asked for")
    return q


def rates(plant: Plant, q: np.ndarray) -> np.ndarray:
    """Tree rates (rows, n) with the first joint at its release rate, further movers at rest, the loops moving along."""
    tree, first = plant.tree, plant.linkage.movers
    now = turned(tree, q, np.zeros_like(q))
    _, J, _ = now.motion(plant.loops)
    held = [0, *first[1:]]  # a kick is of the joint that is drawn first, which a scissor's mover is not
    movers = np.broadcast_to(tree.turned[held], (len(q), len(held), tree.n))
    A = np.concatenate([np.real(J), np.imag(J), movers], 1)
    want = np.zeros(A.shape[:2])
    want[:, 2 * J.shape[1]] = plant.laws.release_rate
    return np.einsum("rnm,rm->rn", np.linalg.pinv(A, 1e-9), want)


def move(
    linkage: Linkage,
    laws: Laws,
    starts: np.ndarray,
    duration_s: float,
    *,
    crisp: bool = False,
    near: np.ndarray | None = None,
    tolerance: float = 1e-8,
) -> Motion:
    """The motion of every row released from its start (rows, movers) [rad or m], at rest unless the laws say else.

    crisp: bristles for friction.  Raises Stuck where a pose does not close or the integrator gives up.
    """
    plant = Plant(linkage, laws, crisp)
    q = close(plant, starts, near)
    state = np.zeros((laws.rows, plant.width))
    state[:, : plant.n] = q
    if laws.has("release_rate"):
        state[:, plant.n : 2 * plant.n] = rates(plant, q)
    if plant.sloshes:
        _hang(plant, state)
    time_s = np.linspace(0, duration_s, round(duration_s / GRID_S) + 1)
    if crisp and (plant.bristles or laws.has(*TOUCHING)):
        return Motion(plant, time_s, _one_by_one(plant, laws, state, time_s, crisp, tolerance))
    return Motion(plant, time_s, _run(plant, state, time_s, "DOP853", tolerance))


def _hang(plant: Plant, state: np.ndarray) -> None:
    """Sloshing loads begin where they hang at rest."""
    laws, links = plant.laws, len(plant.linkage.links)
    p = turned(plant.tree, state[:, : plant.n], 0 * state[:, : plant.n]).place(plant.centres)
    sag = plant.gravity[:, None] / np.where(laws.slosh_rate > 0, laws.slosh_rate, 1.0) ** 2 * (laws.slosh > 0)
    x = p + sag
    state[:, -4 * links : -2 * links : 2], state[:, -4 * links + 1 : -2 * links : 2] = np.real(x), np.imag(x)


def _one_by_one(plant: Plant, laws: Laws, state: np.ndarray, time_s: np.ndarray, crisp: bool, tolerance: float):
    paths = []
    for row in range(laws.rows):
        alone = Laws({name: value[row : row + 1] for name, value in laws.numbers.items()})
        single = Plant(plant.linkage, alone, crisp) if laws.rows > 1 else plant
        if single.width != plant.width:
            raise Stuck(
                "rows with other loose pins or bristles than their neighbours; move them in batches of their own"
            )
        paths.append(_run(single, state[row : row + 1], time_s, "LSODA", max(tolerance, 1e-6))[0])
    return np.array(paths)


def _run(plant: Plant, state: np.ndarray, time_s: np.ndarray, method: str, tolerance: float) -> np.ndarray:
    shape = state.shape

    def slope(t: float, y: np.ndarray) -> np.ndarray:
        return plant.slope(t, y.reshape(shape)).ravel()

    exact = np.full(shape, 0.1 * tolerance)
    exact[:, 2 * plant.n : 2 * plant.n + plant.pins * plant.bristles] = BRISTLE_EXACT
    longest = 0.01 if method == "LSODA" or plant.laws.has(*TOUCHING) else 0.05  # s: a blow between would be missed
    # A singular pose ends in nonsense rates, which the check below names.
    with np.errstate(all="ignore"):
        try:
            run = solve_ivp(
                slope,
                (0.0, time_s[-1]),
                state.ravel(),
                method,
                time_s,
                rtol=tolerance,
                atol=exact.ravel(),
                max_step=longest,
            )
        except np.linalg.LinAlgError as error:
            raise Stuck(f"the {plant.linkage.family} runs into a pose without an answer") from error
    if not run.success or not np.isfinite(run.y).all():
        raise Stuck(f"the motion of the {plant.linkage.family} ends at {run.t[-1] if len(run.t) else 0:.3g} s")
    return np.moveaxis(run.y.reshape(*shape, -1), -1, 1)
