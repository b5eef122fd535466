"""What a cause leaves on experiments that it was not fitted to.

The values stay where the fit left them, as uncertain as it said; each start is what the record itself allows. What is
then left must be noise: no smooth shift of any marker, and no smooth path of any encoder, may explain it. And of two
causes that the fitted experiments cannot tell apart, the one that foretells these better is the likelier.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.linalg import block_diag
from scipy.stats import chi2

from backend.diagnose.fitted import Fitted
from backend.diagnose.latent import ALONE, moving_bumps
from backend.diagnose.noise import Whitening, strays
from backend.diagnose.probe import Probe

ROUNDS = 3  # of Gauss-Newton for a start
RANK = 1e-7  # of the largest eigenvalue


@dataclass(frozen=True)
class Left:
    """What is left on held-out experiments. p: of as much from noise alone. excess: power of what smooth shifts still
    explain [variances of the noise as it was believed, per sample].
    """

    p: float
    excess: float


@dataclass(frozen=True)
class Unseen:
    """All held-out experiments, whitened: what a cause misses, and slopes in its values (in units of what the fit
    leaves uncertain), in the starts and in smooth shifts of what was measured.
    """

    r: Float[np.ndarray, " n"]
    values: Float[np.ndarray, "n few"]
    starts: Float[np.ndarray, "n own"]
    shapes: Float[np.ndarray, "n shapes"]

    def rescaled(self, scale: float) -> Unseen:
        """The same, had all sigmas been larger by `scale`; the values are then as much more uncertain."""
        return replace(self, r=self.r / scale, starts=self.starts / scale, shapes=self.shapes / scale)

    def left(self) -> Left:
        """Whether anything smooth is left."""
        good = ~strays(self.unexplained())
        own, L = np.concatenate([self.values, self.starts], 1)[good], self.shapes[good]
        return _judged(self.r[good], own, self._precision, L)

    @property
    def _precision(self) -> Float[np.ndarray, " own"]:
        """The values have a prior (of unit precision), the starts have none."""
        return np.concatenate([np.ones(self.values.shape[1]), np.zeros(self.starts.shape[1])])

    def unexplained(self) -> Float[np.ndarray, " n"]:
        """What values, starts and smooth shifts leave of every row, in deviations of what noise would be left."""
        A = np.concatenate([self.values, self.starts, self.shapes], 1)
        prior = np.concatenate([self._precision, np.zeros(self.shapes.shape[1])])
        H = np.linalg.pinv(A.T @ A + np.diag(prior), rcond=RANK, hermitian=True)
        noise = np.maximum(1.0 - np.sum((A @ H) * A, 1), ALONE)  # power of what it leaves in each row
        return (self.r - A @ (H @ (A.T @ self.r))) / np.sqrt(noise)

    def log_density(self) -> float:
        """Of the measured, foretold from the fitted experiments; up to a constant that all causes share."""
        Q, size, _ = np.linalg.svd(self.starts, full_matrices=False)
        Q = Q[:, size > np.sqrt(RANK) * size.max(initial=0.0)]
        r, V = (x - Q @ (Q.T @ x) for x in (self.r, self.values))
        H, b = np.eye(V.shape[1]) + V.T @ V, V.T @ r
        return float(-0.5 * (r @ r - b @ np.linalg.solve(H, b)) - 0.5 * np.linalg.slogdet(H)[1])


def unseen(fitted: Fitted) -> Unseen | None:
    """Of a fit's held-out experiments, of which there is at least one; None where it loses the motion of one."""
    subject, few = fitted.subject, fitted.count

    def one(i: int) -> tuple[np.ndarray, ...] | None:
        probe = subject.chosen(subject.held_out[i], fitted.choice)
        white = subject.held_noise.whitening(probe.data, i)
        white = white if probe.lying is None else white.beside(probe.lying)
        own = _start(probe, white, fitted.values)
        seen, slope = probe.predict(fitted.values, own)
        if not np.all(np.isfinite(seen[white.keep])):
            return None
        J = white(slope)
        return white(probe.data.value - seen), J[:, :few], J[:, few:], _shapes(probe, white)

    made = subject.over(one, range(len(subject.held_out)))
    if any(m is None for m in made):
        return None
    r, values, starts, shapes = zip(*(m for m in made if m is not None), strict=True)
    own, shifts = np.asarray(block_diag(*starts)), np.asarray(block_diag(*shapes))
    return Unseen(np.concatenate(r), _columns(fitted, values), own, shifts)


def _start(probe: Probe, white: Whitening, values: np.ndarray) -> np.ndarray:
    own = probe.settle(values)
    lower, upper = probe.bounds()
    for _ in range(ROUNDS if own.size else 0):
        seen, slope = probe.predict(values, own)
        r = np.clip(np.nan_to_num(white(probe.data.value - seen)), -10.0, 10.0)
        step = np.linalg.lstsq(white(np.nan_to_num(slope))[:, values.size :], r, rcond=1e-12)[0]
        own = np.clip(own + step, lower, upper)
    return own


def _columns(fitted: Fitted, slopes: Sequence[np.ndarray]) -> Float[np.ndarray, "n few"]:
    """Slopes in the values, in units of what the fit leaves uncertain."""
    few = fitted.count
    w, V = np.linalg.eigh(fitted.covariance[:few, :few])
    return np.concatenate(slopes) @ (V * np.sqrt(np.maximum(w, 0.0)))


def _shapes(probe: Probe, white: Whitening) -> Float[np.ndarray, "n shapes"]:
    shape = moving_bumps(probe)
    each = [white(shape * (probe.data.channel == c)[:, None]) for c in range(len(probe.data.channels))]
    L = np.concatenate(each, 1)
    return L[:, np.linalg.norm(L, axis=0) > 1e-9 * max(float(np.linalg.norm(L)), 1e-300)]


def _judged(r: np.ndarray, own: np.ndarray, precision: np.ndarray, L: np.ndarray) -> Left:
    """What smooth shifts L take away beside values and starts."""
    A, prior = np.concatenate([own, L], 1), np.concatenate([precision, np.zeros(L.shape[1])])
    every, most = _explained(r, A, prior), _explained(r, own, precision)
    free = max(every[1] - most[1], 1.0)
    noise = max((float(r @ r) - every[0]) / max(r.size - every[1], 1.0), 1.0)
    gain = (every[0] - most[0]) / noise
    return Left(float(chi2.sf(gain, free)), float(gain - free) * noise / r.size)


def _explained(r: np.ndarray, A: np.ndarray, prior: np.ndarray) -> tuple[float, float]:
    """Sum of squares that columns take away, and how many they are worth."""
    G = A.T @ A
    H = np.linalg.pinv(G + np.diag(prior), rcond=RANK, hermitian=True)
    b = A.T @ r
    return float(b @ H @ b), float(np.trace(H @ G))
