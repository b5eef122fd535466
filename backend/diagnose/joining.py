"""What switches on beside a cause that follows the motion to within the noise: it does little to that motion, so it is
looked for about it, and a fit begins where that of the cause ended.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from jaxtyping import Float

from backend.diagnose.candidate import Candidate
from backend.diagnose.cause import Cause, begun_from
from backend.diagnose.fitted import Fitted, fit
from backend.diagnose.library import STOPS
from backend.diagnose.seer import Seer
from backend.diagnose.switch import capped, openings, passed, roughened
from backend.diagnose.which import Search

SWITCHES = 3  # causes of a kind that switches on, refitted
NARROW = 1.0  # noise variances a sample: what leaves no more follows the motion
ENDS = (0.9, 0.97, 0.99)  # of what a joint passes: an end met sooner would turn a motion that nothing else turns
ROUGHER = 9.0  # noise variances that walls which rub must take off beyond smooth ones


def follows(cause: Cause) -> bool:
    """Whether a cause follows whole records to within the noise."""
    fitted = cause.fitted
    return fitted.fraction == 1.0 and fitted.chi2 < (1.0 + NARROW) * fitted.r.size


def joining(search: Search, parent: Cause, others: Sequence[Candidate], family: str) -> list[Fitted]:
    """The parent with one more of a family, fitted: those that take most off at one of their openings. others: the
    parent's members in the family's library.
    """
    fitted = parent.fitted
    motion, left = passed(fitted) if family in STOPS else {}, _refitted(fitted)
    alone = left(fitted.r)

    def gain(candidate: Candidate, values: Mapping[str, float]) -> float:
        choice = search.subject.choose(*others, candidate)
        probes = [search.subject.chosen(p, choice) for p in search.subject.fit]
        return alone - left(capped(Seer(search.subject, probes).left(begun_from(fitted, choice, values))))

    found = []
    for candidate in search.subject.library.candidates:
        if candidate.family == family and not search.cancelled():
            gains = [(gain(candidate, v), v, candidate) for v in openings(search.subject, candidate, motion, ENDS)]
            best = max(gains, key=lambda g: g[0], default=(0.0, {}, candidate))
            found.append(best)
            if best[1] and (rubbed := roughened(candidate, best[1])) is not None:
                rough, values = rubbed
                more = gain(rough, values) - ROUGHER
                if more > best[0]:
                    found[-1] = more, values, rough.settling(values[rough.parameters[0].name])
    made = []
    for gained, values, candidate in sorted(found, key=lambda f: -f[0])[:SWITCHES]:
        if gained > 0.0 and not search.cancelled():
            search.tell(f"trying {' + '.join([candidate.name, *parent.names])}")
            choice = search.subject.choose(*others, candidate)
            made.append(fit(search.subject, choice, start=begun_from(fitted, choice, values)))
    return [f for f in made if np.isfinite(f.chi2)]


def _refitted(fitted: Fitted) -> Callable[[Float[np.ndarray, " n"]], float]:
    """Sum of squares of rows once the fit's own numbers take what they can to first order."""
    J = fitted.free
    H = np.linalg.pinv(J.T @ J + np.diag(fitted.precision), hermitian=True)

    def left(r: Float[np.ndarray, " n"]) -> float:
        pull = J.T @ r
        return float(r @ r - pull @ H @ pull)

    return left
