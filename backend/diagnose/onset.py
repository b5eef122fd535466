"""How far into the records all is well: what comes later has switched on, and whatever acts from the start is known."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from backend.diagnose.cause import Cause, begun_from
from backend.diagnose.fitted import Fitted, as_noise, fit, log_evidence
from backend.diagnose.growing import FRACTIONS
from backend.diagnose.screen import screen
from backend.diagnose.switch import let_go
from backend.diagnose.which import REFITS, Search

SHARES = FRACTIONS[:-1]  # of the records
ITERATIONS = 8
MOVED = 0.25  # of the ways that the joints pass: beginnings in which they pass less leave little to see of anything


class Onset(NamedTuple):
    """A share of the records, from their beginning, for which a cause of one member or none is enough."""

    share: float
    cause: Cause


def onset(search: Search, scale: float) -> Onset | None:
    """The longest such share: of the drawing, or of a single cause where one is enough for longer. None where neither
    is enough for the first of them. scale: of all sigmas.
    """
    last, reached = None, 0
    drawn = fit(search.subject, search.subject.choose(), fractions=SHARES[:1], max_iterations=ITERATIONS)
    while as_noise(drawn, scale):
        last, reached = drawn, reached + 1
        if reached == len(SHARES):
            break
        drawn = _longer(drawn, SHARES[reached])
    singles = _enough(search, drawn, scale) if reached < len(SHARES) else []
    while singles:
        last = max((Cause(f, log_evidence(f)) for f in singles), key=lambda c: c.log_z + c.log_odds).fitted
        reached += 1
        if reached == len(SHARES):
            break
        singles = [f for f in (_longer(f, SHARES[reached]) for f in singles) if as_noise(f, scale)]
    return None if last is None else Onset(SHARES[reached - 1], Cause(last, log_evidence(last)))


def moved(baseline: Fitted, share: float) -> float:
    """Share of the ways between the ends of each joint's motion as drawn that it has passed by then, of all joints and
    experiments together.
    """
    subject, begun, whole = baseline.subject, 0.0, 0.0
    for joint, q in let_go(baseline).items():
        until = max(1, round(share / baseline.fraction * (q.shape[1] - 1)))  # the first is where the motion begins
        begun += float(np.sum(np.ptp(q[:, : until + 1], axis=1))) / subject.size_of(joint)
        whole += float(np.sum(np.ptp(q, axis=1))) / subject.size_of(joint)
    return begun / whole if whole > 0.0 else 1.0


def _longer(fitted: Fitted, share: float) -> Fitted:
    return fit(fitted.subject, fitted.choice, start=fitted.x, fractions=(share,), max_iterations=ITERATIONS)


def _enough(search: Search, drawn: Fitted, scale: float) -> list[Fitted]:
    """Single causes that are enough for as much of the records as the drawing was fitted to."""
    free = [c for c in search.subject.library.candidates if not c.sought]
    about, found = screen(search.subject, drawn), []
    for candidate in search.promising(about, free, REFITS):
        if search.cancelled():
            break
        search.tell(f"trying {candidate.name} for the beginnings of the records")
        choice = search.subject.choose(candidate)
        begin = begun_from(drawn, choice, about.guess(candidate))
        found.append(fit(search.subject, choice, start=begin, fractions=(drawn.fraction,)))
    return [f for f in found if as_noise(f, scale)]
