"""Which dot is which, from how the drawing's parts hold together: in any pose, not only the drawn one.

A flat mechanism is put together on the dots part by part, beginning at the ground.  A part that hangs on a pin of known
place reaches the dots that lie as far from the pin as its own marker does; one in a guide those along the guide; one
that hangs on nothing known any two dots as far apart as two of its markers.  Where all its markers find dots and all
its joints to known parts close, the part's place follows from them by least squares, and the next part is tried.  Of
all that was put together so far the best few hundred go on (a beam search); what is left at the end are all the ways
in which these dots can be this mechanism.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from backend.observe.flat_mechanism import ODD_M, FlatMechanism
from backend.observe.label import Assembling, Way
from backend.observe.plane import Plane
from backend.observe.project import AbstractView

BEAM = 300  # ways of putting together that go on
NEAREST = 2  # dots that are tried where a part puts a marker
SHARE = 0.03  # of the drawing's extent: how far a dot may lie from where a small mechanism's part puts it
LEAST = 2.0  # of that: a marker nearer than this to a pin does not tell how its part is turned
FREEDOMS = 3  # of a part in the plane


@dataclass(frozen=True)
class Assembled:
    """Parts put together so far: poses as in FlatMechanism, those known; each marker's dot, -1 none; misfit [m²]."""

    poses: Float[np.ndarray, "body 3"]
    known: frozenset[int]
    dot: tuple[int, ...]
    misfit: float


def assembling_of(
    mechanism: Any, plane: Plane, view: AbstractView, heights_m: Float[np.ndarray, "marker"]
) -> Assembling | None:
    """All ways in which a mechanism can be put together on dots of a picture; None where it leaves the bed's plane."""
    flat = FlatMechanism(mechanism, plane)
    if not flat.flat or not flat.ids:
        return None

    def ways(dots_px: Float[np.ndarray, "dot 2"], held: Int[np.ndarray, "marker"], loose: float = 1.0) -> list[Way]:
        at = {h: view.metres(dots_px, np.full(len(dots_px), h)) for h in set(heights_m.tolist())}
        return assemblies(flat, np.stack([at[h] for h in heights_m.tolist()]), held, loose)

    return ways


def assemblies(
    flat: FlatMechanism,
    dots_m: Float[np.ndarray, "marker dot 2"],
    held: Int[np.ndarray, "marker"],
    loose: float = 1.0,
) -> list[Way]:
    """All ways in which the dots can be the mechanism's markers, best first: rms misfit over the largest that is
    allowed, and each marker's dot.

    dots_m: where a dot is in the bed's plane if it is that marker's, whose height counts.  held: dots that are known,
    -1 otherwise.  loose: times as far off as usual a dot may be.  Where its ground stands elsewhere than drawn it is
    put together on the dots alone.  Empty where nothing fits, or a part with a marker cannot be reached.
    """
    for drawn in (flat, flat.afloat()):
        builder, found = _Builder(drawn, np.asarray(dots_m, float), held, loose), dict[tuple[int, ...], float]()
        for state in builder.build():
            if -1 not in state.dot:
                found.setdefault(state.dot, float(np.sqrt(state.misfit / len(held))) / builder.tolerance_m)
        if found:
            return sorted((rms, dot) for dot, rms in found.items())
    return []


def put_together(flat: FlatMechanism, seen_m: Float[np.ndarray, "marker 2"]) -> Float[np.ndarray, "body 3"]:
    """Poses in which the mechanism's markers are about where they are seen; as drawn where they cannot be found."""
    poses = np.zeros((len(flat.ids), 3))
    if flat.flat and len(seen_m):
        every = np.broadcast_to(seen_m, (len(seen_m), *seen_m.shape))
        for state in _Builder(flat, every, np.arange(len(seen_m))).build()[:1]:
            known = sorted(state.known)
            poses[known] = state.poses[known]
    return poses


