"""The kit's board in pictures: found, judged for sharpness, and chosen so that each view adds something."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8

from backend.observe.kit import BOARD_COLUMNS, BOARD_ROWS, BOARD_SQUARE_M, board, board_corners_m
from backend.observe.tracking_error import TrackingError
from backend.observe.video import Video

LEAST_CORNERS = 12  # a quarter of the board
LOOKS_PER_CLIP = 150  # a picture is looked for in each of so many spans of a clip: 5 a second over half a minute
SHARP_SHARE = 0.6  # of the sharpest tenth's; a board turned by 45 degrees has 0.7, less is moved or out of focus
ALIKE = 0.02  # picture widths: views whose corners lie nearer than this tell the same
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class BoardView:
    """Corners of the board in one picture.

    ids: which corners.  px: where.  sharpness: steepest slope over contrast at the corners [1/px].
    source: the picture's name.
    """

    ids: Int[np.ndarray, "corner"]
    px: Float[np.ndarray, "corner 2"]
    sharpness: float
    source: str

    @property
    def board_m(self) -> Float[np.ndarray, "corner 3"]:
        """The corners on the board [m]."""
        return board_corners_m()[self.ids]


@dataclass(frozen=True)
class Sighting:
    """Every view of the board, in pictures of one size; looked: how many pictures were searched."""

    views: tuple[BoardView, ...]
    size_px: tuple[int, int]
    looked: int


def find_board(luma: UInt8[np.ndarray, "h w"], source: str) -> BoardView | None:
    """The board in one picture; None where fewer than a quarter of its corners are seen."""
    corners, ids, _, _ = cv2.aruco.CharucoDetector(board()).detectBoard(luma)
    if ids is None or len(ids) < LEAST_CORNERS:
        return None
    px = np.asarray(corners, float).reshape(-1, 2)
    return BoardView(np.ravel(ids).astype(int), px, _sharpness(luma, px), source)


def _sharpness(luma: UInt8[np.ndarray, "h w"], px: Float[np.ndarray, "corner 2"]) -> float:
    """Median over the corners of the steepest slope along the softer of x and y, over the contrast [1/px]."""
    reach, found = 6, []
    for x, y in np.round(px).astype(int):
        patch = luma[max(y - reach, 0) : y + reach + 1, max(x - reach, 0) : x + reach + 1].astype(float)
        if min(patch.shape) > reach:
            low, high = np.percentile(patch, [5, 95])
            slopes = np.percentile(np.abs(np.gradient(patch)), 95, axis=(1, 2))
            found.append(slopes.min() / max(high - low, 1.0))  # motion softens the edges across it alone
    return float(np.median(found)) if found else 0.0


def look_for_board(files: Sequence[str | Path], progress: Progress | None = None) -> Sighting:
    """Views of the board in photos, clips or both.

    Raises TrackingError for files that are neither, and for pictures turned or sized unlike the others: each
    such picture has another optical centre.
    """
    if not files:
        raise TrackingError("No picture is given; give a clip of the board, or its photos.")
    views: list[BoardView] = []
    first: tuple[tuple[int, int], int, str] | None = None
    looked = 0
    for k, file in enumerate(files):
        path = Path(file)
        pictures = _photo(path) if path.is_file() and cv2.haveImageReader(str(path)) else _clip(path, progress)
        for luma, turned, name in pictures:
            size = (luma.shape[1], luma.shape[0])
            first = first or (size, turned, name)
            _check_alike(first, (size, turned, name))
            looked += 1
            if found := find_board(luma, name):
                views.append(found)
        if progress and len(files) > 1:
            progress(k + 1, len(files))
    if first is None:
        raise TrackingError(f"{files[0]}: not one picture can be decoded. Copy it from the camera again.")
    return Sighting(tuple(views), first[0], looked)


def _check_alike(first: tuple[tuple[int, int], int, str], other: tuple[tuple[int, int], int, str]) -> None:
    (size, turned, name), (size2, turned2, name2) = first, other
    advice = "Take all pictures with the camera held alike, at one setting, and none cropped or edited."
    if turned != turned2 or (size != size2 and size == size2[::-1]):
        raise TrackingError(f"{name2} is turned otherwise than {name}: the lens has its centre elsewhere. {advice}")
    if size != size2:
        raise TrackingError(
            f"{name2} is {size2[0]} x {size2[1]} pixels, {name} {size[0]} x {size[1]}: one camera file holds for one "
            f"size. {advice}"
        )


def _photo(path: Path) -> Iterator[tuple[UInt8[np.ndarray, "h w"], int, str]]:
    """A photo as a viewer shows it, with the quarter turns that its metadata asked for."""
    shown = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    stored = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION)
    if shown is None or stored is None:
        raise TrackingError(f"{path.name} cannot be read as a photo. Save it as JPEG or PNG, or copy it again.")
    turned = next((k for k in range(4) if np.array_equal(np.rot90(stored, k), shown)), -1)
    if turned < 0:
        raise TrackingError(f"{path.name} is stored as a mirror image; switch the camera's mirroring off.")
    yield np.asarray(shown, np.uint8), turned, path.name


def _clip(path: Path, progress: Progress | None) -> Iterator[tuple[UInt8[np.ndarray, "h w"], int, str]]:
    """The sharpest picture of each span of a clip."""
    video = Video(path, keep_truncated=True)
    span = max(1, video.frame_count // LOOKS_PER_CLIP)
    best, best_luma = -1.0, None
    label, turned = "", 0
    for frame in video:
        small = cv2.resize(frame.luma, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        detail = float(cv2.Laplacian(small, cv2.CV_16S).std())
        if detail > best:
            best, best_luma, turned = detail, frame.luma, frame.quarter_turns
            label = f"{path.name} at {frame.time_s:.2f} s"
        if best_luma is not None and (frame.index + 1) % span == 0:
            yield best_luma, turned, label
            best, best_luma = -1.0, None
        if progress:
            progress(frame.index + 1, video.frame_count)
    if best_luma is not None:
        yield best_luma, turned, label


def choose_views(views: Sequence[BoardView], size_px: tuple[int, int], limit: int) -> list[BoardView]:
    """The sharp views that differ most from each other, at most `limit`: each next is farthest from all so far."""
    if not views:
        return []
    sharpness = np.array([v.sharpness for v in views])
    sharp = np.flatnonzero(sharpness >= SHARP_SHARE * np.percentile(sharpness, 90)).tolist()
    frames = np.array([_frame_px(views[k]) for k in sharp]) / size_px[0]
    chosen = [int(sharpness[sharp].argmax())]
    away = np.full(len(sharp), np.inf)
    while len(chosen) < min(limit, len(sharp)):
        away = np.minimum(away, np.sqrt(((frames - frames[chosen[-1]]) ** 2).sum(2).mean(1)))
        if away.max() < ALIKE:
            break
        chosen.append(int(away.argmax()))
    return [views[sharp[k]] for k in chosen]


def _frame_px(view: BoardView) -> Float[np.ndarray, "4 2"]:
    """Where the board's four outer corners are, seen or not [px]: they hold its place, size, turn and lean."""
    H, _ = cv2.findHomography(view.board_m[:, :2], view.px)
    wide, high = BOARD_COLUMNS * BOARD_SQUARE_M, BOARD_ROWS * BOARD_SQUARE_M
    frame = np.array([[[0, 0]], [[wide, 0]], [[wide, high]], [[0, high]]], float)
    return cv2.perspectiveTransform(frame, H).reshape(4, 2)
