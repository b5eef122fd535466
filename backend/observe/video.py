"""A clip as a stream of frames, one in memory at a time, each with the time at which it was seen.

Planes stay as the camera coded them: luma at full resolution for geometry, the two colour differences at
half resolution for finding dots.  Rotation metadata is honoured, so pixels are those a viewer shows.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any, cast

import av
import numpy as np
from av.container import InputContainer
from av.error import FFmpegError
from av.video.frame import VideoFrame
from av.video.stream import VideoStream
from jaxtyping import Float, UInt8

from backend.observe.timestamps import check_times, played_slower, within_ticks
from backend.observe.tracking_error import TrackingError

THREADS = min(4, os.cpu_count() or 1)  # each decoding thread holds a frame
SQUARE = 5e-3  # pixels are square but for what rounding to even sides does
LOST_AT_START = 16  # frames: the reach of a group of pictures that refer to each other


@dataclass(frozen=True)
class Frame:
    """One picture: luma (h, w), colour differences cb and cr (h/2, w/2), time_s = PTS x time base."""

    index: int
    time_s: float
    luma: UInt8[np.ndarray, "h w"]
    cb: UInt8[np.ndarray, "h2 w2"]
    cr: UInt8[np.ndarray, "h2 w2"]
    source: VideoFrame
    quarter_turns: int

    def bgr(self, width: int | None = None) -> UInt8[np.ndarray, "h w 3"]:
        """The picture in colour, upright, scaled to `width` pixels where given."""
        picture = self.source
        if width and width < self.luma.shape[1]:
            scale = width / self.luma.shape[1]
            picture = picture.reformat(round(picture.width * scale), round(picture.height * scale))
        return np.ascontiguousarray(np.rot90(picture.to_ndarray(format="bgr24"), self.quarter_turns))


@dataclass(frozen=True)
class Index:
    """What the container says before a frame is decoded.

    times_s: presentation times, in order [s].  promised: frames the header announces (0: it does not say).
    missing_s: how much shorter the readable part is than the header says [s].  captured_per_s: the rate at which
    the camera says it filmed; None where it says nothing.  tick_s: what its stamps count in [s].  pixel_shape: width of
    a pixel over its height, as it is to be shown.
    """

    times_s: Float[np.ndarray, "frame"]
    promised: int
    missing_s: float
    damaged: int
    captured_per_s: float | None = None
    tick_s: float = 0.0
    pixel_shape: Fraction = Fraction(1)

    @property
    def truncated(self) -> bool:
        """Whether the file ends before the recording does."""
        return bool(self.damaged or self.missing_s > 1.5 * np.median(np.diff(self.times_s)))


def read_index(path: str | Path) -> Index:
    """Read every timestamp without decoding.  Raises TrackingError where there is no usable video stream."""
    name = Path(path).name
    if not Path(path).is_file():
        raise TrackingError(f"There is no file {path}. Check the name, and the folder it was saved in.")
    remedy = "Copy the recording from the camera again; if it plays nowhere, film it again."
    if Path(path).stat().st_size == 0:
        raise TrackingError(f"{name} is empty (0 bytes, 0 frames read). {remedy}")
    stamps, ends = list[int](), list[int]()
    damaged = read = 0
    try:
        with av.open(str(path), metadata_errors="replace") as container:
            if not container.streams.video:
                raise TrackingError(f"{name} has no picture in it (0 frames read). Give the film, not its sound.")
            stream = container.streams.video[0]
            base = stream.time_base or Fraction(1)
            try:
                for packet in container.demux(stream):
                    read += packet.size > 0
                    if packet.size and not packet.is_discard:
                        damaged += packet.is_corrupt
                        if packet.pts is None:
                            raise TrackingError(
                                f"{name} carries no timestamps (frame {len(stamps)} has none). Send the file as "
                                "the camera wrote it (mp4 or mov), not a raw stream cut out of it."
                            )
                        stamps.append(packet.pts)
                        ends.append(packet.pts + (packet.duration or 0))
            except FFmpegError:  # the data ends in the middle of a frame
                damaged += 1
            promised, captured = stream.frames, container.metadata.get("com.android.capture.fps")
            length_s, from_zero = _length_s(container, stream)
            shape = stream.sample_aspect_ratio or Fraction(1)
    except FFmpegError as error:
        raise TrackingError(
            f"{name} cannot be opened as a video ({error.strerror}; 0 frames read). Either it is no video, or "
            f"the recording broke off before its index was written. {remedy} A repair tool can rebuild an index from "
            "a whole clip of the same camera."
        ) from error
    if len(stamps) < 2:
        check_times(np.zeros(len(stamps)), name)
        raise TrackingError(f"{name} holds {len(stamps)} frames; motion needs at least two. {remedy}")
    times = np.sort(np.array(stamps, np.int64)) * float(base)
    # The last picture may stand longer than the others.
    ends_s = max(times[-1] + float(np.median(np.diff(times))), float(max(ends) * base))
    seen_s = ends_s - (min(times[0], 0.0) if from_zero else times[0])
    missing_s = 0.0 if read >= promised > 0 else max(0.0, length_s - seen_s)
    return Index(times, promised, float(missing_s), int(damaged), _rate(captured), float(base), shape)


def _length_s(container: InputContainer, stream: VideoStream) -> tuple[float, bool]:
    """How long the pictures last, by what the file says of them alone [s], and whether from zero or from the first.

    Zero where it does not say.
    """
    if stream.duration:
        return float(stream.duration * (stream.time_base or 1)), False
    # Matroska and WebM: a tag, "00:01:02.5"; the container's length is that of its longest track, sound included.
    said = [words for name, words in stream.metadata.items() if name.startswith("DURATION")]
    try:
        hours, minutes, seconds = map(float, said[0].split(":"))
    except (IndexError, ValueError):
        return float((container.duration or 0) / 1_000_000) if len(container.streams) == 1 else 0.0, True
    return 3600 * hours + 60 * minutes + seconds, True


def _rate(words: str | None) -> float | None:
    """A rate as a tag spells it; None for one that is none."""
    try:
        rate = float(words or "")
    except ValueError:
        return None
    return rate if np.isfinite(rate) and rate > 0 else None


def _oblong(shape: Fraction, name: str) -> list[str]:
    """Whether pixels are not square: they are taken as they are coded, which four marks see through and a stick not."""
    if abs(shape - 1) < SQUARE:
        return []
    return [
        f"{name} has pixels {float(shape):.4g} times as wide as high ({shape.numerator}:{shape.denominator}), and is "
        "measured in them as if they were square: that is wrong with a stick or a lens of one focal length, and pixels "
        f"read off a player are others. Make them square: ffmpeg -i {name} -vf scale=iw*sar:ih,setsar=1 square.mp4"
    ]


@dataclass(frozen=True)
class Part:
    """Which part of a clip counts, and what its file does not say of it.

    from_s, to_s: as a player shows them.  filmed_per_s: frames a second while filming, of slow motion that notes no
    rate; None: as the file says.
    """

    from_s: float = 0.0
    to_s: float = np.inf
    filmed_per_s: float | None = None


WHOLE = Part()


class Video:
    """A clip that was found readable, with a trustworthy clock.

    Raises TrackingError for what is no video, for a clock that jumps, and for a file that ends too early (it says how
    many frames could be read) unless `keep_truncated`: then the readable frames are served and `warnings` says what
    is missing.  part: what of it counts; frames keep their numbers.  times_s: when each frame was seen [s]; a clip that
    plays slower than it was filmed, and says so, has its times brought back.  begins_s: of the first of them, as a
    player shows it.  slower: how many times slower a player is than the motion was.
    """

    def __init__(self, path: str | Path, keep_truncated: bool = False, part: Part = WHOLE):
        self.path, self.name, self.warnings = Path(path), Path(path).name, list[str]()
        index = read_index(path)
        shown_s = index.times_s - index.times_s[0]
        (kept,) = np.nonzero((shown_s >= part.from_s) & (shown_s <= part.to_s))
        if len(kept) < 2 <= len(shown_s):
            end = f"{part.to_s:.2f} s" if np.isfinite(part.to_s) else "its end"
            raise TrackingError(
                f"{self.name} lasts {shown_s[-1]:.2f} s; {len(kept)} of its frames lie between {part.from_s:.2f} s and "
                f"{end}. Give a part of it, in seconds as a player shows them."
            )
        uneven = check_times(index.times_s[kept], self.name)
        self._stamps_s = index.times_s
        self._seen_s, of_ticks = within_ticks(index.times_s, index.tick_s, self.name)
        times_s = self._seen_s[kept]
        self.frame_count, self.truncated = len(times_s), index.truncated
        self.keep_truncated, self.promised = keep_truncated, index.promised
        self._before, self.begins_s = int(kept[0]), float(shown_s[kept[0]])
        self._pace, of_pace = played_slower(times_s, index.captured_per_s, self.name, part.filmed_per_s)
        self._told = uneven + of_ticks + of_pace + _oblong(index.pixel_shape, self.name)
        self.warnings += self._told
        self.slower = 1 / self._pace
        self.times_s = self._pace * times_s
        self.frames_per_s = 1 / float(np.median(np.diff(self.times_s)))
        if index.truncated:
            self._report(self.frame_count)

    def _report(self, read: int) -> None:
        """Refuse a file that ends too early, or note it."""
        of = f" of {self.promised}" if self.promised else ""
        found = f"{self.name} ends too early: {read}{of} frames could be read"
        if not self.keep_truncated:
            raise TrackingError(
                f"{found}. Copy the recording from the camera again, or keep the readable part (--keep-truncated)."
            )
        self.warnings = [*self._told, f"{found}; the rest is missing from the tracks."]

    def __iter__(self) -> Iterator[Frame]:
        read, last = -self._before, -np.inf
        with av.open(str(self.path), metadata_errors="replace") as container:
            stream = container.streams.video[0]
            stream.thread_type, stream.codec_context.thread_count = "AUTO", THREADS
            pictures = container.decode(stream)
            while True:
                try:
                    picture = next(pictures, None)
                except FFmpegError:
                    picture = None
                if picture is None or read == self.frame_count:
                    break
                if picture.pts is None or picture.is_corrupt or picture.time is None:
                    continue
                stamp_s = float(picture.pts * (picture.time_base or stream.time_base or Fraction(1)))
                time_s = self._pace * float(np.interp(stamp_s, self._stamps_s, self._seen_s))
                if time_s <= last:
                    continue
                last = time_s
                if read >= 0:
                    yield upright(picture, read + self._before, time_s)
                read += 1
        missing = self.frame_count - read
        # The first frames of a trimmed clip may lean on pictures that were cut away; losing more is damage.
        if self.truncated or missing > LOST_AT_START:
            self._report(read)
        elif missing:
            self.warnings.append(f"{missing} of {self.frame_count} frames of {self.name} could not be decoded.")


def upright(picture: VideoFrame, index: int, time_s: float) -> Frame:
    """The planes of a decoded picture, turned as its metadata asks."""
    if picture.rotation % 90:
        raise TrackingError(f"The clip asks to be shown turned by {picture.rotation} degrees; use multiples of 90.")
    turns = picture.rotation // 90 % 4
    if picture.format.name not in ("yuv420p", "yuvj420p"):
        picture = picture.reformat(format="yuv420p")
    planes = []
    for plane in picture.planes:
        rows = np.frombuffer(cast(Any, plane), np.uint8).reshape(plane.height, plane.line_size)[:, : plane.width]
        planes.append(np.ascontiguousarray(np.rot90(rows, turns)))
    return Frame(index, time_s, planes[0], planes[1], planes[2], picture, turns)
