"""A few pictures of a clip, to look at."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2

from backend.observe.tracking_error import TrackingError
from backend.observe.video import Part, Video, read_index


def stills(clip: str | Path, parts: Sequence[float], width_px: int = 640) -> tuple[tuple[float, bytes], ...]:
    """(time [s], PNG bytes) of the frames at these parts of a clip, 0 its first and 1 its last."""
    last = len(read_index(clip).times_s) - 1
    wanted = {round(part * last) for part in parts}
    found = []
    for frame in Video(clip):
        if frame.index in wanted:
            _, png = cv2.imencode(".png", frame.bgr(width_px))
            found.append((frame.time_s, png.tobytes()))
    return tuple(found)


def still(clip: str | Path, part: float, from_s: float = 0.0) -> tuple[float, bytes, tuple[int, int]]:
    """Time [s], PNG bytes, width and height [px] of the frame at this part of a clip; no frame after it is decoded.

    from_s: leave out what comes before, as a player shows it.
    """
    video = Video(clip, part=Part(from_s))
    wanted = round(part * (video.frame_count - 1))
    for number, frame in enumerate(video):
        if number == wanted:
            picture = frame.bgr()
            _, png = cv2.imencode(".png", picture)
            return frame.time_s, png.tobytes(), (picture.shape[1], picture.shape[0])
    raise TrackingError(f"{Path(clip).name}: frame {wanted} cannot be decoded. Copy the clip again.")
