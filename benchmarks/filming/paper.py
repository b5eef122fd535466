"""The way such clips are usually measured: a colour mask, the nearest blob, four marks and a homography.

Times are frame numbers over the rate; lens, heights and rows are ignored; the marks are clicked to half a pixel.
"""

from __future__ import annotations

from pathlib import Path

import av
import cv2
import numpy as np
import pandas as pd
from scipy.optimize import linear_sum_assignment

from benchmarks.filming.clips import Clip
from benchmarks.filming.scene import BED_TAGS

GATE_PX = 40.0


def measure(clip: Clip, path: Path) -> pd.DataFrame:
    """time_s, marker, x_m, y_m of every marker in every frame; NaN where no blob is near."""
    rng, optics = np.random.default_rng(0), clip.scene.optics
    marks = np.array([BED_TAGS[k] for k in (0, 2, 3, 5)])
    clicked = optics.see(np.c_[marks, np.zeros(4)], np.zeros(4)) + rng.normal(0, 0.5, (4, 2))
    H, _ = cv2.findHomography(clicked, marks)
    names = clip.filmed.markers
    at, _ = optics.film(clip.filmed.at, 0.0)  # the first names are given by hand
    rows = []
    with av.open(str(path)) as container:
        for n, frame in enumerate(container.decode(video=0)):
            blobs = _blobs(frame.to_ndarray(format="rgb24"))
            seen = np.full((len(names), 2), np.nan)
            if len(blobs):
                away = np.hypot(*(at[:, None] - blobs[None]).transpose(2, 0, 1))
                i, j = linear_sum_assignment(np.minimum(away, 3 * GATE_PX))
                near = away[i, j] < GATE_PX
                seen[i[near]] = at[i[near]] = blobs[j[near]]
            q = np.c_[seen, np.ones(len(seen))] @ np.asarray(H).T
            rows.append(np.c_[np.full(len(names), n / clip.scene.rate), q[:, :2] / q[:, 2:]])
    table = np.concatenate(rows)
    return pd.DataFrame({"time_s": table[:, 0], "marker": names * len(rows), "x_m": table[:, 1], "y_m": table[:, 2]})


def _blobs(rgb: np.ndarray) -> np.ndarray:
    """Centres of red areas of a dot's size [px]."""
    hsv = cv2.cvtColor(rgb, cv2.COLOR_RGB2HSV)
    low, high = cv2.inRange(hsv, (0, 110, 60), (9, 255, 255)), cv2.inRange(hsv, (168, 110, 60), (180, 255, 255))
    _, _, stats, centres = cv2.connectedComponentsWithStats(low | high)
    sized = (stats[1:, cv2.CC_STAT_AREA] > 60) & (stats[1:, cv2.CC_STAT_AREA] < 700)
    return centres[1:][sized]
