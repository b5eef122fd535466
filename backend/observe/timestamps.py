"""Whether a clip's clock can be believed.

Time is the presentation timestamp of each frame.  Phones drop frames and vary their rate, which is
harmless as long as the stamps are true.  A slow-motion export is not: editors stretch part of the clip, and
its stamps then say when a frame is to be shown, not when it was seen.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from backend.observe.tracking_error import TrackingError

STEADY_FRAMES = 9  # a change of pace that lasts this long is no dropped frame
UNEVEN = 1.4  # a pace that changes by so much is told
RAMP_FACTOR = 2.5  # a phone in the dark halves its rate; slow motion is stretched 4 to 8 times
FINE_S = 1e-4  # ticks shorter than this move a dot at 1 m/s by less than 0.03 mm
WITHIN_TICKS = 1.25  # stamps of an even pace, rounded, scatter by one tick; a quarter for a pace that is fitted
NTSC = 0.002  # 240 of a camera may be 239.76: 1.001, and as much again
GAP_FRAMES = 12  # a longer hole cannot be bridged by predicting where the dots went

ORIGINAL = (
    "Send the original file from the camera, not an edited, shared or slowed-down export: by cable from the camera's "
    'DCIM folder, or from an iPhone by AirDrop with "All Photos Data", or "Export Unmodified Original" in Photos.'
)


def played_slower(
    times_s: Float[np.ndarray, "frame"], captured_per_s: float | None, name: str, filmed_per_s: float | None = None
) -> tuple[float, list[str]]:
    """What to multiply the stamps by so that they are the times of the motion, and the sentence that says so.

    Some cameras write slow motion as one even clip at 30 frames a second, and the rate at which it was filmed
    beside it (`com.android.capture.fps`).  Others note nothing; who knows the rate says it: filmed_per_s.
    """
    step = np.diff(times_s)
    # The mean of what is no gap: the median of 33 and 34 ms is not a thirtieth of a second.
    played_per_s = 1 / float(step[np.abs(step / np.median(step) - 1) < 0.5].mean())
    if filmed_per_s is None and (captured_per_s is None or captured_per_s < RAMP_FACTOR * played_per_s):
        return 1.0, []
    said = "as its camera noted" if filmed_per_s is None else "as was said"
    captured_per_s = filmed_per_s or captured_per_s or played_per_s
    slower = captured_per_s / played_per_s
    # Stretched a whole number of times, where that is meant: 1000 played at 30 is 33.3 times.
    slower = round(slower) if abs(slower - round(slower)) < min(NTSC * slower, 0.1) else slower
    return 1 / slower, [
        f"{name} was filmed at {captured_per_s:.4g} frames a second, {said}, and plays at "
        f"{played_per_s:.4g}: its times are divided by {slower:.4g}."
    ]


def within_ticks(
    stamps_s: Float[np.ndarray, "frame"], tick_s: float, name: str
) -> tuple[Float[np.ndarray, "frame"], list[str]]:
    """Times of the frames, and what to say of them, where stamps count ticks as coarse as Matroska's milliseconds.

    stamps_s: increasing.  An even pace that every stamp agrees with, but for its rounding, is taken for the camera's
    own, dropped frames and all; other stamps are left as they are.
    """
    step = np.diff(stamps_s)
    if tick_s < FINE_S or not len(step) or step.min() <= 0:
        return stamps_s, []
    usual = float(step[np.abs(step - np.median(step)) < 1.5 * tick_s].mean())
    count = np.r_[0, np.cumsum(np.rint(step / usual))]
    pace_s, begun_s = np.polyfit(count, stamps_s, 1)
    scatter = float(np.ptp(stamps_s - pace_s * count)) / tick_s
    if scatter < 0.01:  # a frame every so many ticks: nothing was rounded
        return stamps_s, []
    ticks = f"{name} stamps its frames in ticks of {1e3 * tick_s:.2g} ms"
    if scatter <= WITHIN_TICKS and tick_s < pace_s / 2:
        even = f"{ticks}; all agree with {1 / pace_s:.5g} frames a second, dropped ones left out, which is taken."
        return begun_s + pace_s * count, [even]
    return stamps_s, [
        f"{ticks} and at no even pace: a dot at 1 m/s is placed {1e3 * tick_s / np.sqrt(12):.2f} mm off (rms) along "
        "its way. Send the file as the camera wrote it, if this one was made of it."
    ]


def check_times(times_s: Float[np.ndarray, "frame"], name: str) -> list[str]:
    """What to say of a clock whose pace changes; one that stands still, runs backwards, has a hole, or changes its pace
    as no camera does is refused.

    times_s: presentation times in display order [s].  Raises TrackingError with the frame and the remedy.
    """
    step, told = np.diff(times_s), list[str]()
    if len(step) == 0:
        raise TrackingError(f"{name} holds one frame; motion needs at least two. Is it a picture, not a clip?")
    if (k := int(np.argmin(step))) is not None and step[k] <= 0:
        raise TrackingError(
            f"{name}: the clock jumps from {times_s[k]:.4f} s to {times_s[k + 1]:.4f} s "
            f"between frames {k} and {k + 1}. {ORIGINAL}"
        )
    if len(step) >= 2 * STEADY_FRAMES:
        windows = np.lib.stride_tricks.sliding_window_view(step, STEADY_FRAMES)
        pace = np.median(windows, axis=1)
        slow, fast = int(np.argmax(pace)), int(np.argmin(pace))
        change = (
            f"{name}: frames are {1e3 * pace[fast]:.2f} ms apart near frame {fast} and {1e3 * pace[slow]:.2f} ms near "
            f"frame {slow}: "
        )
        if pace.max() > RAMP_FACTOR * pace.min():
            raise TrackingError(
                f"{change}a slow-motion ramp is baked into this clip, and its times are not the times of the motion. "
                f"{ORIGINAL}"
            )
        if pace.max() > UNEVEN * pace.min():
            told.append(
                f"{change}taken for a camera that slows in poor light. If an editor did it, times are wrong. {ORIGINAL}"
            )
    k, usual = int(np.argmax(step)), float(np.median(step))
    if step[k] > GAP_FRAMES * usual:
        raise TrackingError(
            f"{name}: the clock jumps by {1e3 * step[k]:.1f} ms after frame {k} "
            f"(frames are usually {1e3 * usual:.2f} ms apart). {ORIGINAL}"
        )
    return told
