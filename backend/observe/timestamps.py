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
RAMP_FACTOR = 2.5  # a phone in the dark halves its rate; slow motion is stretched 4 to 8 times
GAP_FRAMES = 12  # a longer hole cannot be bridged by predicting where the dots went


def check_times(times_s: Float[np.ndarray, "frame"], name: str) -> None:
    """Refuse a clock that stands still, runs backwards, has a hole, or changes its pace for good.

    times_s: presentation times in display order [s].  Raises TrackingError with the frame and the remedy.
    """
    step = np.diff(times_s)
    if len(step) == 0:
        raise TrackingError(f"{name} holds one frame; motion needs at least two. Is it a picture, not a clip?")
    original = "Send the original file from the camera, not an edited, shared or slowed-down export."
    if (k := int(np.argmin(step))) is not None and step[k] <= 0:
        raise TrackingError(
            f"{name}: the clock jumps from {times_s[k]:.4f} s to {times_s[k + 1]:.4f} s "
            f"between frames {k} and {k + 1}. {original}"
        )
    if len(step) >= 2 * STEADY_FRAMES:
        windows = np.lib.stride_tricks.sliding_window_view(step, STEADY_FRAMES)
        pace = np.median(windows, axis=1)
        if pace.max() > RAMP_FACTOR * pace.min():
            slow, fast = int(np.argmax(pace)), int(np.argmin(pace))
            raise TrackingError(
                f"{name}: frames are {1e3 * pace[fast]:.2f} ms apart near frame {fast} and "
                f"{1e3 * pace[slow]:.2f} ms near frame {slow}: a slow-motion ramp is baked into this clip, "
                f"and its times are not the times of the motion. {original}"
            )
    k, usual = int(np.argmax(step)), float(np.median(step))
    if step[k] > GAP_FRAMES * usual:
        raise TrackingError(
            f"{name}: the clock jumps by {1e3 * step[k]:.1f} ms after frame {k} "
            f"(frames are usually {1e3 * usual:.2f} ms apart). {original}"
        )
