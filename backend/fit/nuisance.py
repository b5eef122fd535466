"""Intervals that allow for numbers nobody knows, of which only the range is.

A nuisance t runs from 0, where the fit was made, to 1, and moves the residual by t times its column.  With t free in
its range the end of the fit is a linear least-squares problem in a box, and the interval of a value holds all that some
t explains (profile likelihood): on one side wider by as far as the nuisance can move the value, unless the data say
where t lies.  Walls are far from linear: one secant over the whole range sees past the roughness of blows, one over as
much as the data do not rule out says what happens near 0.  An interval holds what either allows.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.optimize import brentq, lsq_linear

from backend.fit.identifiability import Z95
from backend.fit.solve import Solution

TOLD = 3.0  # deviations by which the data may tell the end of a secant from its beginning
SECANTS = 4  # tried at most


@dataclass(frozen=True)
class Allowance:
    """What nuisances (k) do to the first values (p) of a solution.

    ends: of the 95% interval of each value, from the value on; never inside that of noise and misfit alone. shift: how
    far a value moves when a nuisance goes through its range. gain: by how much chi-square falls at the best of all, and
    of each alone.
    """

    ends: Float[np.ndarray, "p 2"]
    shift: Float[np.ndarray, "p k"]
    gain: float
    gains: Float[np.ndarray, " k"]


def secants(
    change: Callable[[float], Float[np.ndarray, " n"]], solution: Solution, doubt: float
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]] | None:
    """Change of the residual per whole range of a nuisance, seen from far and from near; None if no motion is found.

    change: of the residual at a share of the range. doubt: how much less the data say for their misfit (sd / noise_sd).
    """
    root = np.sqrt(solution.weights)
    Q, _ = np.linalg.qr(root[:, None] * solution.jacobian)
    share, columns = 1.0, []
    for _ in range(SECANTS):
        D = change(share)
        if np.all(np.isfinite(D)):
            columns.append(D / share)
            told = float(np.linalg.norm(root * D - Q @ (Q.T @ (root * D)))) / (TOLD * doubt)
            if told <= 1.0:
                break
            share *= float(np.clip(1.0 / told, 0.1, 0.7))
        else:
            share *= 0.1
    return (columns[0], columns[-1]) if columns else None


def answering(J: Float[np.ndarray, "n p"]) -> Float[np.ndarray, "p n"]:
    """How much lower least squares finds the values per unit by which a residual is higher; columns of any size."""
    norm = np.linalg.norm(J, axis=0)
    norm = np.where(norm > 0, norm, 1.0)
    return np.linalg.pinv(J / norm) / norm[:, None]


def allowing(
    solution: Solution,
    columns: Float[np.ndarray, "n k"],
    sd: Float[np.ndarray, " p"],
    noise_sd: Float[np.ndarray, " p"],
) -> Allowance:
    """Intervals of the first values of a solution that allow for nuisances.

    columns: change of the residual as each goes from 0 to 1. sd, noise_sd: of the values, with and without what misfit
    adds (see `identifiability`): by their ratio the data are taken to say less of a nuisance too.
    """
    root = np.sqrt(solution.weights)[:, None]
    J, D, r = root * solution.jacobian, root * columns, root[:, 0] * solution.residual
    inverse = answering(J)
    moved = -inverse @ D
    # What the values cannot make up for says where the nuisances are.
    Q, R = np.linalg.qr(D + J @ moved)
    left = Q.T @ (r - J @ (inverse @ r))
    best, at_best = _least(R, -left)
    ends = [_ends(R, left, best, moved[j] @ at_best, moved[j], sd[j], noise_sd[j]) for j in range(sd.size)]
    alone = np.array([_least(R[:, [k]], -left)[0] for k in range(R.shape[1])])
    own = float(left @ left)
    return Allowance(np.array(ends), moved[: sd.size], own - best, own - alone)


def _ends(R, left, best: float, middle: float, shift: np.ndarray, sd: float, noise_sd: float) -> tuple[float, float]:
    own = Z95 * sd
    if not (np.isfinite(own) and noise_sd > 0):
        return -np.inf, np.inf
    allowed = best + (own / noise_sd) ** 2

    def beyond(times: float) -> float:
        A = np.vstack([R, -shift / noise_sd])
        return _least(A, np.append(-left, -times * own / noise_sd))[0] - allowed

    start = middle / own
    reach = float(np.abs(shift).sum()) / own + 2.0  # past all nuisances and twice the noise: surely outside
    low, high = (own * float(brentq(beyond, start, start + side * reach)) for side in (-1, 1))  # type: ignore[arg-type]
    return min(low, -own), max(high, own)


def _least(A: Float[np.ndarray, "m k"], y: Float[np.ndarray, " m"]) -> tuple[float, Float[np.ndarray, " k"]]:
    """min |A t - y|^2 for t between 0 and 1, and where."""
    found = lsq_linear(A, y, (0.0, 1.0), method="bvls")
    return 2.0 * float(found.cost), found.x
