"""The annotated frames of docs/video.md: `python -m benchmarks.clip_pictures` (after benchmarks.rendered_clips).

One cell a clip: a piece of one frame, every dot with its name in the colour of its status, and the clip's errors.
"""

from pathlib import Path

import av
import cv2
import numpy as np

from benchmarks.filming.clips import CLIPS, FOLDER, Clip
from benchmarks.rendered_clips import plain_dots, score, with_kit

PICTURE = Path(__file__).parents[1] / "docs" / "pictures" / "video_frames.jpg"
CELL, TITLE_PX, COLUMNS, QUALITY = (540, 270), 22, 2, 74
SHOWN = {  # frame, the middle of the piece and its width [px]
    "scissor": (100, (640, 330), 720),
    "long shutter": (60, (640, 360), 720),
    "warm light drifts": (150, (700, 330), 720),
    "60 a second": (45, (700, 330), 720),
    "300 mm card": (110, (740, 300), 720),
    "hand": (150, (700, 330), 720),
    "stickers": (60, (640, 330), 720),
    "noise and crf 30": (110, (640, 330), 720),
    "shaken": (60, (640, 400), 1280),
    "tags": (60, (640, 400), 1280),
}
COLOURS = {"observed": (40, 150, 40), "outlier": (0, 110, 255), "predicted": (210, 90, 20)}
FONT = cv2.FONT_HERSHEY_SIMPLEX


def annotated(clip: Clip, *, bare: bool = False) -> np.ndarray:
    """A piece of one frame with what was found in it, under a title."""
    number, middle, wide = SHOWN[clip.name]
    called = "bare dots" if bare else clip.name
    tracks = plain_dots(clip, FOLDER) if bare else with_kit(clip, FOLDER, coast_s=10.0)
    clip = clip.plain() if bare else clip
    high = wide * CELL[1] // CELL[0]
    with av.open(str(clip.made())) as container:
        frame = next(p for k, p in enumerate(container.decode(video=0)) if k == number).to_ndarray(format="bgr24")
    corner = np.clip(np.array(middle) - np.array([wide, high]) // 2, 0, np.array(frame.shape[1::-1]) - [wide, high])
    x, y = corner
    picture = cv2.resize(frame[y : y + high, x : x + wide], CELL, interpolation=cv2.INTER_AREA)
    scale = CELL[0] / wide
    shown = tracks[(tracks.frame == number) & tracks.status.isin(list(COLOURS))]
    places = ((shown[["x_px", "y_px"]].to_numpy() - corner + 0.5) * scale - 0.5).round().astype(int)
    for at, status in zip(places.tolist(), shown.status, strict=True):
        if status == "predicted":
            cv2.drawMarker(picture, at, COLOURS[status], cv2.MARKER_CROSS, 11, 2, cv2.LINE_AA)
        else:
            cv2.circle(picture, at, 11, COLOURS[status], 2, cv2.LINE_AA)
    for at, name, status in zip(places, shown.marker, shown.status, strict=True):
        near = places[np.argsort(np.hypot(*(places - at).T))[1:5]]
        below = status != "outlier" and at[1] > near[:, 1].mean()
        _name(picture, str(name), at, below, COLOURS[status])
    title = np.full((TITLE_PX, CELL[0], 3), 255, np.uint8)
    s = score(clip, tracks)
    cv2.putText(title, called, (4, 16), FONT, 0.5, (0, 0, 0), 1, cv2.LINE_AA)
    errors = f"median {s['median']:.3f} mm, 95% {s['p95']:.3f} mm, {s['swaps']} swaps"
    cv2.putText(title, errors, (CELL[0] - 292, 16), FONT, 0.42, (60, 60, 60), 1, cv2.LINE_AA)
    return np.concatenate([title, picture])


def _name(picture: np.ndarray, name: str, at: np.ndarray, below: bool, colour: tuple[int, int, int]) -> None:
    """Above a dot, or below it where its neighbours are above, on white to be read on bed and bars alike."""
    wide, high = cv2.getTextSize(name, FONT, 0.36, 1)[0]
    x, y = int(at[0]) - wide // 2, int(at[1]) + (15 + high if below else -15)
    cv2.rectangle(picture, (x - 1, y - high - 1), (x + wide + 1, y + 2), (255, 255, 255), -1)
    cv2.putText(picture, name, (x, y), FONT, 0.36, colour, 1, cv2.LINE_AA)


def _legend() -> np.ndarray:
    """What the colours say."""
    cell = np.full((CELL[1] + TITLE_PX, CELL[0], 3), 255, np.uint8)
    said = {
        "observed": "observed: seen whole, placed to sigma_m",
        "outlier": "outlier: partly covered or odd, placed roughly",
        "predicted": "predicted (--coast): hidden, from pins and bars",
    }
    for k, (status, words) in enumerate(said.items()):
        at = (150, 110 + 40 * k)
        if status == "predicted":
            cv2.drawMarker(cell, at, COLOURS[status], cv2.MARKER_CROSS, 11, 2, cv2.LINE_AA)
        else:
            cv2.circle(cell, at, 11, COLOURS[status], 2, cv2.LINE_AA)
        cv2.putText(cell, words, (at[0] + 24, at[1] + 5), FONT, 0.42, COLOURS[status], 1, cv2.LINE_AA)
    return cell


def main() -> None:
    """Every clip in one picture, the first one's dots without rings too."""
    cells = [*(annotated(clip) for clip in CLIPS), annotated(CLIPS[0], bare=True), _legend()]
    rows = [np.concatenate(cells[k : k + COLUMNS], axis=1) for k in range(0, len(cells), COLUMNS)]
    PICTURE.parent.mkdir(exist_ok=True)
    cv2.imwrite(str(PICTURE), np.concatenate(rows), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])


if __name__ == "__main__":
    main()
