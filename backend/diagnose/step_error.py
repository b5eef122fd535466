"""The error of the simulation's step about a motion: what it adds to the samples, and how far that may mislead."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from backend.diagnose.cause import Cause
from backend.diagnose.fitted import Fitted
from backend.diagnose.probe import Probe
from backend.diagnose.subject import Subject

ORDERLY = 0.25  # of an error's square, by which twice the step may say otherwise where the error is of second order


def orderly(errors: Sequence[Float[np.ndarray, "two samples"]]) -> list[Float[np.ndarray, " samples"]]:
    """Errors of the step to put back: those of second order. Others, of friction that holds and lets go or of a
    record's own grain, are not what the next motion has.
    """
    return [one if np.sum((one - two) ** 2) < ORDERLY * np.sum(one**2) else 0.0 * one for one, two in errors]


def step_errors(subject: Subject, fitted: Fitted) -> list[Float[np.ndarray, "two samples"]]:
    """What the error of the step adds to every experiment's samples about a motion, of those fitted and then of
    those held out; and the same as twice the step tells it.
    """
    ties, neutral = fitted.choice.ties, subject.neutral

    def one(probe: Probe) -> np.ndarray:
        moved = probe.choose(ties, neutral)
        runs = [i for i, p in enumerate(subject.fit) if p is probe]
        return moved.step_error(fitted.values, fitted.own(runs[0]) if runs else moved.settle(fitted.values))

    return subject.over(one, [*subject.fit, *subject.held_out])


def apart(subject: Subject, errors: Sequence[np.ndarray], others: Sequence[np.ndarray]) -> float:
    """How far errors of the step in the fitted experiments lie from others, in sums of squared sigmas."""
    off = (one - other for one, other in zip(errors, others, strict=False))
    white = (subject.noise.whitening(p.data, i) for i, p in enumerate(subject.fit))
    return sum(float(np.sum(w(e) ** 2)) for w, e in zip(white, off, strict=False))


def step_error(subject: Subject, drawn: Cause) -> float:
    """How far off, in sums of squared sigmas, the error of the step that is put back may be: it is that of the
    drawing's motion, from which the true one lies off by a share of the motion itself.
    """
    error, motion = 0.0, 0.0
    for i, probe in enumerate(subject.fit):
        white, data = subject.noise.whitening(probe.data, i), probe.data
        if probe.correction is not None:
            error += float(np.sum(white(probe.correction) ** 2))
        way = data.value.copy()
        for c in range(len(data.channels)):
            way[data.channel == c] -= np.nanmean(way[data.channel == c])
        motion += float(np.sum(white(np.nan_to_num(way)) ** 2))
    return error * min(drawn.fitted.chi2 / max(motion, 1e-300), 1.0)
