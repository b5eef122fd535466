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
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int
from scipy.stats import chi2, norm

from backend.fit.misfit import misfit_covariance

FALSE_NAMES = 0.01  # fits without any deviation that name one
ELSEWHERE = float(chi2.ppf(0.99, 1))  # deviance by which another place must be worse to be ruled out
TIE = 1.0  # of deviance, for which no other names are tried
SEEN = 1e-4  # share of a column that is left when what is common to all is taken away; less is the solver's noise
ROOM = 0.5  # of the shared value, by which a linear estimate may lie beyond a bound that the value itself keeps


@dataclass(frozen=True)
class Linearised:
    """Whitened residuals and the columns of p deviations, all else projected out; run, instant as in `misfit`.

    known: deviations at which r was taken, values: the values there; moves: how all values move with each deviation,
    since what is shared gives way. lower, upper: of the values.
    """

    r: Float[np.ndarray, " n"]
    X: Float[np.ndarray, "n p"]
    known: Float[np.ndarray, " p"]
    values: Float[np.ndarray, " p"]
    moves: Float[np.ndarray, "p p"]
    lower: Float[np.ndarray, " p"]
    upper: Float[np.ndarray, " p"]
    run: Int[np.ndarray, " n"]
    instant: Int[np.ndarray, " n"]

    @property
    def y(self) -> Float[np.ndarray, " n"]:
        """What the deviations have to explain."""
        return self.X @ self.known - self.r

    def then(self, d: Float[np.ndarray, " p"]) -> Float[np.ndarray, " p"]:
        """All values, by a linear estimate, where these are the deviations."""
        return self.values + self.moves @ (d - self.known)

    def possible(self, d: Float[np.ndarray, " p"]) -> bool:
        """Whether these deviations leave every value within its bounds, as far as a linear estimate can say."""
        then = self.then(d)
        room = ROOM * np.abs(self.values - self.known)
        return bool(np.all(then >= self.lower - room) and np.all(then <= self.upper + room))


@dataclass(frozen=True)
class Deviants:
    """Columns that deviate; for each, those that explain the data as well; the least of any that would show; where all
    values would be then, by a linear estimate; and the sum of squares that each must take away to stand out.
    """

    apart: tuple[int, ...]
    instead: dict[int, tuple[int, ...]]
    least: Float[np.ndarray, " p"]
    values: Float[np.ndarray, " p"]
    due: dict[int, float] = field(default_factory=dict)


def projected(
    r: Float[np.ndarray, " n"],
    deviations: Float[np.ndarray, "n p"],
    group: Int[np.ndarray, " p"],
    others: Float[np.ndarray, "n c"],
    known: Float[np.ndarray, " p"],
    values: Float[np.ndarray, " p"],
    bounds: tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"]],
    run: Int[np.ndarray, " n"],
    instant: Int[np.ndarray, " n"],
) -> Linearised:
    """Take what the shared value of each group, and the other columns, can explain out of residuals and deviations."""
    groups = np.unique(group)
    common = np.column_stack([*(deviations[:, group == g].sum(1) for g in groups), others])
    size = np.linalg.norm(common, axis=0)
    size = np.where(size > 0, size, 1.0)
    U, s, Vt = np.linalg.svd(common / size, full_matrices=False)
    keep = s > 1e-10 * s.max(initial=0.0)
    U, s, Vt = U[:, keep], s[keep], Vt[keep]
    explained = U.T @ deviations
    X = deviations - U @ explained
    X[:, np.linalg.norm(X, axis=0) < SEEN * np.linalg.norm(deviations, axis=0)] = 0.0
    gives_way = ((Vt.T / s) @ explained / size[:, None])[np.searchsorted(groups, group)]
    moves = np.eye(group.size) - gives_way
    return Linearised(r - U @ (U.T @ r), X, known, values, moves, *bounds, run, instant)


