"""An annotated clip, to see at a glance whether the right dots were followed."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

import av
import cv2
import numpy as np

from backend.observe.video import Frame

WIDTH_PX = 960
PLAYED_PER_S = 30
WATCHING = "watching.jpg"  # beside the clip while it is being written
WATCHED_EVERY_S = 1.0
COLOURS = {"observed": (80, 220, 80), "outlier": (0, 140, 255), "occluded": (60, 60, 255), "predicted": (255, 200, 0)}


class Preview:
    """Writes at most `shown_per_s` pictures of every second filmed, played at 30 pictures a second.

    Used as a context, at whose end the clip takes its place; one that was broken off leaves an earlier clip as it was.
    Until then the last picture lies beside it, every second anew, for whoever watches the work.
    """

    def __init__(self, path: Path, frames_per_s: float, size_px: tuple[int, int], shown_per_s: float = 60.0):
        self.stride = max(1, round(frames_per_s / shown_per_s))
        self.scale = min(1.0, WIDTH_PX / size_px[0])
        self.width, self.height = (int(s * self.scale) // 2 * 2 for s in size_px)
        self.watching, self._shown_at = path.with_name(WATCHING), -WATCHED_EVERY_S
        self.path, self.part = path, path.with_name(f".{path.name}")
        self.container = av.open(str(self.part), "w")
        self.stream = self.container.add_stream("libx264", rate=PLAYED_PER_S)
        self.stream.width, self.stream.height, self.stream.pix_fmt = self.width, self.height, "yuv420p"
        self.stream.options = {"preset": "ultrafast", "crf": "26"}

    def show(self, frame: Frame, markers: Sequence[str], px: np.ndarray, status: Sequence[str], radius: float) -> None:
        """Draw each marker's name and a circle in the colour of its status, and the time."""
        if frame.index % self.stride:
            return
        picture = np.ascontiguousarray(frame.bgr(self.width)[: self.height, : self.width])
        for name, at, state in zip(markers, px, status, strict=True):
            if not np.isfinite(at).all():
                continue
            spot = tuple(int(v) for v in np.round(at * self.scale))
            cv2.circle(picture, spot, max(4, round(radius * self.scale)), COLOURS[state], 1, cv2.LINE_AA)
            beside = (spot[0] + 9, spot[1] - 7)
            cv2.putText(picture, name, beside, cv2.FONT_HERSHEY_SIMPLEX, 0.42, COLOURS[state], 1, cv2.LINE_AA)
        clock = f"{frame.time_s:.3f} s   frame {frame.index}"
        cv2.putText(picture, clock, (10, 20), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (40, 40, 40), 1, cv2.LINE_AA)
        self.container.mux(self.stream.encode(av.VideoFrame.from_ndarray(picture, format="bgr24")))
        if time.monotonic() - self._shown_at >= WATCHED_EVERY_S:
            self._shown_at = time.monotonic()
            part = self.watching.with_name(f".{WATCHING}")
            part.write_bytes(cv2.imencode(".jpg", picture, (cv2.IMWRITE_JPEG_QUALITY, 80))[1].tobytes())
            part.replace(self.watching)  # never seen half written

    def __enter__(self) -> Preview:
        return self

    def __exit__(self, broken: type[BaseException] | None, *_: object) -> None:
        """Finish the file, or drop it; nothing is left to watch."""
        self.watching.unlink(missing_ok=True)
        self.container.mux(self.stream.encode(None))
        self.container.close()
        if broken:
            self.part.unlink(missing_ok=True)  # it is made with its first picture
        else:
            self.part.replace(self.path)
