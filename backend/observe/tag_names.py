"""How a printed tag is named: its number, and before it the family of patterns where that is not the kit's."""

from __future__ import annotations

from typing import Any, NamedTuple

KIT = "apriltag_36h11"
ARUCO = {f"aruco_{side}x{side}_{count}": count for side in (4, 5, 6, 7) for count in (50, 100, 250, 1000)}
FAMILIES = {
    KIT: 587, "apriltag_36h10": 2320, "apriltag_25h9": 35, "apriltag_16h5": 30, "aruco_original": 1024, **ARUCO,
}  # fmt: skip
"""Families that are read, and how many tags each has."""


class Tag(NamedTuple):
    """One printed pattern."""

    family: str
    number: int

    def __str__(self) -> str:
        return str(self.number) if self.family == KIT else f"{self.family}:{self.number}"


def tag_named(word: Any) -> Tag:
    """`3` of the kit's family, or `"aruco_4x4_50:3"`.  Raises ValueError with what is wrong."""
    family, colon, number = word.lower().rpartition(":") if isinstance(word, str) else ("", "", word)
    family = family if colon else KIT
    if family not in FAMILIES:
        raise ValueError(f"{word!r} is of no family that is read: {', '.join(FAMILIES)}")
    try:
        made = Tag(family, int(number))
        whole = made.number == float(number)
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"{word!r} is no number of a tag, nor family:number") from error
    if not whole or not 0 <= made.number < FAMILIES[family]:
        raise ValueError(f"{word!r} is no tag: {family} has numbers from 0 to {FAMILIES[family] - 1}")
    return made