def deviants(seen: Linearised, floor: float, before: Sequence[int] = ()) -> Deviants:
    """Name the deviations.

    floor: of the noise level, in units of r, below which no residual is believed. before: names that stay where
    others are no better.
    """
    size = np.linalg.norm(seen.X, axis=0)
    heard = np.flatnonzero(size > 0)
    least = np.full(size.size, np.inf)
    if heard.size == 0:
        return Deviants((), {}, least, seen.values)
    choice = _Choice(seen, heard, size[heard], seen.X[:, heard] / size[heard], seen.y, floor)
    d = _scaled_lasso(choice.unit, choice.y, seen.run >= 0, floor)
    # More deviations than half of the places are not deviations from what is shared.
    kept = sorted(np.flatnonzero(d).tolist(), key=lambda k: -abs(choice.unit[:, k] @ choice.y))
    kept = choice.standing_out(kept[: max(heard.size // 2, 1)])
    # Of columns much alike the penalty takes any: exchange each for the one that explains most.
    kept = choice.standing_out(choice.exchanged(kept))
    stay = [k for k, i in enumerate(heard) if i in before]
    if len(stay) == len(kept) and choice.left(stay) - choice.left(kept) < TIE:
        kept = stay
    if not np.isfinite(choice.left(kept)):
        kept = []
    for k in range(heard.size):
        _, sd = choice.refitted([*(j for j in kept if j != k), k])
        least[heard[k]] = choice.stands_out * sd[-1] / size[heard[k]]
    instead = {int(heard[k]): tuple(int(heard[j]) for j in choice.as_good(kept, k)) for k in kept}
    due = {int(heard[k]): choice.stands_out**2 * choice.inflation(kept, k) for k in kept}
    return Deviants(tuple(sorted(instead)), instead, least, seen.then(choice.deviations(kept)), due)


@dataclass(frozen=True)
class _Choice:
    """Sets of columns (indices into those heard) weighed against each other; unit columns have length 1."""

    seen: Linearised
    heard: Int[np.ndarray, " h"]
    size: Float[np.ndarray, " h"]
    unit: Float[np.ndarray, "n h"]
    y: Float[np.ndarray, " n"]
    floor: float

    @property
    def stands_out(self) -> float:
        """Standard deviations that a deviation needs to be named, among so many that could be."""
        return float(norm.isf(FALSE_NAMES / (2 * self.heard.size)))

    def refitted(self, kept: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
        """Deviations without a penalty, and how far they scatter; infinite where they cannot be told apart."""
        A, f = self.unit[:, list(kept)], self.floor
        normal = A.T @ A
        if np.linalg.eigvalsh(normal)[0] < SEEN**2:
            return np.zeros(len(kept)), np.full(len(kept), np.inf)
        inverse = np.linalg.inv(normal)
        d = inverse @ (A.T @ self.y)
        C = misfit_covariance(A / f, (self.y - A @ d) / f, self.seen.run, self.seen.instant, f**2 * inverse)
        return d, np.sqrt(np.diag(C))

    def standing_out(self, kept: Sequence[int]) -> list[int]:
        """Drop the weakest deviation until each is far enough from zero."""
        kept = list(kept)
        while kept:
            d, sd = self.refitted(kept)
            weakest = int(np.argmin(np.abs(d) / sd))
            if abs(d[weakest]) >= self.stands_out * sd[weakest]:
                break
            kept.pop(weakest)
        return kept

    def left(self, kept: Sequence[int]) -> float:
        """Sum of squares that these columns leave; infinite where a value would have to leave its bounds."""
        d = self.deviations(kept)
        return float(np.sum((self.y - self.seen.X @ d) ** 2)) if not kept or self.seen.possible(d) else np.inf

    def deviations(self, kept: Sequence[int]) -> np.ndarray:
        """Of every column, where these alone deviate, without a penalty."""
        A = self.unit[:, list(kept)]
        every = np.zeros(self.seen.known.size)
        every[self.heard[list(kept)]] = np.linalg.pinv(A.T @ A) @ (A.T @ self.y) / self.size[list(kept)]
        return every

    def exchanged(self, kept: Sequence[int]) -> list[int]:
        """As many columns, none of which another could replace and leave less."""
        kept, least = list(kept), self.left(kept)
        for _ in range(self.heard.size):
            rest = [j for j in range(self.heard.size) if j not in kept]
            trials = [[*kept[:i], j, *kept[i + 1 :]] for i in range(len(kept)) for j in rest]
            left = [self.left(trial) for trial in trials]
            if not left or min(left) >= least * (1.0 - 1e-9):
                break
            kept, least = trials[int(np.argmin(left))], min(left)
        return kept

    def inflation(self, kept: Sequence[int], k: int) -> float:
        """Scatter of deviation k, of these, by that of white noise of 1; of variances."""
        at, A = list(kept).index(k), self.unit[:, list(kept)]
        return float(self.refitted(kept)[1][at] ** 2 / np.linalg.inv(A.T @ A)[at, at])

    def as_good(self, kept: Sequence[int], k: int) -> list[int]:
        """Other columns that, in place of column k, explain the data no worse than chance allows."""
        best, inflation = self.left(kept), self.inflation(kept, k)
        rest, others = [j for j in kept if j != k], (j for j in range(self.heard.size) if j not in kept)
        return [j for j in others if (self.left([*rest, j]) - best) / inflation < ELSEWHERE]


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
    pull = c - G @ d + d
    for _ in range(10_000):
        moved = 0.0
        for k in np.flatnonzero((np.abs(pull) > weight) | (d != 0.0)):  # the others stay at nothing
            new = np.sign(pull[k]) * max(abs(pull[k]) - weight, 0.0)
            step, d[k] = new - d[k], new
            moved = max(moved, abs(step))
            pull -= step * G[k]
            pull[k] += step
        if moved <= 1e-6 * weight:
            break
    return d
