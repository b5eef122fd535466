"""Sets that could do what a cause does, and were not tried or went astray: any pin of a linkage of one freedom rubs
like the next, and a pair does what another does of which neither member was in any set that a level refits.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np
from jaxtyping import Float

from backend.diagnose.candidate import Candidate
from backend.diagnose.cause import Cause, begun_from, in_order
from backend.diagnose.fitted import Fitted
from backend.diagnose.library import strikes
from backend.diagnose.screen import Screen, beyond
from backend.diagnose.subject import Choice
from backend.diagnose.which import APART, Search

ALIASES = 12  # sets that are refitted
STRIKING = 4  # the same where parts strike: each takes a minute
EXCHANGED = 2  # members of a set, at once, for others that do the same


def complete(search: Search, cause: Cause, scale: float) -> list[Cause]:
    """Sets that leave to first order no more than a cause does, with up to two members exchanged at once, fitted.

    scale: of all sigmas.
    """
    if search.cancelled():
        return []
    size = min(len(cause.candidates), EXCHANGED)
    found: list[tuple[float, Choice, Float[np.ndarray, " x"]]] = []
    for given in combinations(cause.candidates, size):
        rest = [c for c in cause.candidates if c not in given]
        # A closer form is not in the library, nor would others of its kind do the same without what it has free.
        every = dict.fromkeys([*given, *(_shaped(c, given) for c in search.subject.library.candidates)])
        free = [c for c in every if not any(c.overlaps(kept) for kept in rest)]
        about = beyond(cause.fitted, given).rescaled(scale)
        sets = list(about.sets(free, size))
        alone = {member.name: gain for (member,), gain, _ in about.sets(free, 1)} if size > 1 else {}
        own = next((gain for members, gain, _ in sets if set(members) == set(given)), np.inf)
        for members, gain, values in sets:
            names = tuple(sorted(c.name for c in (*rest, *members)))
            # Beside one that does it alone anything does: what would be another's place among those that are refitted.
            idle = max((alone.get(c.name, 0.0) for c in members), default=0.0) > gain - APART
            if gain > own - APART and not idle and _untried_or_astray(search, names, cause, scale):
                worth = gain - own + 2.0 * (sum(c.log_odds for c in members) - sum(c.log_odds for c in given))
                choice = search.subject.choose(*rest, *members)
                found.append((worth, choice, begun_alike(cause.fitted, choice, about, given, members, values)))
    made, most = [], STRIKING if strikes(cause.candidates) else ALIASES
    for _, choice, x in sorted(found, key=lambda f: -f[0])[:most]:
        if not search.cancelled():
            search.tell(f"trying {choice.name} as well")
            made.append(search.fit_about(cause.fitted, choice, x, (1.0,)))
    return [search.keep_likelier(f) for f in made if np.isfinite(f.chi2) and in_order(f)]


def _shaped(candidate: Candidate, given: Sequence[Candidate]) -> Candidate:
    """A candidate with as much of its shape free as one of its kind that is given up for it."""
    return next((candidate.shaped_as(c) for c in given if c.kind == candidate.kind), candidate)


def begun_alike(
    fitted: Fitted,
    choice: Choice,
    about: Screen,
    given: Sequence[Candidate],
    members: Sequence[Candidate],
    values: Mapping[str, float],
) -> Float[np.ndarray, " x"]:
    """Where a set with `members` in the place of `given` begins, so that to first order it moves as the fit does: its
    starts follow. about: the fit without `given`. values: of members, by name; one that was given up and is back keeps
    what it had, because first order knows its size without its shape only.
    """
    had = dict(zip((p.name for p in fitted.choice.parameters), fitted.values.tolist(), strict=True))
    known = frozenset[str]().union(*(c.told for c in members))
    told = {name: had.get(name, value) for name, value in values.items() if name in known}
    shape = {(c.kind, p.parameter): had[p.name] for c in given for p in c.parameters if p.name not in c.told}
    begin = {
        p.name: shape[c.kind, p.parameter] for c in members for p in c.parameters
        if p.name not in known and (c.kind, p.parameter) in shape
    }  # fmt: skip
    x, shift = begun_from(fitted, choice, told | begin), about.moved(members, told)
    gone = {p.name for c in given for p in c.parameters}
    left = [p.name for p in fitted.choice.parameters if p.name not in gone]
    x[len(choice.parameters) :] += shift[len(left) :]
    shifts = dict(zip(left, shift[: len(left)], strict=True))
    for i, p in enumerate(choice.parameters):
        x[i] = np.clip(x[i] + shifts.get(p.name, 0.0), p.lower, p.upper)
    return x


def _untried_or_astray(search: Search, names: tuple[str, ...], cause: Cause, scale: float) -> bool:
    """Whether a set that promises as much as a cause was not tried, or ended where it leaves more."""
    made = search.tried.get(names)
    if made is None or made is cause:
        return made is None
    same = made.fitted.fraction == cause.fitted.fraction
    return same and made.fitted.chi2 - cause.fitted.chi2 > APART * scale**2


def elsewhere(search: Search, cause: Cause) -> list[Cause]:
    """A cause with a member that contains a simpler form at every other place where its kind may act, begun with its
    shape: slopes of what is absent know none, so that it may stand where the simpler form came out best.
    """
    made = []
    for member in cause.candidates:
        if not any(member.tries) or member.sought or member.sizes.sum() < 2 or search.cancelled():
            continue
        rest = [c for c in cause.candidates if c is not member]
        about = beyond(cause.fitted, (member,))
        for other in search.subject.library.candidates:
            names = tuple(sorted(c.name for c in (*rest, other)))
            if other.kind != member.kind or names in search.tried or any(other.overlaps(c) for c in rest):
                continue
            if (values := of_its_shape(cause.fitted, about, member, other)) and not search.cancelled():
                search.tell(f"trying {' + '.join(names)} as well")
                choice = search.subject.choose(*rest, other)
                begin = begun_from(cause.fitted, choice, values)
                made.append(search.fit_about(cause.fitted, choice, begin, (1.0,)))
    return [search.keep(f) for f in made if np.isfinite(f.chi2) and in_order(f)]


def of_its_shape(fitted: Fitted, about: Screen, member: Candidate, other: Candidate) -> dict[str, float] | None:
    """Values of another candidate of a member's kind: the member's shape, and so large that with the shape it begins a
    search with it would do to first order most of what the member does. None where it can do none.
    """
    choice = fitted.choice
    own = [i for i, p in enumerate(choice.parameters) if p in member.parameters]
    names = [p.parameter for p in member.parameters]
    if {p.parameter for p in other.parameters} != set(names):
        return None
    off = np.where(member.sizes, (fitted.values - choice.start)[own], 0.0)
    order = [names.index(p.parameter) for p in other.parameters]
    done, like = about.signature(member) @ off, about.signature(other) @ off[order]
    ratio = float(done @ like) / max(float(like @ like), 1e-300)
    if not ratio > 0.0:
        return None
    found = {}
    for p, i in zip(other.parameters, order, strict=True):
        value = p.start + ratio * off[i] if member.sizes[i] else fitted.values[own[i]]
        found[p.name] = float(np.clip(value, p.lower, p.upper))
    return found
