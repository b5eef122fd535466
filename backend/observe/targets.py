"""What shows where a mechanism's markers are: dots, which are followed to be known, or tags, which name themselves."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from jaxtyping import Float, Int

from backend.observe.detect import Detections, detect, learn_whole
from backend.observe.dots import DotLook, learn_look, learn_patch
from backend.observe.label import label_dots
from backend.observe.tags import find_tags
from backend.observe.track import Expected, Predictor, Tracker
from backend.observe.tracking_error import TrackingError
from backend.observe.video import Frame

# In place of a tag's number: nothing is stuck there; a dot without a colour; a coloured area of any shape.
TEXTURE, DARK, PATCH = "texture", "dark", "patch"
REACH_PX, LEAST_REACH_PX = 10, 5  # of a texture: a bar of 10 mm at 0.5 mm a pixel; fewer pixels tell no place
TAG_RADIUS_PX = 12.0  # of the preview's circles
SINGLE_PX = 0.02  # a sharp tag's centre (docs/kit.md)


GivenTargets = Mapping[str, int | str] | str | Path | None


class Untagged(NamedTuple):
    """How markers are known that are neither tags nor coloured dots.  reach_px: how far round them a texture counts."""

    way: str
    reach_px: int = REACH_PX


def _untagged(word: Any) -> Untagged | None:
    """What "texture", "texture:40", "dark" or "patch" says; None for a tag."""
    way, _, reach = str(word).partition(":")
    if way not in (TEXTURE, DARK, PATCH):
        return None
    made = Untagged(way, int(reach)) if reach else Untagged(way)
    if made.reach_px < LEAST_REACH_PX or (reach and way != TEXTURE):
        raise ValueError(
            f"{word!r}: a texture reaches {LEAST_REACH_PX} pixels or more, other targets have their own size"
        )
    return made


def read_targets(targets: GivenTargets, markers: Sequence[str]) -> dict[str, int] | Untagged | None:
    """Which tag each marker carries, from a JSON object or its file; None where coloured dots are followed.

    Untagged where the same is said of every marker.  Raises TrackingError where a marker has no tag, or two have the
    same.
    """
    if targets is None:
        return None
    try:
        given = json.loads(Path(targets).read_text(encoding="utf-8")) if isinstance(targets, str | Path) else targets
        untagged = {str(name): way for name, tag in given.items() if (way := _untagged(tag))}
        tags = {str(name): -1 if name in untagged else int(tag) for name, tag in given.items()}
    except (OSError, ValueError, TypeError, AttributeError) as error:
        raise TrackingError(
            f'Targets cannot be read ({error}); write {{"marker": tag number}}, {{"marker": "{TEXTURE}"}}, '
            f'{{"marker": "{TEXTURE}:40"}} where 40 pixels round about count, {{"marker": "{DARK}"}} or '
            f'{{"marker": "{PATCH}"}}.'
        ) from error
    if wrong := sorted(set(tags) ^ set(markers)):
        raise TrackingError(
            f"Targets and drawing disagree about {', '.join(wrong)}; give every marker its tag: {', '.join(markers)}."
        )
    ways = sorted(set(untagged.values()))
    if len(untagged) == len(tags) and len(ways) == 1:
        return ways[0]
    if untagged:
        others = "the other markers by tags" if len(untagged) < len(tags) else "not all alike"
        named = " or ".join(sorted({said.way for said in ways}))
        raise TrackingError(
            f"{', '.join(untagged)} are to be followed by their {named} and {others}; a clip is measured in one way. "
            "Put tags on these too, or follow all by texture."
        )
    if len(set(tags.values())) < len(tags):
        raise TrackingError(f"Two markers carry the same tag ({tags}); give each its own.")
    return {name: tags[name] for name in markers}


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
