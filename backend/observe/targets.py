"""What shows where a mechanism's markers are: dots, which are followed to be known, or tags, which name themselves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np
from jaxtyping import Float, Int

from backend.observe.carried import DARK, PATCH
from backend.observe.detect import Detections, detect, learn_whole
from backend.observe.dots import DotLook, learn_look, learn_patch
from backend.observe.label import label_dots
from backend.observe.tags import find_tags
from backend.observe.track import Expected, Predictor, Tracker
from backend.observe.tracking_error import TrackingError
from backend.observe.video import Frame

TAG_RADIUS_PX = 12.0  # of the preview's circles
SINGLE_PX = 0.02  # a sharp tag's centre (docs/kit.md)


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
    ):
        clicked = np.array([*clicks.values()], float).reshape(-1, 2)
        look = (
            learn_patch(first, clicked)
            if way == PATCH
            else learn_look(first, len(expected_px), clicked, dark=way == DARK)
        )
        found = detect(first, look)
        named = list(label_dots(expected_px, found.px, 2 * look.ring_px, clicks).values())
        self.look = learn_whole(look, found, named)
        self.found = detect(first, self.look)
        self.strangers = len(self.found) - len(named)
        self.order = np.r_[named, np.setdiff1d(np.arange(len(self.found)), named)].astype(int)
        self.radius_px = self.look.radius_px

    def start(self, predictor: Predictor) -> None:
        """Follow with this predictor from now on."""
        self.tracker = Tracker(predictor, len(self.order), 1.5 * self.look.ring_px)

    def step(self, frame: Frame) -> tuple[Detections, Int[np.ndarray, "n"], Expected]:
        """The dots of the next picture."""
        found = detect(frame, self.look)
        return found, *self.tracker.follow(frame.time_s, found)


class TagTargets:
    """Tags of the bed's family, each on a marker of its own."""

    look, strangers = None, 0

    def __init__(self, first: Frame, tags: Mapping[str, int]):
        self.ids = list(tags.values())
        self.found, self.order = self._find(first)
        if missing := [f"{m} (tag {t})" for (m, t), k in zip(tags.items(), self.order, strict=True) if k < 0]:
            raise TrackingError(
                f"Not found in the first picture: {', '.join(missing)}. Start the clip with every tag in view, sharp, "
                "at least 25 pixels wide with its white margin."
            )
        self.radius_px = TAG_RADIUS_PX

    def _find(self, frame: Frame) -> tuple[Detections, Int[np.ndarray, "marker"]]:
        seen = find_tags(frame.luma)
        own = [k for k in self.ids if k in seen]
        px = np.array([seen[k] for k in own]).reshape(-1, 2)
        index = np.array([own.index(k) if k in own else -1 for k in self.ids])
        n = len(own)
        return Detections(px, np.tile(SINGLE_PX**2 * np.eye(2), (n, 1, 1)), np.ones(n, bool), np.ones(n)), index

    def start(self, predictor: Predictor) -> None:
        """Say with this predictor where hidden tags would be."""
        self.predictor = predictor

    def step(self, frame: Frame) -> tuple[Detections, Int[np.ndarray, "n"], Expected]:
        """The tags of the next picture."""
        found, index = self._find(frame)
        expected = self.predictor.predict(frame.time_s)
        seen, px = index >= 0, expected[0].copy()
        px[seen] = found.px[index[seen]]
        self.predictor.learn(frame.time_s, px, seen, seen)
        return found, index, expected
