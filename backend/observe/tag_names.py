"""How a printed tag is named: its number, and before it the family of patterns where that is not the kit's."""

from __future__ import annotations

from typing import Any, NamedTuple

KIT = "apriltag_36h11"
ARUCO = {f"aruco_{side}x{side}_{count}": count for side in (4, 5, 6, 7) for count in (50, 100, 250, 1000)}
FAMILIES = {
    KIT: 587, "apriltag_36h10": 2320, "apriltag_25h9": 35, "apriltag_16h5": 30, "aruco_original": 1024, **ARUCO,
}  # fmt: skip
"""Families that are read, and how many tags each has."""
LONGEST = 60  # characters of a name that is wrong, in what is said of it


class Tag(NamedTuple):
    """One printed pattern."""

    family: str
    number: int

    @property
    def pattern(self) -> tuple[str, int]:
        """What is printed: of ArUco's families of one size, the smaller are the beginning of the larger."""
        return (self.family.rpartition("_")[0] if self.family in ARUCO else self.family), self.number

    def __str__(self) -> str:
        return str(self.number) if self.family == KIT else f"{self.family}:{self.number}"


def tag_named(word: Any) -> Tag:
    """`3` of the kit's family, or `"aruco_4x4_50:3"`.  Raises ValueError with what is wrong."""
    family, colon, number = word.lower().rpartition(":") if isinstance(word, str) else ("", "", word)
    family, said = family if colon else KIT, f"{word!r}"[:LONGEST]
    if family not in FAMILIES:
        raise ValueError(f"{said} is of no family that is read: {', '.join(FAMILIES)}")
    digits = number.isascii() and number.isdigit() and len(number) < LONGEST if isinstance(number, str) else False
    if not digits and (isinstance(number, bool) or not isinstance(number, int)):
        raise ValueError(f"{said} is no number of a tag, nor family:number")
    if not 0 <= int(number) < FAMILIES[family]:
        raise ValueError(f"{said} is no tag: {family} has numbers from 0 to {FAMILIES[family] - 1}")
    return Tag(family, int(number))
