"""Intervals that allow for numbers nobody knows, of which only the range is.

A nuisance t runs from 0, where the fit was made, to 1, and moves the residual by t times its column.  With t free in
its range the end of the fit is a linear least-squares problem in a box, and the interval of a value holds all that some
t explains (profile likelihood): on one side wider by as far as the nuisance can move the value, unless the data say
where t lies.  Walls are far from linear: one secant over the whole range sees past the roughness of blows, one over as
much as the data do not rule out says what happens near 0.  An interval holds what either allows.

Where a motion forks, much of a column is a fork that no other motion shares, and data that lack it would seem to rule
the nuisance out.  So each is looked at twice, over a distance and over half of it: of what such two looks agree on the
data may speak, and only that share of the column is held against them (errors in variables, cf. Fuller 1987).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.optimize import brentq, lsq_linear

from backend.fit.identifiability import Z95
from backend.fit.solve import Solution

TOLD = 3.0  # deviations by which the data may tell the end of a secant from its beginning
SECANTS = 4  # tried at most


class Look(NamedTuple):
    """Change of the residual per whole range of a nuisance, over some of it and over half as much."""

    column: Float[np.ndarray, " n"]
    again: Float[np.ndarray, " n"]


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
) -> tuple[Look, Look] | None:
    """What a nuisance does, seen from far and from near; None if no motion is found.

    change: of the residual at a share of the range. doubt: how much less the data say for their misfit (sd / noise_sd).
    """
    root = np.sqrt(solution.weights)
    Q, _ = np.linalg.qr(root[:, None] * solution.jacobian)
    share, looks = 1.0, []
    for _ in range(SECANTS):
        D, half = change(share), change(0.5 * share)
        if np.all(np.isfinite(D)) and np.all(np.isfinite(half)):
            looks.append(Look(D / share, 2.0 * half / share))
            told = float(np.linalg.norm(root * D - Q @ (Q.T @ (root * D)))) / (TOLD * doubt)
            if told <= 1.0:
                break
            share *= float(np.clip(1.0 / told, 0.1, 0.7))
        else:
            share *= 0.1
    return (looks[0], looks[-1]) if looks else None


def answering(J: Float[np.ndarray, "n p"]) -> Float[np.ndarray, "p n"]:
    """How much lower least squares finds the values per unit by which a residual is higher; columns of any size."""
    norm = np.linalg.norm(J, axis=0)
    norm = np.where(norm > 0, norm, 1.0)
    return np.linalg.pinv(J / norm) / norm[:, None]


def allowing(
    solution: Solution, looks: Sequence[Look], sd: Float[np.ndarray, " p"], noise_sd: Float[np.ndarray, " p"]
) -> Allowance:
    """Intervals of the first values of a solution that allow for nuisances, of each a look.

    sd, noise_sd: of the values, with and without what misfit adds (see `identifiability`): by their ratio the data are
    taken to say less of a nuisance too.
    """
    root = np.sqrt(solution.weights)[:, None]
    J, r = root * solution.jacobian, root[:, 0] * solution.residual
    inverse = answering(J)
    views = [root * np.stack(view, 1) for view in zip(*looks, strict=True)]
    moved = [-inverse @ view for view in views]
    # What the values cannot make up for says where the nuisances are.
    beyond = [view + J @ shift for view, shift in zip(views, moved, strict=True)]
    Q, R = np.linalg.qr(0.5 * (beyond[0] + beyond[1]))
    left = Q.T @ (r - J @ (inverse @ r))
    seen = R * _shared(*beyond)
    best, at_best = _least(seen, -left)
    # By as much as the looks differ nobody knows how far a value moves.
    either = [
        [_ends(seen, left, best, shift[j] @ at_best, shift[j], sd[j], noise_sd[j]) for j in range(sd.size)]
        for shift in moved
    ]
    ends = np.stack([np.min(either, axis=0)[:, 0], np.max(either, axis=0)[:, 1]], 1)
    alone = np.array([_least(R[:, [k]], -left)[0] for k in range(R.shape[1])])
    own = float(left @ left)
    return Allowance(ends, moved[0][: sd.size], own - _least(R, -left)[0], own - alone)


def _shared(once: Float[np.ndarray, "n k"], twice: Float[np.ndarray, "n k"]) -> Float[np.ndarray, " k"]:
    """How much of the square of two looks' mean both bear out: all of it where they are alike."""
    square = np.sum((0.5 * (once + twice)) ** 2, axis=0)
    both = np.maximum(np.sum(once * twice, axis=0), 0.0)
    return np.minimum(both / np.where(square > 0.0, square, 1.0), 1.0)


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
