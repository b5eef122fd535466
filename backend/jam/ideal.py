"""What a frictionless, clearance-free copy would do in the same pose: whether it would accelerate, and how freely.

At rest the accelerations of rigid bodies are those nearest to free flight that the joints allow (Gauss 1829): in
freedoms of the closed mechanism, the projection of M⁻¹F onto them; where ends of travel or other links are touched, its
nonnegative least squares (Moreau 1966).  The lever is how much of the drive is left, 0 where joints carry all of it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.optimize import nnls

from backend.jam.statics import Contacts, Statics
from backend.simulate.spectrum import rank, singular_values

LEVER = 1e-4  # share of the drive below which it has no lever: 0.006 degrees from a dead centre
PUSH = 1e-3  # mechanism lengths or rad: a small push off a dead centre


@dataclass(frozen=True)
class Ideal:
    """acceleration: of the freedoms.  free: closed ways to move, columns.  push: of each contact.

    lever: from 0 to 1.
    """

    acceleration: Float[np.ndarray, "freedoms"]
    free: Float[np.ndarray, "freedoms ways"]
    lever: float
    push: Float[np.ndarray, "places"]

    @property
    def moves(self) -> bool:
        """Whether it would accelerate."""
        return self.lever > LEVER


def ideal(at: Statics, contacts: Contacts | None = None) -> Ideal:
    """Accelerations from rest without friction; contacts: ends and links that push back, none by default."""
    values = singular_values(at.held)
    free = np.eye(at.mass.shape[0])
    if at.held.size:
        free = np.linalg.svd(at.held, full_matrices=True)[2][rank(values) :].T
    loose = _norm_dual(at.mass, at.load)
    push = np.zeros(len(contacts.opens) if contacts else 0)
    if free.shape[1] == 0 or loose == 0.0:
        return Ideal(np.zeros(at.mass.shape[0]), free, 0.0, push)
    root = np.linalg.cholesky(free.T @ at.mass @ free)
    asked = np.linalg.solve(root, free.T @ at.load)
    if contacts is not None and contacts.opens.size:
        pushes = np.linalg.solve(root, free.T @ contacts.opens.T)
        push, _ = nnls(pushes, -asked)
        asked = asked + pushes @ push
    acceleration = free @ np.linalg.solve(root.T, asked)
    return Ideal(acceleration, free, float(np.linalg.norm(asked)) / loose, push)


def runs_away(at: Statics, displaced: Callable[[np.ndarray], Statics]) -> bool:
    """Whether a small push off an equilibrium grows in the ideal copy.

    displaced(x): the statics of the closed pose that is x (freedoms) away.
    """
    here = ideal(at)
    ways = here.free.shape[1]
    growth = np.zeros((ways, ways))
    for way in range(ways):
        x = PUSH * here.free[:, way] / np.abs(here.free[:, way]).max()
        size = float(x @ here.free[:, way])
        ahead, behind = (ideal(displaced(sign * x)).acceleration for sign in (1.0, -1.0))
        growth[:, way] = here.free.T @ (ahead - behind) / (2.0 * size)
    scale = _norm_dual(at.mass, at.load) / np.sqrt(np.trace(at.mass))
    return bool(ways) and float(np.linalg.eigvals(growth).real.max()) > LEVER * scale


def _norm_dual(mass: np.ndarray, force: np.ndarray) -> float:
    """√(Fᵀ M⁻¹ F): how hard the loads would throw the bodies if nothing held them."""
    return float(np.sqrt(force @ np.linalg.solve(mass, force)))
