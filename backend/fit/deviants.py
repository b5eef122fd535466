"""Which of many values that should be alike are not: an L1 penalty on deviations, its weight set by the noise.

With theta_j = s + d_j the fit is linearised, everything that is not a deviation (s, other parameters, starts) is
projected out, and

    minimise  1/2 |y - X d|^2 + sigma sqrt(2 log p) sum_j |X_j| |d_j|

(Tibshirani 1996; universal threshold, Donoho and Johnstone 1994) with sigma, the misfit that is left, found along
(Sun and Zhang 2012). What survives is fitted again without a penalty, and dropped, weakest first, until each
deviation stands out of its own scatter, with the memory of the residuals counted (see `misfit`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.stats import chi2, norm

from backend.fit.misfit import misfit_covariance

FALSE_NAMES = 0.01  # fits without any deviation that name one
ELSEWHERE = float(chi2.ppf(0.99, 1))  # deviance by which another place must be worse to be ruled out
SEEN = 1e-6  # share of a column that is left when what is common to all is taken away; less is rounding


@dataclass(frozen=True)
class Linearised:
    """Whitened residuals and the columns of p deviations, all else projected out; run, instant as in `misfit`.

    known: deviations at which r was taken.
    """

    r: Float[np.ndarray, " n"]
    X: Float[np.ndarray, "n p"]
    known: Float[np.ndarray, " p"]
    run: Int[np.ndarray, " n"]
    instant: Int[np.ndarray, " n"]

    @property
    def y(self) -> Float[np.ndarray, " n"]:
        """What the deviations have to explain."""
        return self.X @ self.known - self.r


@dataclass(frozen=True)
class Deviants:
    """Columns that deviate; for each, those that explain the data as well; and the least of any that would show."""

    apart: tuple[int, ...]
    instead: dict[int, tuple[int, ...]]
    least: Float[np.ndarray, " p"]


def projected(
    r: Float[np.ndarray, " n"],
    deviations: Float[np.ndarray, "n p"],
    common: Float[np.ndarray, "n c"],
    known: Float[np.ndarray, " p"],
    run: Int[np.ndarray, " n"],
    instant: Int[np.ndarray, " n"],
) -> Linearised:
    """Take what the common columns can explain out of residuals and deviations."""
    size = np.linalg.norm(common, axis=0)
    U, s, _ = np.linalg.svd(common[:, size > 0] / size[size > 0], full_matrices=False)
    U = U[:, s > SEEN * s.max(initial=0.0)]
    X = deviations - U @ (U.T @ deviations)
    X[:, np.linalg.norm(X, axis=0) < SEEN * np.linalg.norm(deviations, axis=0)] = 0.0
    return Linearised(r - U @ (U.T @ r), X, known, run, instant)


def deviants(seen: Linearised, floor: float) -> Deviants:
    """Name the deviations. floor: of the noise level, in units of r, below which no residual is believed."""
    size = np.linalg.norm(seen.X, axis=0)
    heard = np.flatnonzero(size > 0)
    least = np.full(size.size, np.inf)
    if heard.size == 0:
        return Deviants((), {}, least)
    unit, y, p = seen.X[:, heard] / size[heard], seen.y, heard.size
    stands_out = float(norm.isf(FALSE_NAMES / (2 * p)))
    kept = [int(k) for k in np.flatnonzero(_scaled_lasso(unit, y, seen.run >= 0, floor))]
    # More deviations than half of the places are not deviations from what is shared.
    kept = sorted(kept, key=lambda k: -abs(unit[:, k] @ y))[: max(p // 2, 1)]
    kept = _standing_out(unit, y, kept, seen, floor, stands_out)
    # Of columns much alike the penalty takes any: exchange each for the one that explains most.
    kept = _standing_out(unit, y, _exchanged(unit, y, kept), seen, floor, stands_out)
    for k in range(p):
        _, sd = _refitted(unit, y, [*(j for j in kept if j != k), k], seen, floor)
        least[heard[k]] = stands_out * sd[-1] / size[heard[k]]
    instead = {int(heard[k]): tuple(int(heard[j]) for j in _as_good(unit, y, kept, k, seen, floor)) for k in kept}
    return Deviants(tuple(sorted(instead)), instead, least)


def _scaled_lasso(
    unit: Float[np.ndarray, "n p"], y: Float[np.ndarray, " n"], data: np.ndarray, floor: float
) -> Float[np.ndarray, " p"]:
    """Penalised deviations in whitened units, with the noise level of what they leave."""
    G, c, d = unit.T @ unit, unit.T @ y, np.zeros(unit.shape[1])
    weight = np.sqrt(2.0 * np.log(max(d.size, 2)))
    sigma = np.inf
    for _ in range(20):
        left = max(float(np.sqrt(np.mean((y - unit @ d)[data] ** 2))), floor)
        if left > 0.99 * sigma:
            break
        sigma = left
        d = lasso(G, c, weight * sigma, d)
    return d


def lasso(
    G: Float[np.ndarray, "p p"], c: Float[np.ndarray, " p"], weight: float, start: Float[np.ndarray, " p"]
) -> Float[np.ndarray, " p"]:
    """argmin d'Gd/2 - c'd + weight |d|_1 by coordinate descent (Friedman et al. 2007); G has ones on its diagonal."""
    d = start.copy()
    for _ in range(10_000):
        moved = 0.0
        for k in range(d.size):
            pull = c[k] - G[k] @ d + d[k]
            new = np.sign(pull) * max(abs(pull) - weight, 0.0)
            moved, d[k] = max(moved, abs(new - d[k])), new
        if moved <= 1e-6 * weight:
            break
    return d


def _refitted(
    unit: np.ndarray, y: np.ndarray, kept: Sequence[int], seen: Linearised, floor: float
) -> tuple[np.ndarray, np.ndarray]:
    """Deviations without a penalty, and how far they scatter; infinite where they cannot be told apart."""
    A = unit[:, list(kept)]
    normal = A.T @ A
    if np.linalg.eigvalsh(normal)[0] < SEEN:
        return np.zeros(len(kept)), np.full(len(kept), np.inf)
    inverse = np.linalg.inv(normal)
    d = inverse @ (A.T @ y)
    C = misfit_covariance(A / floor, (y - A @ d) / floor, seen.run, seen.instant, floor**2 * inverse)
    return d, np.sqrt(np.diag(C))


def _standing_out(
    unit: np.ndarray, y: np.ndarray, kept: list[int], seen: Linearised, floor: float, stands_out: float
) -> list[int]:
    """Drop the weakest deviation until each is this many of its standard deviations."""
    kept = list(kept)
    while kept:
        d, sd = _refitted(unit, y, kept, seen, floor)
        weakest = int(np.argmin(np.abs(d) / sd))
        if abs(d[weakest]) >= stands_out * sd[weakest]:
            break
        kept.pop(weakest)
    return kept


def _exchanged(unit: np.ndarray, y: np.ndarray, kept: Sequence[int]) -> list[int]:
    """As many columns, none of which another could replace and leave less."""
    kept = list(kept)
    least = _left(unit, y, kept)[0] if kept else 0.0
    for _ in range(unit.shape[1]):
        trials = [
            [*kept[:i], j, *kept[i + 1 :]] for i in range(len(kept)) for j in range(unit.shape[1]) if j not in kept
        ]
        left = [_left(unit, y, trial)[0] for trial in trials]
        if not left or min(left) >= least * (1.0 - 1e-9):
            break
        kept, least = trials[int(np.argmin(left))], min(left)
    return kept


def _as_good(unit: np.ndarray, y: np.ndarray, kept: Sequence[int], k: int, seen: Linearised, floor: float) -> list[int]:
    """Other columns that, in place of column k, explain the data no worse than chance allows."""
    _, sd = _refitted(unit, y, kept, seen, floor)
    best, plain = _left(unit, y, kept)
    alone = np.sqrt(np.diag(plain))[list(kept).index(k)]
    inflation = (sd[list(kept).index(k)] / alone) ** 2
    rest = [j for j in kept if j != k]
    others = (j for j in range(unit.shape[1]) if j not in kept)
    return [j for j in others if (_left(unit, y, [*rest, j])[0] - best) / inflation < ELSEWHERE]


def _left(unit: np.ndarray, y: np.ndarray, kept: Sequence[int]) -> tuple[float, np.ndarray]:
    """Sum of squares that these columns leave, and their covariance for a noise of 1."""
    A = unit[:, list(kept)]
    inverse = np.linalg.pinv(A.T @ A)
    return float(y @ y - (A.T @ y) @ inverse @ (A.T @ y)), inverse
