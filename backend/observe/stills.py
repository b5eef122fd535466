"""A few pictures of a clip, to look at."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2

from backend.observe.video import Video, read_index


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
