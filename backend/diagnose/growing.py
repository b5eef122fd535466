"""Fits over growing shares of the records: a gap so wide that the drawing loses the motion is first read over as much
of them as a set can follow.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from backend.diagnose.fitted import BEHIND, Fitted, fit, start_of
from backend.diagnose.subject import Choice, Subject

FRACTIONS = (0.03, 0.06, 0.12, 0.25, 0.5, 1.0)  # of the records
REACH = 0.12  # rad or mechanism lengths: a misfit beyond it is no longer small against the motion


def follow(subject: Subject, choice: Choice, start: np.ndarray | None = None) -> Fitted:
    """Fit over as much of the records as the choice can follow."""
    x = start_of(subject, choice) if start is None else start
    whole = fit(subject, choice, start=x, max_iterations=6)
    if whole.miss < REACH:
        return fit(subject, choice, start=whole.x)
    best: Fitted | None = None
    for fraction in FRACTIONS:
        made = fit(subject, choice, start=x, fractions=(fraction,), max_iterations=8)
        if best is not None and not made.miss < REACH:
            break
        best, x = made, made.x
    return best or whole


def stretched(subject: Subject, fits: list[Fitted]) -> list[Fitted]:
    """The same sets over longer records, as far as the best of them follows, but for those far behind it; seen
    through where they end.
    """
    coarse = False
    while fits and fits[0].fraction < 1.0:
        longer = FRACTIONS[FRACTIONS.index(fits[0].fraction) + 1]
        grown = _grown(subject, fits, longer, longer < 1.0)
        if not grown or not min(f.miss for f in grown) < REACH:
            return _grown(subject, fits, fits[0].fraction, False) if coarse else fits
        coarse, farthest = longer < 1.0, max(REACH, BEHIND * min(f.miss for f in grown))
        most = BEHIND * max(min(f.chi2 / f.r.size for f in grown), 1.0) if coarse else np.inf
        fits = [f for f in grown if f.miss < farthest and f.chi2 < most * f.r.size]
    return fits


def _grown(subject: Subject, fits: Sequence[Fitted], share: float, coarse: bool) -> list[Fitted]:
    """The same sets over this share of the records, the likeliest first; without those whose motion is lost."""
    made: list[Fitted] = []
    for f in sorted(fits, key=lambda f: f.chi2):
        ahead = min((m.chi2 for m in made), default=None)
        one = fit(subject, f.choice, start=f.x, fractions=(share,), max_iterations=8, ahead=ahead, coarse=coarse)
        if np.isfinite(one.chi2):
            made.append(one)
    return made
