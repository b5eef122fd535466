"""Ends of travel that stop a linkage alike: in a loop of one freedom every joint stops at once.

Which of them has met its end is then told only by how the blow is answered, of which nobody knows the law.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from backend.diagnose.candidate import Candidate
from backend.diagnose.cause import Cause
from backend.diagnose.switch import is_upper, passed
from backend.diagnose.which import Search
from backend.effects.catalogue import catalogue
from backend.effects.shapes import AbstractJointStop

NEIGHBOURS = 12  # of a motion's places, at least, by which one joint's travel is read from another's
NEAR = 0.05  # of what a joint passes: so far about the blow they are read
STIFFNESS = ("N m/rad", "N/m")  # of an end that a turn or a slide meets
ONE_CURVE = 0.01  # of what a joint passes: how far its places may lie from one curve, or beyond an end of travel


def end_of(cause: Cause) -> Candidate | None:
    """The one end of travel in a cause; None where there is none, or more than one."""
    ends = [c for c in cause.candidates if issubclass(catalogue()[c.kind], AbstractJointStop)]
    return ends[0] if len(ends) == 1 else None


def stands(cause: Cause, end: Candidate) -> float:
    """Where an end of travel of a cause stands [rad or m]."""
    return cause.values[end.parameters[0].name]


def same_end(
    joint: str, at: float, own_upper: bool, other: str, upper: bool, motion: Mapping[str, np.ndarray]
) -> tuple[float, float] | None:
    """Where another joint has to end for the motion to stop as it does where the first one ends `at`, and how fast it
    moves there for each unit of the first one; None where that joint does not say where the first one is, or was
    beyond while that was not.

    own_upper, upper: whether they are upper ends. motion: q of each joint (experiments, times) with the stop.
    """
    q, p = motion[joint].ravel(), motion[other].ravel()
    known = np.isfinite(q) & np.isfinite(p)
    q, p = q[known] - at, p[known]
    if q.size < NEIGHBOURS:
        return None
    near = np.abs(q) <= max(np.sort(np.abs(q))[NEIGHBOURS - 1], NEAR * np.ptp(q))
    powers = (q[near, None] / max(np.ptp(q), 1e-12)) ** np.arange(3)
    curve = np.linalg.lstsq(powers, p[near])[0]
    loose, end = ONE_CURVE * np.ptp(p), float(curve[0])
    free = p[q <= 0.0 if own_upper else q >= 0.0]  # a soft end lets it farther, and both with it
    off, beyond = np.abs(p[near] - powers @ curve).max(), ((free - end) if upper else (end - free)).max(initial=0.0)
    return (end, float(curve[1]) / max(np.ptp(q), 1e-12)) if off < loose and beyond < loose else None


def stopping_alike(search: Search, cause: Cause) -> list[Cause]:
    """A cause with every other end of travel that stops the motion alike in the place of its own, each fitted from
    where its joint stands at the blow.
    """
    member = end_of(cause)
    if member is None or member.on[0] not in search.subject.joints:
        return []
    answers = member.parameters[1:]  # of its wall, if those are free
    motion, made = passed(cause.fitted), []
    for other in search.subject.library.candidates:
        if other.kind != member.kind or other.name == member.name or search.cancelled() or other.on[0] not in motion:
            continue
        upper = is_upper(other)
        met = same_end(member.on[0], stands(cause, member), is_upper(member), other.on[0], upper, motion)
        if met is None:
            continue
        end, rate = met
        way = next(iter(other.closer), other) if answers else other
        begin = {other.parameters[0].name: end}
        for p, own in ((p, own) for p in way.parameters[1:] for own in answers):
            if p.unit in STIFFNESS and own.unit in STIFFNESS:  # one energy, however the joint is geared
                begin[p.name] = cause.values[own.name] / max(rate * rate, 1e-12)
            elif p.parameter == own.parameter:
                begin[p.name] = cause.values[own.name]
        found = search.begun_at(cause, [way if c is member else c for c in cause.candidates], begin)
        made += [] if found is None else [found]
    return made


def one_motion(causes: Sequence[Cause]) -> list[list[tuple[str, ...]]]:
    """Names of causes, group by group, that differ by which joint has met its end, and stop the motion alike."""
    left = sorted((c for c in causes if end_of(c) is not None), key=lambda c: -c.log_z)
    groups = []
    while left:
        lead, *left = left
        motion = passed(lead.fitted)
        same = [c.names for c in left if _stops_alike(lead, c, motion)]
        left = [c for c in left if c.names not in same]
        if same:
            groups.append([lead.names, *same])
    return groups


def _stops_alike(lead: Cause, other: Cause, motion: Mapping[str, np.ndarray]) -> bool:
    mine, its = end_of(lead), end_of(other)
    if mine is None or its is None or mine.kind != its.kind or not {mine.on[0], its.on[0]} <= motion.keys():
        return False
    if {*lead.names} - {mine.name} != {*other.names} - {its.name}:
        return False
    met = same_end(mine.on[0], stands(lead, mine), is_upper(mine), its.on[0], is_upper(its), motion)
    q = motion[its.on[0]]
    return met is not None and bool(abs(met[0] - stands(other, its)) < ONE_CURVE * (np.nanmax(q) - np.nanmin(q)))
