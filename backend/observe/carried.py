"""What people say their markers carry: a tag each, or for all of them no tag at all; nothing heavy is loaded."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from backend.observe.tag_names import Tag, tag_named
from backend.observe.tracking_error import TrackingError

# In place of a tag's number: nothing is stuck there; a dot without a colour; a coloured area of any shape.
UNTAGGED = TEXTURE, DARK, PATCH = "texture", "dark", "patch"
REACH_PX, LEAST_REACH_PX = 10, 5  # of a texture: a bar of 10 mm at 0.5 mm a pixel; fewer pixels tell no place
MOST_REACH_PX = 10_000  # no picture shows more

GivenTargets = Mapping[str, int | str] | str | Path | None


class Untagged(NamedTuple):
    """How markers are known that are neither tags nor coloured dots.  reach_px: how far round them a texture counts."""

    way: str
    reach_px: int = REACH_PX


def _untagged(word: Any) -> Untagged | None:
    """What "texture", "texture:40", "dark" or "patch" says; None for a tag."""
    way, _, reach = str(word).partition(":")
    if way not in UNTAGGED:
        return None
    made = Untagged(way, int(reach)) if reach else Untagged(way)
    if not LEAST_REACH_PX <= made.reach_px <= MOST_REACH_PX or (reach and way != TEXTURE):
        raise ValueError(
            f"{word!r}: a texture reaches {LEAST_REACH_PX} pixels or more, at most {MOST_REACH_PX}; other targets have "
            "their own size"
        )
    return made


def read_targets(targets: GivenTargets, markers: Sequence[str]) -> dict[str, Tag] | Untagged | None:
    """Which tag each marker carries, from a JSON object or its file; None where coloured dots are followed.

    Untagged where the same is said of every marker.  Raises TrackingError where a marker has no tag, or two have the
    same.
    """
    if targets is None:
        return None
    try:
        given = json.loads(Path(targets).read_text(encoding="utf-8")) if isinstance(targets, str | Path) else targets
        untagged = {str(name): way for name, tag in given.items() if (way := _untagged(tag))}
        tags = {str(name): tag_named(tag) for name, tag in given.items() if name not in untagged}
        said = {str(name) for name in given}
    except (OSError, ValueError, TypeError, AttributeError) as error:
        raise TrackingError(
            f'Targets cannot be read ({error}); write {{"marker": tag number}}, {{"marker": "aruco_4x4_50:3"}} of '
            f'another family than the kit\'s, {{"marker": "{TEXTURE}"}}, '
            f'{{"marker": "{TEXTURE}:40"}} where 40 pixels round about count, {{"marker": "{DARK}"}} or '
            f'{{"marker": "{PATCH}"}}.'
        ) from error
    if wrong := sorted(said ^ set(markers)):
        raise TrackingError(
            f"Targets and drawing disagree about {', '.join(wrong)}; give every marker its tag: {', '.join(markers)}."
        )
    ways = sorted(set(untagged.values()))
    if not tags and len(ways) == 1:
        return ways[0]
    if untagged:
        others = "the other markers by tags" if tags else "not all alike"
        named = " or ".join(sorted({way.way for way in ways}))
        raise TrackingError(
            f"{', '.join(untagged)} are to be followed by their {named} and {others}; a clip is measured in one way. "
            "Put tags on these too, or follow all by texture."
        )
    if len({tag.pattern for tag in tags.values()}) < len(tags):
        told = ", ".join(f"{name}: {tag}" for name, tag in tags.items())
        raise TrackingError(f"Two markers carry the same tag ({told}); give each its own.")
    return {name: tags[name] for name in markers}
