"""How far a cause's numbers may be off where its form is wrong.

A fit of a wrong law by least squares follows what is slow in a record, because a force's error adds up there; where
something unknown may take what is slow, the same law is read from what is fast.  How far the two readings lie apart
tells what the wrong form leaves open (Hausman 1978), beside what the second one leaves uncertain:

    r ~ N(J x + L a, τ²/ν I),  a ~ N(0, s² I)

L a is the discrepancy of Kennedy and O'Hagan (2001), once a force against time at every joint, once a law of a few
terms there and in the picture; s and τ are those of the largest evidence (MacKay 1992), ν the share of independent
samples in what is left.  The wider of both counts: forces against time do not see a law that goes with the cause's own,
and a law does not see what follows none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from backend.diagnose.adequacy import scaled
from backend.diagnose.fitted import Fitted
from backend.diagnose.independent import independent_of
from backend.diagnose.latent import SIZES, force_responses, forces
from backend.diagnose.seer import Seer
from backend.diagnose.unknown import laws_of

ROUNDS = 60  # of τ at one s
SETTLED = 1e-4  # relative change of τ²
RIDGE = 1e-13  # of what the data say of a number: terms may do the same
BEYOND = 1e-4  # of a term's square, that the fit's own slopes must leave: what does the same is the cause itself


def deviations(fitted: Fitted, scale: float, softness: float) -> Float[np.ndarray, " few"]:
    """Of the choice's parameters: under the noise, its sigmas larger by `scale`, of which the misfit counts a share
    (`softness`); and under what the form may hide, no less.
    """
    few = fitted.count
    of_noise = deviations_of_noise(scaled(fitted, scale / np.sqrt(softness)))
    pull = np.zeros(fitted.x.size)
    pull[:few] = fitted.precision[:few] * (fitted.values - fitted.choice.start)
    hidden = [apart(fitted.r, fitted.J, L, fitted.precision, pull, fitted.rows) for L in _hidden(fitted)]
    return np.max([of_noise, *(sd[:few] for sd in hidden)], axis=0)


def deviations_of_noise(fitted: Fitted) -> Float[np.ndarray, " few"]:
    """Of the choice's parameters, had the form no fault."""
    return np.sqrt(np.maximum(np.diag(fitted.covariance), 0.0))[: fitted.count]


def apart(
    r: Float[np.ndarray, " n"],
    J: Float[np.ndarray, "n x"],
    L: Float[np.ndarray, "n terms"],
    precision: Float[np.ndarray, " x"],
    pull: Float[np.ndarray, " x"],
    rows: Sequence[slice],
) -> Float[np.ndarray, " x"]:
    """What a fit and the reading beside unknown terms leave open of each unknown.

    r, J: whitened misfit and slopes where the fit ended, run by run as `rows` says. L: responses to terms of unit size.
    precision, pull: of the unknowns' prior, and its gradient there.
    """
    A = np.concatenate([J, _beyond(J, L)], 1)
    unit = np.linalg.norm(A, axis=0)
    unit[unit == 0.0] = 1.0  # a number that moves nothing keeps its prior
    terms = np.zeros(A.shape[1] - J.shape[1])
    A, drawn = A / unit, np.concatenate([pull, terms]) / unit
    G, b = A.T @ A, A.T @ r
    readings: list[_Reading] = []
    for s in SIZES:
        guess = readings[-1].tau2 if readings else float(r @ r) / r.size
        prior = np.concatenate([precision, terms + s**-2.0]) / unit**2
        readings.append(_reading(r, A, G, b, drawn, prior, guess))
    best = max(readings, key=lambda reading: reading.log_z)
    rest = r - A @ best.step
    free = independent_of(rest, rows) / r.size
    own = slice(J.shape[1])
    return np.sqrt(best.variance[own] / free + best.step[own] ** 2) / unit[own]


def _beyond(J: Float[np.ndarray, "n x"], L: Float[np.ndarray, "n terms"]) -> Float[np.ndarray, "n more"]:
    """Terms that are not what the fit itself may do."""
    Q, size, _ = np.linalg.svd(J / np.maximum(np.linalg.norm(J, axis=0), 1e-300), full_matrices=False)
    Q = Q[:, size > 1e-7 * size.max(initial=0.0)]
    left = np.sum((L - Q @ (Q.T @ L)) ** 2, axis=0)
    return L[:, left > BEYOND * np.sum(L**2, axis=0)]


@dataclass(frozen=True)
class _Reading:
    """Step from the fit and its variance, beside terms of one size."""

    log_z: float
    step: Float[np.ndarray, " k"]
    variance: Float[np.ndarray, " k"]
    tau2: float


def _reading(r, A, G, b, pull, precision, tau2: float) -> _Reading:
    """With the τ of the largest evidence, sought from a first guess."""
    n, least = r.size, 1e-12 * float(r @ r) / r.size

    def at(tau2: float) -> tuple[_Reading, float]:
        H = G / tau2 + np.diag(precision)
        H[np.diag_indices_from(H)] += RIDGE / tau2
        C = np.linalg.inv(H)
        step = C @ (b / tau2 - pull)
        left = float(np.sum((r - A @ step) ** 2))
        cost = left / tau2 + step @ (precision * step) + n * np.log(tau2) + np.linalg.slogdet(H)[1]
        worth = np.sum(np.log(precision[precision > 0.0]))
        determined = len(precision) - float(np.diag(C) @ precision)
        return _Reading(-0.5 * float(cost - worth), step, np.diag(C), tau2), left / max(n - determined, 1.0)

    reading, power = at(tau2)
    for _ in range(ROUNDS):
        if abs(power / reading.tau2 - 1.0) < SETTLED:
            break
        reading, power = at(max(power, least))
    return reading


def _hidden(fitted: Fitted) -> list[Float[np.ndarray, "n terms"]]:
    """What a wrong form may hide, about the fit's motion: forces against time; laws of a few terms."""
    raw = forces(fitted.subject, fitted)
    seer = Seer(fitted.subject, fitted.probes, fitted.fraction)
    pushes = force_responses(fitted.subject, seer, raw).values()
    laws = [L for forms in laws_of(fitted, raw).values() for few, L in forms if few]
    ways = [[L / max(float(np.median(np.linalg.norm(L, axis=0))), 1e-300) for L in pushes]]
    ways += [[L / np.maximum(np.linalg.norm(L, axis=0), 1e-300) for L in laws]]
    return [np.concatenate(way, 1) for way in ways if way]
