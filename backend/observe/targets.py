"""What shows where a mechanism's markers are: dots, which are followed to be known, or tags, which name themselves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np
from jaxtyping import Complex, Float, Int

from backend.observe.carried import DARK, PATCH
from backend.observe.detect import Detections, Region, detect, learn_whole
from backend.observe.dots import DotLook, learn_look, learn_patch
from backend.observe.label import Assembling, label_dots
from backend.observe.tag_names import Tag
from backend.observe.tags import Laid, find_tags, lay, of_other_family, outlines
from backend.observe.track import Expected, Predictor, Tracker
from backend.observe.tracking_error import TrackingError
from backend.observe.video import Frame

TAG_RADIUS_PX = 12.0  # of the preview's circles
SINGLE_PX = 0.02  # a sharp tag's centre (docs/kit.md)
ROUND = 1.5  # sides: what is searched about a tag's place, its corners and white margin within
NEAR = 0.25  # of its side, where the pattern itself is sought: from farther off it is laid over wrong cells
ALIKE, ROUGHLY = 0.88, 0.82  # blurred by two cells; other tags of the family reach 0.81
STIFF = 0.01  # of its side: by so much a blurred tag's corners leave their shape, noise's less, a covered one's more
LEANS_S = 1 / 60  # in which a tag that moves may change its shape as much


class Targets(Protocol):
    """The markers in the first picture, and a way to find them in the next.

    found: what the first picture shows.  order: the detection of each marker, then of strangers.
    radius_px: of a target.
    """

    found: Detections
    order: Int[np.ndarray, "n"]
    radius_px: float

    @property
    def look(self) -> DotLook | None:
        """Of dots; None for tags."""
        ...

    def start(self, predictor: Predictor) -> None:
        """Follow with this predictor from now on."""
        ...

    def step(self, frame: Frame) -> tuple[Detections, Int[np.ndarray, "n"], Expected]:
        """What the next picture shows, which of it is each marker's (-1: nothing), and where each was expected."""
        ...


class DotTargets:
    """Dots of one look, named by the drawing in the first picture.

    way: DARK for dots without a colour, PATCH for coloured areas of any shape; "" for coloured dots.
    """

    def __init__(
        self,
        first: Frame,
        expected_px: Mapping[str, Float[np.ndarray, "2"]],
        clicks: Mapping[str, Sequence[float]],
        way: str = "",
        assembling: Assembling | None = None,
    ):
        clicked = np.array([*clicks.values()], float).reshape(-1, 2)
        look = (
            learn_patch(first, clicked)
            if way == PATCH
            else learn_look(first, len(expected_px), clicked, dark=way == DARK)
        )
        found = detect(first, look)
        named = list(label_dots(expected_px, found.px, 2 * look.ring_px, clicks, assembling).values())
        self.look = learn_whole(look, found, named)
        self.found = detect(first, self.look)
        self.strangers = len(self.found) - len(named)
        self.order = np.r_[named, np.setdiff1d(np.arange(len(self.found)), named)].astype(int)
        self.radius_px = self.look.radius_px

    def start(self, predictor: Predictor) -> None:
        """Follow with this predictor from now on."""
        self.tracker = Tracker(predictor, len(self.order), 1.5 * self.look.ring_px)

    def step(self, frame: Frame) -> tuple[Detections, Int[np.ndarray, "n"], Expected]:
        """The dots of the next picture, sought where the mechanism's motion may have taken them."""
        expected, reach = self.tracker.predictor.predict(frame.time_s)
        around = Region.around(expected, reach + 2 * self.tracker.gate_px + 2 * self.look.ring_px)
        found = detect(frame, self.look, around)
        return found, *self.tracker.follow(frame.time_s, found)