class _Builder:
    def __init__(self, flat: FlatMechanism, dots_m: np.ndarray, held: np.ndarray, loose: float = 1.0):
        self.flat, self.dots, self.held = flat, dots_m, held
        at = np.concatenate([flat.marker_at, flat.pin_at])
        extent = float(np.hypot(*np.ptp(at, 0)))
        self.tolerance_m = loose * min(ODD_M, SHARE * extent)

    def build(self) -> list[Assembled]:
        """Everything put together as far as dots reach, best first."""
        markers, count = len(self.flat.marker_body), len(self.flat.ids)
        beam = list(self._named(Assembled(np.zeros((count, 3)), frozenset(), (-1,) * markers, 0.0), -1))
        while beam and (body := self._next(beam[0])) is not None:
            grown: dict[tuple[tuple[int, ...], tuple[int, ...]], Assembled] = {}
            for state in beam:
                for pose in self._poses(state, body):
                    for made in self._with(state, body, pose):
                        turn = tuple(np.round(made.poses[body] / [1e-3, 1e-3, 1e-2]).astype(int).tolist())
                        grown.setdefault((made.dot, turn), made)
            beam = sorted(grown.values(), key=lambda s: s.misfit)[:BEAM]
        return beam

    def _next(self, state: Assembled) -> int | None:
        """The part to be put on: one that the known ones hold best, and of these the one with most markers."""
        free = [b for b in range(len(self.flat.ids)) if b not in state.known]
        ranked = [(self._hold(state, b), self._nameless(state, b), -b) for b in free]
        ranked = [
            (hold, dots, b)
            for hold, dots, b in ranked
            if (hold == FREEDOMS and self._turn_known(state, -b)) or (hold and dots) or dots > 1
        ]
        return -max(ranked)[2] if ranked else None

    def _nameless(self, state: Assembled, body: int) -> int:
        return sum(state.dot[m] < 0 for m in np.flatnonzero(self.flat.marker_body == body))

    def _hold(self, state: Assembled, body: int) -> int:
        """How many of a part's three freedoms the joints to known parts take."""
        joints = self._joints(state, body)
        if any(not self.flat.turns[k] and not self.flat.slides[k] for k in joints):
            return FREEDOMS
        return min(FREEDOMS, 2 * len(joints))

    def _joints(self, state: Assembled, body: int) -> list[int]:
        """Joints between a part and the ground or known parts."""
        there = state.known | {-1}
        ends = self.flat.pin_bodies.tolist()
        return [k for k, (a, b) in enumerate(ends) if (a == body and b in there) or (b == body and a in there)]

    def _poses(self, state: Assembled, body: int) -> Iterator[Float[np.ndarray, "3"]]:
        """Where a part can be: with its joints to known parts closed, and a dot where one of its markers is."""
        flat, joints = self.flat, self._joints(state, body)
        own = np.flatnonzero(flat.marker_body == body)
        pins = [k for k in joints if flat.turns[k]]
        stiff = [k for k in joints if not flat.turns[k]]
        places = np.array([self._place(state, body, k) for k in pins]).reshape(-1, 2)
        if stiff:
            turn = state.poses[self._other(stiff[0], body), 2] if self._other(stiff[0], body) >= 0 else 0.0
            if pins or not flat.slides[stiff[0]]:
                k = pins[0] if pins else stiff[0]
                yield self._laid(body, flat.pin_at[[k]], self._place(state, body, k)[None], turn)
                return
            across = self._across(turn, stiff[0])
            for m in own[:1].tolist():
                level = self._laid(body, flat.pin_at[[stiff[0]]], self._place(state, body, stiff[0])[None], turn)
                rest = self._moved(level, body, flat.marker_at[[m]])[0]
                for dot in self._dots(m):
                    off = dot - rest
                    if abs(off @ across) < self.tolerance_m:
                        yield level + np.r_[off - (off @ across) * across, 0.0]
            return
        if self._tells(flat.pin_at[pins]):
            yield self._laid(body, flat.pin_at[pins], places)
            return
        if pins:
            yield from self._about(body, pins[0], places[0], own)
            return
        yield from self._anywhere(body, own)

    def _about(self, body: int, pin: int, place: np.ndarray, own: np.ndarray) -> Iterator[np.ndarray]:
        """About a pin of known place, with a dot where the part's farthest marker is; as drawn where all lie on it."""
        arms = np.hypot(*(self.flat.marker_at[own] - self.flat.pin_at[pin]).T)
        far = int(arms.argmax()) if len(own) else 0
        if not len(own) or arms[far] < LEAST * self.tolerance_m:
            yield self._laid(body, self.flat.pin_at[[pin]], place[None], 0.0)
            return
        m = own[far]
        drawn = self.flat.marker_at[m] - self.flat.pin_at[pin]
        for dot in self._dots(m):
            seen = dot - place
            if abs(np.hypot(*seen) - arms[far]) < self.tolerance_m:
                turn = np.arctan2(seen[1], seen[0]) - np.arctan2(drawn[1], drawn[0])
                yield self._laid(body, self.flat.pin_at[[pin]], place[None], float(turn))

    def _anywhere(self, body: int, own: np.ndarray) -> Iterator[np.ndarray]:
        """With dots where its two markers are that lie farthest apart."""
        at = self.flat.marker_at[own]
        apart = np.hypot(*(at[:, None] - at[None]).transpose(2, 0, 1))
        i, j = np.unravel_index(int(apart.argmax()), apart.shape)
        if apart[i, j] < LEAST * self.tolerance_m:
            return
        for p in self._dots(own[i]):
            for q in self._dots(own[j]):
                if abs(np.hypot(*(q - p)) - apart[i, j]) < self.tolerance_m:
                    yield self._laid(body, at[[i, j]], np.array([p, q]))

    def _with(self, state: Assembled, body: int, pose: np.ndarray) -> Iterator[Assembled]:
        """With a part more, whose place follows from its markers and pins together; no way where a marker of it finds
        no dot or one of its joints stays open.
        """
        poses = state.poses.copy()
        poses[body] = pose
        own = np.flatnonzero(self.flat.marker_body == body)
        joints = self._joints(state, body)
        pins = [k for k in joints if self.flat.turns[k]]
        drawn = np.concatenate([self.flat.marker_at[own], self.flat.pin_at[pins]])
        pinned = [self._place(state, body, k) for k in pins]
        # Where neither dots nor pins tell how it is turned, its markers have names and others cannot hang on it yet.
        known = state.known | {body} if self._turn_known(state, body) else state.known
        for made in self._named(Assembled(poses, known, state.dot, state.misfit), body):
            placed, dots = poses.copy(), self.dots[own, [made.dot[m] for m in own]]
            if len(own) and len(pins) == len(joints) and body in known:
                placed[body] = self._laid(body, drawn, np.array([*dots, *pinned]))
            gap, _ = self.flat.held(placed)
            if np.abs(gap.reshape(-1, 3)[joints]).max(initial=0.0) < self.tolerance_m:
                off = self._moved(placed[body], body, self.flat.marker_at[own]) - dots
                yield Assembled(placed, made.known, made.dot, state.misfit + float((off**2).sum()))

    def _turn_known(self, state: Assembled, body: int) -> bool:
        """Whether a part's own dots, and joints to known parts, tell how it is turned."""
        joints = self._joints(state, body)
        pins = [k for k in joints if self.flat.turns[k]]
        drawn = np.concatenate([self.flat.marker_at[self.flat.marker_body == body], self.flat.pin_at[pins]])
        return len(pins) < len(joints) or self._tells(drawn)

    def _tells(self, points: np.ndarray) -> bool:
        """Whether points of a part tell how it is turned."""
        return len(points) > 1 and float(np.hypot(*np.ptp(points, 0))) > LEAST * self.tolerance_m

    def _named(self, state: Assembled, body: int) -> Iterator[Assembled]:
        """With a dot for each marker of a part (-1: the ground) that stands somewhere: the nearest one, or the next."""
        own = np.flatnonzero(self.flat.marker_body == body)
        expected = self._moved(state.poses[body] if body >= 0 else np.zeros(3), body, self.flat.marker_at[own])
        ways = [(state.dot, state.misfit)]
        for m, place in zip(own.tolist(), expected, strict=True):
            if state.dot[m] >= 0:
                continue
            allowed = self._allowed(m)
            away = np.hypot(*(self.dots[m, allowed] - place).T)
            near = [allowed[k] for k in np.argsort(away)[:NEAREST] if away[k] < self.tolerance_m]
            ways = [
                ((*dot[:m], int(d), *dot[m + 1 :]), misfit + float(((self.dots[m, d] - place) ** 2).sum()))
                for dot, misfit in ways
                for d in near
                if d not in dot
            ]
        for dot, misfit in ways:
            yield Assembled(state.poses, state.known, dot, misfit if body < 0 else state.misfit)

    def _allowed(self, marker: int) -> np.ndarray:
        """Dots that may be a marker's."""
        if self.held[marker] >= 0:
            return self.held[[marker]]
        return np.setdiff1d(np.arange(self.dots.shape[1]), self.held[self.held >= 0])

    def _dots(self, marker: int) -> np.ndarray:
        """Where the dots are that may be a marker's."""
        return self.dots[marker, self._allowed(marker)]

    def _other(self, joint: int, body: int) -> int:
        a, b = self.flat.pin_bodies[joint]
        return int(b if a == body else a)

    def _place(self, state: Assembled, body: int, joint: int) -> np.ndarray:
        """Where a joint is on the known part that it holds a part to."""
        other = self._other(joint, body)
        pose = state.poses[other] if other >= 0 else np.zeros(3)
        return self._moved(pose, other, self.flat.pin_at[[joint]])[0]

    def _across(self, turn: float, joint: int) -> np.ndarray:
        c, s, (x, y) = np.cos(turn), np.sin(turn), self.flat.guide_across[joint]
        across = np.array([c * x - s * y, s * x + c * y])
        return across / np.hypot(*across)

    def _moved(self, pose: np.ndarray, body: int, at: np.ndarray) -> np.ndarray:
        """Where points drawn on a part (-1: the ground) are in a pose."""
        if body < 0:
            return at
        c, s, origin = np.cos(pose[2]), np.sin(pose[2]), self.flat.origin[body]
        return origin + pose[:2] + (at - origin) @ np.array([[c, s], [-s, c]])

    def _laid(self, body: int, drawn: np.ndarray, seen: np.ndarray, turn: float | None = None) -> np.ndarray:
        """The pose that brings drawn points closest to where they are seen (Kabsch), of a turn that is known or not."""
        if turn is None:
            z, w = (drawn - drawn.mean(0)) @ [1, 1j], (seen - seen.mean(0)) @ [1, 1j]
            turn = float(np.angle(np.vdot(z, w)))
        level = np.r_[0.0, 0.0, turn]
        return level + np.r_[(seen - self._moved(level, body, drawn)).mean(0), 0.0]
