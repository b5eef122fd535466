"""The printed kit: ringed dots, bed tags, and the board that calibrates a lens.

One home for its geometry, so that what is printed is what is looked for.  Lengths are in metres.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float

from backend.observe.tag_names import ARUCO, KIT

TAG_FAMILY = "AprilTag 36h11"
TAG_IDS = tuple(range(9))
TAG_SIDE_M = 0.040  # the black square: 80 px at 0.5 mm per pixel, 10 px per cell
BOARD_FAMILY = "ArUco 5x5, 100 ids"
BOARD_COLUMNS, BOARD_ROWS = 7, 9
BOARD_SQUARE_M, BOARD_MARKER_M = 0.025, 0.018


@dataclass(frozen=True)
class DotSize:
    """A coloured disc on a white ring: diameters [m]."""

    disc_m: float
    ring_m: float


@dataclass(frozen=True)
class Ink:
    """A saturated colour, darker than white paper by half or more in luma, as sRGB."""

    name: str
    rgb: tuple[float, float, float]


DOT_SIZES = (DotSize(0.012, 0.018), DotSize(0.008, 0.012), DotSize(0.006, 0.009))
# The tracker tells inks apart by their hue in the picture's colour differences; these are 60 degrees or more apart.
INKS = (
    Ink("red", (0.78, 0.06, 0.12)),
    Ink("blue", (0.04, 0.24, 0.78)),
    Ink("green", (0.00, 0.51, 0.24)),
    Ink("violet", (0.54, 0.12, 0.62)),
)


def tag_dictionary(family: str = KIT) -> cv2.aruco.Dictionary:
    """The patterns among which a tag is looked for."""
    name = family.removeprefix("aruco_") if family in ARUCO else family
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{name.upper()}"))


def board() -> cv2.aruco.CharucoBoard:
    """The ChArUco board, in metres: x right and y down from its upper left corner."""
    patterns = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    return cv2.aruco.CharucoBoard((BOARD_COLUMNS, BOARD_ROWS), BOARD_SQUARE_M, BOARD_MARKER_M, patterns)


def board_corners_m() -> Float[np.ndarray, "corner 3"]:
    """Inner corners of the board's squares, in the order of their ids [m]."""
    return np.array(board().getChessboardCorners(), float)


def _black_cells(dictionary: cv2.aruco.Dictionary, tag: int) -> Bool[np.ndarray, "k k"]:
    side = dictionary.markerSize + 2  # one black cell all round
    return cv2.aruco.generateImageMarker(dictionary, tag, side, borderBits=1) == 0


def tag_cells(tag: int, family: str = KIT) -> Bool[np.ndarray, "k k"]:
    """Which cells of a tag are black, row by row from the top; 8 x 8 of the kit's."""
    return _black_cells(tag_dictionary(family), tag)


def board_markers() -> list[tuple[float, float, Bool[np.ndarray, "7 7"]]]:
    """Each marker of the board: its upper left corner (x, y) [m], and which of its cells are black."""
    made = board()
    corners = [np.asarray(p, float)[0, :2] for p in made.getObjPoints()]
    patterns = made.getDictionary()
    return [
        (float(x), float(y), _black_cells(patterns, int(i)))
        for (x, y), i in zip(corners, np.ravel(made.getIds()), strict=True)
    ]


def board_squares() -> Bool[np.ndarray, "row column"]:
    """Which squares of the board are black: those that carry no marker."""
    black = np.ones((BOARD_ROWS, BOARD_COLUMNS), bool)
    for x, y, _ in board_markers():
        black[int(y / BOARD_SQUARE_M), int(x / BOARD_SQUARE_M)] = False
    return black
