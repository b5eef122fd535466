"""A cause with what nobody states of it free as well: how walls give, give back and rub, or the shape of a friction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from backend.diagnose.cause import Cause
from backend.diagnose.fitted import BEHIND, Fitted, as_noise, log_evidence
from backend.diagnose.library import strikes
from backend.diagnose.switched import GROWING, opened, ways
from backend.diagnose.which import Search

RIVALS = 3  # of a set, whose walls are taken as they come, or whose shape is free, where its own are
ALIKE = 1.05  # times what the nearest way leaves of the first of the records: which leads farther is not told by it
HARDLY = 0.01  # noise variances a sample: less than the law of blows and the step err by


def closer(search: Search, cause: Cause) -> Cause:
    """A cause with what nobody states of one of its members free as well, where that makes it likelier."""
    if search.cancelled() or id(cause.fitted) in search.opened or not any(ways(search, cause.fitted)):
        return cause
    made = _best_way(search, cause)
    if made is None:
        return cause
    hardly = cause.fitted.chi2 - made.chi2 < HARDLY * made.r.size
    found = Cause(made, log_evidence(made), cause.fitted if hardly else None)
    if not found.log_z > cause.log_z:
        return cause
    search.tried[found.names] = found
    search.opened[id(made)] = made
    return found


def allowing_for_walls(search: Search, cause: Cause) -> Cause:
    """A cause whose walls were enough as they are assumed, beside the same with walls as they come: nobody knows which
    they are, and a soft wall does what a larger play does.
    """
    as_assumed = any(c.closer for c in cause.candidates if strikes([c]))
    if not as_assumed or search.cancelled() or id(cause.fitted) in search.opened:
        return cause
    made = _best_way(search, cause)
    if made is None or made.fraction < cause.fitted.fraction or not made.chi2 < cause.fitted.chi2:
        return cause
    return replace(cause, otherwise=made)


def _best_way(search: Search, cause: Cause) -> Fitted | None:
    """A cause with what nobody states of one of its members free, by the way that leaves least; None where none holds
    the motion.
    """
    search.opened[id(cause.fitted)] = cause.fitted
    search.tell(f"trying {' + '.join(cause.names)} with what nobody states of it")
    begun = opened(search, cause.fitted)
    if not begun:
        return None
    made = search.fit_about(cause.fitted, begun[0].choice, begun[0].x, GROWING[1:])
    for way in begun[1:]:
        if as_noise(made) or way.chi2 > ALIKE * begun[0].chi2:
            break
        made = min(made, search.fit_about(cause.fitted, way.choice, way.x, GROWING[1:]), key=lambda f: f.chi2)
    return made


def coming_up(search: Search, leader: Cause, better: Cause, causes: Sequence[Cause]) -> list[Cause]:
    """Of causes, the nearest of a leader's kinds that could come up with it as it is closer, closer as well."""
    kinds = sorted(c.kind for c in leader.candidates)
    alike = [c for c in causes if c.names != leader.names and sorted(k.kind for k in c.candidates) == kinds]
    return _within_reach(search, leader, better, alike)


def _within_reach(search: Search, leader: Cause, better: Cause, causes: Sequence[Cause]) -> list[Cause]:
    """The nearest of causes that would come up with a leader if they gained as much as it did, closer as well."""
    reach = leader.log_z - (better.log_z - leader.log_z)
    near = [c for c in causes if c.fitted.fraction == leader.fitted.fraction and c.log_z > reach]
    return [closer(search, c) for c in sorted(near, key=lambda c: -c.log_z)[:RIVALS]]


def in_shape(search: Search, level: Sequence[Cause]) -> list[Cause]:
    """Sets of a level, the likeliest first, with what nobody states of them free as well: of each kind that has such a
    shape the nearest, and others that could come up with it so. Drag that is spread along a bar may fall behind another
    law as long as it acts at a point.
    """
    found, kinds = {c.names: c for c in level}, dict[tuple[str, ...], list[Cause]]()
    for cause in level:
        shapes = tuple(sorted(c.kind for c in cause.candidates if c.closer))
        if shapes and cause.fitted.chi2 < BEHIND * level[0].fitted.chi2:
            kinds.setdefault(shapes, []).append(cause)
    for first, *others in kinds.values():
        better = found[first.names] = closer(search, first)
        found |= {c.names: c for c in _within_reach(search, first, better, others)}
    return list(found.values())
