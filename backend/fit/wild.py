"""Single wild samples: a glint taken for the dot, two dots swapped for a frame.

One of them throws least squares off by a share of however far it lies, and by the more the nearer it stands to an end,
where a start is read off. Reweighting by residuals does not help there: near an end the curve runs through the sample.
So samples are left out one by one, and judged by the curve through the others (deletion residuals, Cook and Weisberg
1982, 2.2). Where none is wild, nothing is left out, and a clean start is what it was.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

WILD = 10.0  # times what the others miss by: noise never goes so far, and the misfit of a smooth motion neither
SHARE, MOST = 0.1, 20  # of the samples that may be wild: where more stand out, they tell of the motion


def agreeing(
    A: Float[np.ndarray, "n k"], b: Float[np.ndarray, " n"], noise: float
) -> Bool[np.ndarray, " n"]:  # fmt: skip
    """Rows of the least-squares problem A x = b that are not wild.

    noise: what a row misses by at least, however well the others agree.
    """
    kept = np.ones(b.size, bool)
    for _ in range(min(int(SHARE * b.size), MOST)):
        Q, R = np.linalg.qr(A[kept])
        if np.min(np.abs(np.diag(R))) <= 1e-12 * np.max(np.abs(R)):
            break  # the others say nothing about one of them
        miss, lever = b[kept] - Q @ (Q.T @ b[kept]), 1.0 - np.sum(Q**2, axis=1)
        worst = np.argmax(miss**2 / np.maximum(lever, 1e-12))
        kept[np.flatnonzero(kept)[worst]] = False
        if _all_wild(A, b, kept, noise):
            return kept
    return np.ones(b.size, bool)


def _all_wild(A: np.ndarray, b: np.ndarray, kept: np.ndarray, noise: float) -> bool:
    """Whether each that is left out stands alone, far from where the others foretell it."""
    if np.any(np.diff(np.flatnonzero(~kept)) == 1):
        return False  # neighbours that stray together follow a motion
    Q, R = np.linalg.qr(A[kept])
    miss = b - A @ np.linalg.solve(R, Q.T @ b[kept])
    rest = np.sqrt(np.sum(miss[kept] ** 2) / max(int(kept.sum()) - A.shape[1], 1))
    doubt = np.sqrt(1.0 + np.sum(np.linalg.solve(R.T, A[~kept].T) ** 2, axis=0))
    return bool(np.all(np.abs(miss[~kept]) > WILD * doubt * max(rest, noise)))
