"""What switches on: tried at some sizes, the best of them fitted over growing shares of the records."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from backend.diagnose.candidate import Candidate
from backend.diagnose.cause import Cause, begun_from
from backend.diagnose.fitted import BEHIND, CHANCE, Fitted, fit, mean_square, start_of
from backend.diagnose.joining import SWITCHES, follows, joining
from backend.diagnose.library import LOAD, PLAYS, SMOOTH
from backend.diagnose.subject import Choice
from backend.diagnose.switch import promising
from backend.diagnose.which import Search

BRIEF = 4  # iterations of a first look
GROWING = (0.35, 0.7, 1.0)  # of the records, over which they are
TAKEN = 0.6  # of the misfit beyond noise of a part of the records, left by a cause that is worth the rest of them
NEARER = 1.5  # times what its rival leaves of most of a record, fitted to that alone while its rival was not
SPARE = 0.25  # noise variances that a part of the records may always leave


def switching(
    search: Search,
    baseline: Cause,
    family: str,
    motion: dict[str, np.ndarray],
    rival: Cause,
    beside: Cause | None = None,
    taken: float = TAKEN,
) -> list[Cause]:
    """Candidates that are nothing while small: tried at some sizes, the best fitted over growing records.

    rival: the best smooth set, which one of them must come near. beside: a cause that each of them joins. taken: share
    of the misfit that one may leave.
    """
    names = () if beside is None else beside.names
    others = [c for c in search.subject.library.candidates if c.name in names]
    parent = baseline if beside is None else beside
    if follows(parent):
        made = joining(search, parent, others, family) if len(others) == len(names) else []
        return sorted((_settled(search, search.keep(f)) for f in made), key=lambda c: -c.log_z)
    known = {} if beside is None else beside.values
    found = []
    for candidate in search.subject.library.candidates:
        if candidate.family == family and not search.cancelled() and len(others) == len(names):
            cost, values, begun = promising(search.subject, candidate, motion, others, known)
            if values:
                found.append((cost, known | values, begun))
    if family == LOAD:
        found = [_shortly(search, values, candidate, others) for _, values, candidate in found]
    made, behind = [], []
    for _, values, candidate in sorted(found, key=lambda f: f[0])[:SWITCHES]:
        search.tell(f"trying {' + '.join([candidate.name, *names])}")
        choice = search.subject.choose(*others, candidate)
        fitted = _grown(search, choice, start_of(search.subject, choice, values), baseline.fitted, rival.fitted, taken)
        if fitted is not None and np.isfinite(fitted.chi2):
            (made if fitted.fraction == 1.0 else behind).append(fitted)
    if behind and not made and not others:
        made += _as_walls_come(search, behind, baseline.fitted, rival.fitted)
    return sorted((_settled(search, search.keep(f)) for f in made), key=lambda c: -c.log_z)


def opened(search: Search, fitted: Fitted) -> list[Fitted]:
    """Fits with what nobody states of one of its members free as well, after a few iterations over the first of the
    records, the way that leads nearest first; no way that loses the motion.
    """
    first = [
        fit(search.subject, c, start=begun_from(fitted, c, begin), fractions=GROWING[:1], max_iterations=BRIEF)
        for c, begin in ((search.subject.choose(*way), begin) for way, begin in ways(search, fitted))
    ]
    return sorted((f for f in first if np.isfinite(f.chi2)), key=lambda f: f.chi2)


def ways(search: Search, fitted: Fitted) -> Iterator[tuple[tuple[Candidate, ...], dict[str, float]]]:
    """Members with what nobody states of one of them free as well, and where that begins. Walls that came free while
    the member stood alone may have ended in a trough that is not the set's: they begin anew.
    """
    members = fitted.choice.candidates
    for member in members:
        known, stated = member, set[str]()
        if len(members) > 1 and not member.closer and member.family != SMOOTH:
            known = next((c for c in search.subject.library.candidates if c.name == member.name), member)
            stated = {p.name for p in known.parameters}
        for way in known.closer:
            begin = {p.name: p.start for p in way.parameters if p.name not in stated} if known is not member else {}
            yield tuple(way if c is member else c for c in members), begin


def _as_walls_come(search: Search, behind: Sequence[Fitted], drawn: Fitted, rival: Fitted) -> list[Fitted]:
    """The nearest of those that fell behind their rival, with walls that rub, give and give back: hard smooth ones may
    follow the first of a motion only.
    """
    nearest = min(behind, key=lambda f: (-f.fraction, f.chi2))
    search.tell(f"trying {nearest.choice.name} with what nobody states of it")
    begun = opened(search, nearest)
    made = _grown(search, begun[0].choice, begun[0].x, drawn, rival, TAKEN) if begun else None
    return [made] if made is not None and np.isfinite(made.chi2) and made.fraction == 1.0 else []


def _settled(search: Search, cause: Cause) -> Cause:
    """The same play with pins that lay anywhere in their holes before the release, where the frames before it ask
    for that and it is the likelier.
    """
    fitted = cause.fitted
    if not fitted.choice.loose or not fitted.unsettled:
        return cause
    sizes = dict(zip((p.name for p in fitted.choice.parameters), fitted.values.tolist(), strict=True))
    members = [c.settling(sizes[c.parameters[0].name]) if c.kind in PLAYS else c for c in cause.candidates]
    search.tell(f"trying {' + '.join(cause.names)} with pins that lay aside before the release")
    made = fit(search.subject, search.subject.choose(*members), start=fitted.x)
    return search.keep_likelier(made) if np.isfinite(made.chi2) else cause


def _shortly(
    search: Search, values: dict[str, float], candidate: Candidate, others: Sequence[Candidate]
) -> tuple[float, dict[str, float], Candidate]:
    """What a few iterations over the first of the records leave, and where they lead: sizes that were tried say
    little of friction, whose way is smooth.
    """
    choice = search.subject.choose(*others, candidate)
    begin = start_of(search.subject, choice, values)
    made = fit(search.subject, choice, start=begin, fractions=GROWING[:1], max_iterations=BRIEF)
    if not np.isfinite(made.chi2):
        return np.inf, values, candidate
    return made.chi2, dict(zip((p.name for p in choice.parameters), made.values.tolist(), strict=True)), candidate


def _grown(search: Search, choice: Choice, x: np.ndarray, drawn: Fitted, rival: Fitted, taken: float) -> Fitted | None:
    """Fitted over growing shares of the records, up to where it leaves far more than its rival does; None where it
    leaves more than `taken` of what the drawing misses.
    """
    for share in GROWING:
        made = fit(search.subject, choice, start=x, fractions=(share,), coarse=share < 1.0)
        x, left = made.x, made.chi2 / made.r.size - 1.0
        if share < 1.0:
            chance = CHANCE * np.sqrt(2.0 / made.r.size)
            if not left < max(chance, taken * (mean_square(drawn, share) - 1.0)):
                return None
            times = BEHIND if share < GROWING[-2] else NEARER
            if not left < max(chance, SPARE, times * (mean_square(rival, share) - 1.0)):
                return made
    return made
