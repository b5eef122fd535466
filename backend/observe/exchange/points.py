"""What every file of tracks says, whichever tool wrote it: named points, frame by frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from backend.observe.tracking_error import TrackingError


@dataclass(frozen=True)
class Points:
    """Points of a file, under the file's own names.

    at: (frame, point, 2) pixels of the upright picture, (0, 0) the centre of the upper left pixel, or
    (frame, point, 3) metres in W; NaN where a point was not seen.  score: how sure the tool was, 0 to 1; NaN where
    it did not say.  frame: number of each row in the clip, counted from 0.  time_s: where the file carries times.
    sure: the score from which the tool itself counts a point as seen.
    """

    source: str
    names: tuple[str, ...]
    frame: Int[np.ndarray, "frame"]
    at: Float[np.ndarray, "frame point d"]
    score: Float[np.ndarray, "frame point"]
    time_s: Float[np.ndarray, "frame"] | None = None
    sure: float = 0.0
    notes: tuple[str, ...] = ()

    @property
    def in_pixels(self) -> bool:
        """Whether a camera and its bed stand between these points and the world."""
        return self.at.shape[2] == 2

    def renamed(self, names: Mapping[str, str], drawn: Sequence[str]) -> Points:
        """The points that are markers, under the drawing's names.

        names: theirs -> ours; an empty name leaves a point out; a name not listed stays as it is.
        Raises TrackingError for names that the file or the drawing does not have, and for two points of one name.
        """
        if absent := [theirs for theirs in names if theirs not in self.names]:
            raise TrackingError(
                f"{self.source} has no point {', '.join(absent)}, which --names renames. It has {listed(self.names)}."
            )
        ours = [names.get(name, name) for name in self.names]
        if unknown := [name for name in ours if name and name not in drawn]:
            first = unknown[0]
            raise TrackingError(
                f"{self.source}: {listed(unknown)} {'is' if len(unknown) == 1 else 'are'} not drawn. The drawing's "
                f"markers are {listed(drawn)}. Write --names {first}=MARKER, or {first}= to leave a point out."
            )
        kept = [k for k, name in enumerate(ours) if name]
        if twice := sorted({name for name in ours if name and ours.count(name) > 1}):
            raise TrackingError(f"{self.source}: two points are named {', '.join(twice)}; give each marker one point.")
        if not kept:
            raise TrackingError(f"{self.source}: --names leaves out every point; keep at least one.")
        missing = [name for name in drawn if name not in ours]
        note = (f"{self.source} has no track of {listed(missing)}.",) if missing else ()
        return replace(
            self,
            names=tuple(ours[k] for k in kept),
            at=self.at[:, kept],
            score=self.score[:, kept],
            notes=self.notes + note,
        )


def checked(points: Points) -> Points:
    """The same points.  Raises TrackingError for a file without frames, without places, or out of order."""
    name = points.source
    if len(points.names) == 0:
        raise TrackingError(f"{name} names 0 points; export it again with at least one.")
    if len(set(points.names)) < len(points.names):
        twice = sorted({n for n in points.names if points.names.count(n) > 1})
        raise TrackingError(f"{name} names {listed(twice)} twice; rename one in the tool that wrote it.")
    if len(points.frame) == 0:
        raise TrackingError(f"{name} holds 0 frames; export the tracks of the whole clip again.")
    if not np.isfinite(points.at).all(2).any():
        raise TrackingError(
            f"{name} holds {len(points.frame)} frames and not one place (every coordinate is empty or NaN). "
            "Check in the tool that wrote it that points were found."
        )
    if np.isinf(points.at).any():
        raise TrackingError(f"{name} holds infinite coordinates; export it again.")
    back = np.flatnonzero(np.diff(points.frame) <= 0)
    if len(back) or points.frame[0] < 0:
        at = int(back[0]) if len(back) else -1
        after = f" after frame {points.frame[at]}" if at >= 0 else ""
        raise TrackingError(
            f"{name}: frame {points.frame[at + 1]} stands{after} in row {at + 2} of the data; frames are counted "
            "from 0 and run forward. Sort the rows by frame, one row a frame."
        )
    return points


def listed(names: Sequence[str], most: int = 20) -> str:
    """Names in a sentence."""
    rest = len(names) - most
    return ", ".join(names[:most]) + (f" and {rest} more" if rest > 0 else "")


def told_apart(groups: Sequence[str], parts: Sequence[str]) -> tuple[str, ...]:
    """Names of points that belong to several individuals: the part alone where that is enough.

    groups, parts: the individual and the part of each point, of equal length.
    """
    if len(set(parts)) == len(parts):
        return tuple(parts)
    if len(set(groups)) == len(groups):
        return tuple(groups)
    return tuple(f"{group}.{part}" for group, part in zip(groups, parts, strict=True))
