"""What was seen, frame by frame, and its place in the world."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from jaxtyping import Float, Int

from backend.observe.bed import Bed
from backend.observe.detect import Detections
from backend.observe.follow_bed import ShakenView
from backend.observe.project import AbstractView
from backend.observe.rows import Rows
from backend.observe.stretch import stretch_factor
from backend.observe.uncertainty import point_covariance, track_noise
from backend.observe.write import tracks_table

STATUSES = np.array(["observed", "outlier", "occluded", "predicted"], object)


class Record:
    """Points of every frame so far, in arrays laid out at the start: a minute at 240 frames a second is long."""

    def __init__(self, frames: int, markers: int):
        self.length = 0
        self._time_s, self._frame = np.zeros(frames), np.zeros(frames, int)
        self._px = np.full((frames, markers, 2), np.nan)
        self._cov = np.full((frames, markers, 2, 2), np.nan, np.float32)
        self._expected = np.full((frames, markers, 2), np.nan, np.float32)
        self._reach = np.full((frames, markers), np.nan, np.float32)
        self._state = np.full((frames, markers), 2, np.int8)

    def add(
        self,
        time_s: float,
        frame: int,
        index: Int[np.ndarray, "marker"],
        found: Detections,
        expected_px: Float[np.ndarray, "marker 2"],
        reach_px: Float[np.ndarray, "marker"],
    ) -> None:
        """Note one frame: each marker's detection (-1: none), where it was expected, how far off that may be."""
        n, seen = self.length, index >= 0
        self._time_s[n], self._frame[n], self._expected[n] = time_s, frame, expected_px
        self._reach[n] = reach_px
        self._px[n, seen], self._cov[n, seen] = found.px[index[seen]], found.cov_px2[index[seen]]
        self._state[n, seen] = np.where(found.whole[index[seen]], 0, 1)
        self.length += 1

    @property
    def times_s(self) -> Float[np.ndarray, "frame"]:
        """Time of each frame [s]."""
        return self._time_s[: self.length]

    @property
    def frames(self) -> Int[np.ndarray, "frame"]:
        """Number of each frame in the clip."""
        return self._frame[: self.length]

    @property
    def px(self) -> Float[np.ndarray, "frame marker 2"]:
        """Where each marker was seen [px]; NaN where it was not."""
        return self._px[: self.length]

    @property
    def expected_px(self) -> Float[np.ndarray, "frame marker 2"]:
        """Where each marker was expected [px]."""
        return self._expected[: self.length]

    @property
    def expected_sd_px(self) -> Float[np.ndarray, "frame marker"]:
        """The standard deviation of each expectation [px]."""
        return self._reach[: self.length] / 3

    @property
    def cov_px2(self) -> Float[np.ndarray, "frame marker 2 2"]:
        """What each picture's noise alone does to each place [px^2]."""
        return self._cov[: self.length]

    @property
    def status(self) -> np.ndarray:
        """observed, outlier or occluded, (frame, marker)."""
        return STATUSES[self._state[: self.length]]


def place(
    seen: Record,
    names: Sequence[str],
    radius_px: float,
    view: AbstractView,
    bed: Bed,
    heights_m: Float[np.ndarray, "marker"],
    coast_s: float,
    rows: Rows,
    bodies: Sequence[str],
    shaken: ShakenView | None = None,
) -> pd.DataFrame:
    """The table of tracks: every point on the bed, with the deviation that its pixels' covariance gives it.

    radius_px: of a target.  heights_m: of each marker above the marks' plane.  coast_s: gaps up to this long hold
    predictions, with the deviation that they were made with.  rows: of the sensor; a point is as late as its row is
    read.  bodies: what carries each marker.
    shaken: the views of a camera that moved.
    """
    times, px, status = seen.times_s, seen.px.copy(), seen.status
    row = rows.share(np.where(np.isfinite(px), px, seen.expected_px))
    own_s = times[:, None] + bed.readout_s * np.clip(row, 0, 1)
    cov = point_covariance(times, px, seen.cov_px2, status == "observed")
    # A dot of which half is covered has its centroid 0.42 radii off.
    cov[status == "outlier"] += (0.5 * radius_px) ** 2 * np.eye(2)
    if coast_s > 0:
        last = np.maximum.accumulate(np.where(np.isfinite(px[..., 0]), times[:, None], -np.inf), axis=0)
        gap = times[:, None] - last
        fill = (status == "occluded") & (gap <= coast_s)
        px[fill], status[fill] = seen.expected_px[fill], "predicted"
        cov[fill] = (seen.expected_sd_px[fill] ** 2 + 1.0)[:, None, None] * np.eye(2)
    world, sigma = in_world(px, cov, view, bed, heights_m)
    if shaken:
        f, m = np.nonzero(np.isfinite(px[..., 0]))
        at = shaken.metres(px[f, m], heights_m[m], f, own_s[f, m])
        world[f, m] = bed.plane.to_world(at)
        sigma, cov = _with_unsteady_view(own_s, f, m, at, sigma, cov)
    sigma, cov = _unstretched(world, own_s, sigma, cov, status, bodies, bed)
    return tracks_table(names, own_s, seen.frames, world, sigma, px, cov, status)


def _with_unsteady_view(
    own_s: np.ndarray, f: np.ndarray, m: np.ndarray, at_m: np.ndarray, sigma: np.ndarray, cov: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Deviations that hold the noise of every picture's own pose too, measured along the tracks on the bed."""
    xy = np.full((*sigma.shape, 2), np.nan)
    xy[f, m] = at_m
    more = np.ones(sigma.shape[1])
    for k in range(len(more)):
        noise = track_noise(own_s[:, k], xy[:, k])
        if noise is not None:
            more[k] = max(1.0, np.trace(noise) / 2 / np.nanmedian(sigma[:, k]) ** 2)
    return sigma * np.sqrt(more), cov * more[:, None, None]


def _unstretched(
    world: np.ndarray,
    own_s: np.ndarray,
    sigma: np.ndarray,
    cov: np.ndarray,
    status: np.ndarray,
    bodies: Sequence[str],
    bed: Bed,
) -> tuple[np.ndarray, np.ndarray]:
    """Deviations and covariances made as large as the distances of dots on one bar say they are."""
    at = np.where((status == "observed")[..., None], bed.plane.from_world(np.nan_to_num(world))[..., :2], np.nan)
    factor = stretch_factor(at, own_s, sigma, bodies)
    return np.sqrt(factor) * sigma, factor * cov


def in_world(
    px: Float[np.ndarray, "frame marker 2"],
    cov_px2: Float[np.ndarray, "frame marker 2 2"],
    view: AbstractView,
    bed: Bed,
    heights_m: Float[np.ndarray, "marker"],
) -> tuple[Float[np.ndarray, "frame marker 3"], Float[np.ndarray, "frame marker"]]:
    """World positions [m] of pixels, and the deviation per axis [m] that their covariance gives; NaN stays NaN."""
    world, sigma = np.full((*px.shape[:2], 3), np.nan), np.full(px.shape[:2], np.nan)
    for m in range(px.shape[1]):
        known = np.isfinite(px[:, m, 0])
        height = np.full(known.sum(), heights_m[m])
        world[known, m] = bed.plane.to_world(view.metres(px[known, m], height))
        J = view.slope(px[known, m], height)
        sigma[known, m] = np.sqrt(np.einsum("nij,njk,nik->n", J, cov_px2[known, m], J) / 2)
    return world, sigma