class TagTargets:
    """Tags, each on a marker of its own: sought where the mechanism's motion puts them.

    A tag that names itself there is read.  One that is too blurred to be read is known by its pattern, laid over the
    picture where it must be; where the pattern lies there in another shape than before, something covers a part of it.
    """

    look, strangers = None, 0

    def __init__(self, first: Frame, tags: Mapping[str, Tag]):
        self.ids = list(tags.values())
        seen = find_tags(first.luma, self.ids)
        if missing := [f"{m} (tag {t})" for m, t in tags.items() if t not in seen]:
            raise TrackingError(
                f"Not found in the first picture: {', '.join(missing)}. Start the clip with every tag in view, sharp, "
                "at least 25 pixels wide with its white margin." + of_other_family(first.luma, self.ids)
            )
        self.last = [seen[t] for t in self.ids]
        self.time_s, self.turn_per_s = np.full(len(self.ids), first.time_s), np.zeros(len(self.ids))
        self.found, self.order = _detections([(tag, True) for tag in self.last])
        self.radius_px = TAG_RADIUS_PX

    def start(self, predictor: Predictor) -> None:
        """Say with this predictor where tags are to be sought, and where hidden ones would be."""
        self.predictor = predictor

    def step(self, frame: Frame) -> tuple[Detections, Int[np.ndarray, "n"], Expected]:
        """The tags of the next picture."""
        expected = self.predictor.predict(frame.time_s)
        laid = [self._sought(k, frame, at, float(reach)) for k, (at, reach) in enumerate(zip(*expected, strict=True))]
        found, index = _detections(laid)
        for k, now in enumerate(laid):
            if now and now[1]:
                late = frame.time_s - self.time_s[k]
                self.turn_per_s[k] = float(np.angle(_turn(self.last[k], now[0]))) / late
                self.last[k], self.time_s[k] = now[0], frame.time_s
        seen, whole, px = index >= 0, np.zeros(len(index), bool), expected[0].copy()
        px[seen], whole[seen] = found.px[index[seen]], found.whole[index[seen]]
        self.predictor.learn(frame.time_s, px, seen, whole)
        return found, index, expected

    def _sought(self, k: int, frame: Frame, at: Float[np.ndarray, "2"], reach_px: float) -> tuple[Laid, bool] | None:
        """A tag within reach of where it is expected, and whether nothing covers it; None where it is not seen."""
        tag, shape = self.ids[k], self.last[k].corners_px - self.last[k].centre_px
        side = _side(shape)
        own = [c for i, c in outlines(frame.luma, tag.family, at, reach_px + ROUND * side) if i == tag]
        # Leaning the other way after a while, it has another shape.
        stiff = STIFF * side * max(1.0, (frame.time_s - self.time_s[k]) / LEANS_S)
        if own:
            laid = lay(frame.luma, tag, min(own, key=lambda c: float(np.hypot(*(c.mean(0) - at)))))
            return laid, self._bent(k, laid) < 2 * stiff
        if reach_px > NEAR * side:
            return None
        turn = self.turn_per_s[k] * (frame.time_s - self.time_s[k])
        c, s = np.cos(turn), np.sin(turn)
        laid = lay(frame.luma, tag, at + shape @ np.array([[c, s], [-s, c]]), within=NEAR)
        if laid.alike < ROUGHLY:
            return None
        return laid, laid.alike > ALIKE and self._bent(k, laid) < stiff

    def _bent(self, k: int, now: Laid) -> float:
        """How far a corner has left the shape that the tag had [px]."""
        return float(np.abs(_corners(now) - _turn(self.last[k], now) * _corners(self.last[k])).max())


def _side(corners_px: Float[np.ndarray, "4 2"]) -> float:
    return float(np.hypot(*(np.roll(corners_px, -1, 0) - corners_px).T).mean())


def _corners(tag: Laid) -> Complex[np.ndarray, "4"]:
    """About their middle, as complex numbers."""
    z = tag.corners_px @ [1, 1j]
    return z - z.mean()


def _turn(before: Laid, now: Laid) -> complex:
    """By which a tag has turned since, as a number of length one."""
    turned = np.vdot(_corners(before), _corners(now))
    return complex(turned / abs(turned))


def _detections(laid: Sequence[tuple[Laid, bool] | None]) -> tuple[Detections, Int[np.ndarray, "marker"]]:
    """Those of the tags that are seen, and which of them is each marker's (-1: none)."""
    seen = np.array([tag is not None for tag in laid], bool)
    px = np.array([tag[0].centre_px for tag in laid if tag]).reshape(-1, 2)
    n, whole = len(px), np.array([tag[1] for tag in laid if tag], bool)
    found = Detections(px, np.tile(SINGLE_PX**2 * np.eye(2), (n, 1, 1)), whole, np.ones(n))
    return found, np.where(seen, np.cumsum(seen) - 1, -1)
