"""When and by what camera a file's pixels were seen: the clip itself, or its frame rate alone."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int, UInt8

from backend.observe.bed import Bed
from backend.observe.project import AbstractView, calibrate, view_in_picture
from backend.observe.seen_bed import bed_in_picture
from backend.observe.tracking_error import TrackingError
from backend.observe.video import Part, Video


@dataclass(frozen=True)
class Footage:
    """What is known of the clip: every frame's time and the first picture, upright, or a rate, or nothing.

    times_s (frame) [s].  quarter_turns: by which its pictures were turned to the left to be upright.
    """

    name: str = ""
    times_s: Float[np.ndarray, "frame"] | None = None
    luma: UInt8[np.ndarray, "h w"] | None = None
    quarter_turns: int = 0
    frames_per_s: float | None = None
    warnings: tuple[str, ...] = ()

    @property
    def size_px(self) -> tuple[int, int] | None:
        """Width and height of the picture; None without a clip."""
        return None if self.luma is None else (self.luma.shape[1], self.luma.shape[0])

    def times(self, frame: Int[np.ndarray, "n"], source: str) -> Float[np.ndarray, "n"]:
        """The time of each frame [s].  Raises TrackingError where the clip does not reach so far, or is unknown."""
        if self.times_s is not None:
            if len(frame) and frame[-1] >= len(self.times_s):
                raise TrackingError(
                    f"{source} has frame {frame[-1]}, and {self.name} has {len(self.times_s)} frames (0 to "
                    f"{len(self.times_s) - 1}). Give the clip in which these points were tracked."
                )
            return self.times_s[frame]
        if self.frames_per_s is None:
            raise TrackingError(
                f"{source} counts frames and holds no times. Give --video CLIP, whose own clock is used, or --fps N."
            )
        return frame / self.frames_per_s

    def seen(self, bed: Bed) -> tuple[Bed, list[str]]:
        """The bed with its tags found and its saved camera made to fit, and what to warn of.  Raises TrackingError."""
        if self.luma is not None:
            return bed_in_picture(bed, self.luma)
        if need := [what for what, given in (("tags", bed.tags), ("camera", bed.camera)) if given]:
            raise TrackingError(
                f"The bed file's {' and '.join(need)} need a picture: tags are found in the clip's first one, a saved "
                "camera is made to fit its size. Give --video CLIP."
            )
        return bed, []

    def view(self, bed: Bed, px: Float[np.ndarray, "n 2"]) -> tuple[AbstractView, tuple[int, int]]:
        """The camera's view of the bed as `seen`, and the picture's width and height [px].

        Without the clip the picture is taken to end where marks and points `px` do, which matters to warnings
        alone; where the view itself needs the picture's middle, a TrackingError asks for the clip.
        """
        if self.size_px is not None:
            width, height = self.size_px
            if len(px) and ((px < -0.5 - width / 10) | (px > np.array(self.size_px) + width / 10)).any():
                raise TrackingError(
                    f"Points lie up to ({px[:, 0].max():.0f}, {px[:, 1].max():.0f}) px, outside the {width} x {height} "
                    f"picture of {self.name}. Were they tracked in a scaled, cropped or turned copy? Give that copy, "
                    "and the bed marks' pixels in it."
                )
            return view_in_picture(bed, width, height), self.size_px
        if bed.camera_height_m is not None if bed.lens is None else bed.lens.centre_px is None:
            need = "camera_height_m" if bed.lens is None else "lens without centre_px"
            raise TrackingError(f"The bed's {need} needs the middle of the picture. Give --video CLIP.")
        if bed.readout_s:
            raise TrackingError("The bed's readout_s dates points by the picture's height. Give --video CLIP.")
        u, v = (np.concatenate([bed.pixels(), px]).max(0) + 1).tolist()
        return calibrate(bed, round(u), round(v)), (round(u), round(v))


def footage(video: Path | None, frames_per_s: float | None, filmed_per_s: float | None = None) -> Footage:
    """What is known from --video or --fps.  Raises TrackingError for both, or a rate that is none.

    filmed_per_s: the rate [1/s] at which slow motion was filmed, of a clip that does not note it.
    """
    if video is not None and frames_per_s is not None:
        raise TrackingError("Give --video or --fps, not both: the clip has its own clock.")
    if filmed_per_s is not None and video is None:
        raise TrackingError("--filmed-at says how slow motion was filmed. Give --video CLIP, which it belongs to.")
    if frames_per_s is not None:
        if not (np.isfinite(frames_per_s) and frames_per_s > 0):
            raise TrackingError(f"--fps is {frames_per_s:g}; give the frames per second, above zero.")
        note = f"Times are frame / {frames_per_s:g}: cameras vary their rate. Give --video CLIP for its own clock."
        return Footage(frames_per_s=frames_per_s, warnings=(note,))
    if video is None:
        return Footage()
    clip = Video(video, keep_truncated=True, part=Part(filmed_per_s=filmed_per_s))
    first = next(iter(clip), None)
    if first is None:
        raise TrackingError(f"{clip.name}: not one frame can be decoded (0 frames read). Copy it again.")
    return Footage(clip.name, clip.times_s, first.luma, first.quarter_turns, warnings=tuple(clip.warnings))
