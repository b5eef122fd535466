"""The annotated frames of docs/video.md: `python -m benchmarks.clip_pictures` (after benchmarks.rendered_clips).

Green circles are points called observed, orange ones outliers; blue crosses are where hidden dots are predicted.
"""

from pathlib import Path

import av
import cv2
import numpy as np

from benchmarks.filming.clips import CLIPS, FOLDER, Clip
from benchmarks.rendered_clips import with_kit

PICTURE = Path(__file__).parents[1] / "docs" / "pictures" / "video_frames.png"
SHOWN = (("300 mm card", 110), ("hand", 150), ("stickers", 40), ("tags", 60))
GREEN, ORANGE, BLUE = (60, 200, 60), (0, 140, 255), (220, 120, 20)


def annotated(clip: Clip, frame: int) -> np.ndarray:
    """One frame of a clip, at three tenths of its size, with what was found in it."""
    with av.open(str(clip.made())) as container:
        picture = next(p for k, p in enumerate(container.decode(video=0)) if k == frame).to_ndarray(format="bgr24")
    tracks = with_kit(clip, FOLDER, coast_s=10.0)
    for point in tracks[tracks.frame == frame].itertuples():
        at = tuple(round(c) for c in (point.x_px, point.y_px))
        if point.status == "predicted":
            cv2.drawMarker(picture, at, BLUE, cv2.MARKER_CROSS, 18, 2, cv2.LINE_AA)
        elif point.status != "occluded":
            cv2.circle(picture, at, 16, GREEN if point.status == "observed" else ORANGE, 2, cv2.LINE_AA)
    cv2.putText(picture, clip.name, (500, 690), cv2.FONT_HERSHEY_SIMPLEX, 1.2, (20, 20, 20), 2, cv2.LINE_AA)
    return cv2.resize(picture, None, fx=0.3, fy=0.3, interpolation=cv2.INTER_AREA)


def main() -> None:
    """Four clips in one picture."""
    found = {clip.name: clip for clip in CLIPS}
    shown = [annotated(found[name], frame) for name, frame in SHOWN]
    rows = [np.concatenate(shown[k : k + 2], axis=1) for k in (0, 2)]
    PICTURE.parent.mkdir(exist_ok=True)
    cv2.imwrite(str(PICTURE), np.concatenate(rows), [cv2.IMWRITE_PNG_COMPRESSION, 9])


if __name__ == "__main__":
    main()
