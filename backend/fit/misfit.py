"""Covariance that sees misfit: what the residuals say about the estimate, not what the noise promised.

A model that misses by thirty sigmas still has a tiny noise-only covariance. Here the residuals themselves are
the evidence. The sandwich  F^-1 S F^-1  takes S, the covariance of the score sum_t J_t' r_t, from the scores
seen in time, with their correlation (Newey and West 1987; bandwidth and prewhitening after Andrews 1991 and
Andrews and Monahan 1992). Channels at one instant are summed first, so misfit common to many markers counts
once. The result is never smaller than the noise-only covariance in any direction.

So `sd` means: how far the estimate would scatter if the experiments were repeated with residuals of this size
and this memory. Misfit that is the same in every repetition (a wrong law) biases beyond it; nothing in one
set of residuals can tell how far.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from backend.fit.noise import lag_one

MEMORY = 0.97  # prewhitening coefficients beyond this explode the recolouring (Andrews and Monahan 1992)


def misfit_covariance(
    J: Float[np.ndarray, "n p"],
    r: Float[np.ndarray, " n"],
    run: Int[np.ndarray, " n"],
    instant: Int[np.ndarray, " n"],
    noise_only: Float[np.ndarray, "p p"],
) -> Float[np.ndarray, "p p"]:
    """Noise-only covariance, inflated where the residuals ask.

    run: which experiment a row belongs to, -1 for a prior (taken at its word). instant: order in time;
    rows of one run with one instant are summed. noise_only: (J'J + priors)^-1.
    """
    p, data = J.shape[1], run >= 0
    S, independent = np.zeros((p, p)), 0.0
    for label in np.unique(run[data]):
        rows = run == label
        scores = _scores(J[rows], r[rows], instant[rows])
        S = S + long_run_covariance(scores)
        independent += _independent(r[rows])
    # Fitting p parameters used up as many of the residuals' independent pieces.
    S = S * min(independent / max(independent - p, 1.0), 4.0) + J[~data].T @ J[~data]
    count = int(data.sum())
    white = max(float(r[data] @ r[data]) / max(count - p, 1), 1.0) * noise_only
    return largest(white, noise_only @ S @ noise_only)


def _independent(r: Float[np.ndarray, " n"]) -> float:
    """Number of independent samples in an AR(1) series (Bartlett 1935)."""
    a = max(lag_one(r), 0.0)
    return r.size * (1.0 - a) / (1.0 + a)


def _scores(J, r, instant) -> Float[np.ndarray, "t p"]:
    """J_t' r_t summed over the channels of each instant, in time order."""
    _, slot = np.unique(instant, return_inverse=True)
    scores = np.zeros((slot.max() + 1, J.shape[1]))
    np.add.at(scores, slot, J * r[:, None])
    return scores


def long_run_covariance(u: Float[np.ndarray, "t p"]) -> Float[np.ndarray, "p p"]:
    """Covariance of the sum of a correlated zero-mean series: t times its spectral density at zero."""
    T = u.shape[0]
    if T < 4:
        return u.T @ u
    power = np.sum(u[:-1] ** 2, axis=0)
    a = np.clip(np.sum(u[1:] * u[:-1], axis=0) / np.where(power > 0, power, 1.0), -MEMORY, MEMORY)
    e = u[1:] - a * u[:-1]
    bandwidth = _bandwidth(e)
    S = e.T @ e
    for lag in range(1, bandwidth + 1):
        G = e[lag:].T @ e[:-lag]
        S = S + (1.0 - lag / (bandwidth + 1.0)) * (G + G.T)
    recolour = 1.0 / (1.0 - a)
    return S * recolour[:, None] * recolour[None, :]


def _bandwidth(e: Float[np.ndarray, "t p"]) -> int:
    """Andrews' (1991, eq. 6.2 and 6.4) Bartlett bandwidth with AR(1) plug-ins, each column weighing alike."""
    T = e.shape[0]
    power = np.sum(e[:-1] ** 2, axis=0)
    a = np.clip(np.sum(e[1:] * e[:-1], axis=0) / np.where(power > 0, power, 1.0), -MEMORY, MEMORY)
    weight = 1.0 / (1.0 - a) ** 4
    alpha = np.mean(4.0 * a**2 / (1.0 - a) ** 6 / (1.0 + a) ** 2) / np.mean(weight)
    return int(min(np.ceil(1.1447 * (alpha * T) ** (1.0 / 3.0)), T // 4))


def largest(A: Float[np.ndarray, "p p"], B: Float[np.ndarray, "p p"]) -> Float[np.ndarray, "p p"]:
    """Smallest inflation of A that is at least B along B's eigenvectors in A's metric, whatever the units of rows."""
    D = np.sqrt(np.maximum(np.diag(A), np.diag(B)))  # metres beside N/m: what is small would drown in rounding
    D = np.where(D > 0.0, D, 1.0)
    w, V = np.linalg.eigh(A / np.outer(D, D))
    w = np.maximum(w, 1e-14 * max(w.max(), 1e-300))
    half, inverse = V * np.sqrt(w), V / np.sqrt(w)
    ratio, U = np.linalg.eigh(inverse.T @ (B / np.outer(D, D)) @ inverse)
    C = D[:, None] * (half @ U)
    return (C * np.maximum(ratio, 1.0)) @ C.T
