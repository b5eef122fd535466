"""The calibrated camera of an experiment: what its pixels mean, and how far its calibration may be wrong.

What is unknown of a camera is z ~ N(0, 1) along each axis of its covariance: lens, pose and heights err together.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Float

from backend.mechanism.study import Experiment
from backend.observe.camera import PARAMETERS, POSE_PARAMETERS, Camera, CameraPose, read_camera
from backend.observe.placing import placing_slopes
from backend.observe.viewpoint import LENS, POSE, Viewpoint

METRES = ("x_m", "y_m", "z_m")
HELD = 1e-12  # share of the largest below which an axis of the covariance is held


@dataclass(frozen=True)
class Eye:
    """A camera that stood still, from its file.  root: lens, pose and heights move by root @ z."""

    source: Path
    camera: Camera
    pose: CameraPose

    @classmethod
    def of(cls, experiment: Experiment) -> Eye | None:
        """The camera of an experiment, if it names one.  ValueError where the file says not where it stood."""
        if experiment.camera is None:
            return None
        camera = read_camera(experiment.camera)
        if camera.pose is None:
            raise ValueError(
                f"experiment '{experiment.id}': {experiment.camera.name} holds a lens and no pose. Name the "
                "camera.json that linktwin track, or linktwin calibrate with --bed, wrote for this clip."
            )
        return cls(experiment.camera, camera, camera.pose)

    @cached_property
    def view(self) -> Viewpoint:
        """Lens and pose as calibrated."""
        return Viewpoint.of(self.camera, self.pose)

    @cached_property
    def root(self) -> Float[np.ndarray, "all k"]:
        """Axes of the covariance, each as long as its deviation."""
        covariance = np.array(self.pose.covariance)
        size = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
        values, axes = np.linalg.eigh(covariance / np.outer(size, size))
        kept = values > HELD * values.max(initial=0.0)
        return size[:, None] * axes[:, kept] * np.sqrt(values[kept])

    @cached_property
    def toward(self) -> float:
        """+1 where the camera is on the side of the bed's normal, else -1."""
        return float(np.sign(self.pose.plane.from_world(self.view.p_WC)[2]))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Of the rows of root."""
        return (*PARAMETERS, *POSE_PARAMETERS, *(f"height_m of {name}" for name in self.pose.marker_height_m))

    @property
    def values(self) -> Float[np.ndarray, "all"]:
        """Calibrated values of `names`; turns count from the calibrated pose."""
        heights = list(self.pose.marker_height_m.values())
        return np.array([*self.camera.values(), 0.0, 0.0, 0.0, *self.pose.position_m, *heights])

    def height_row(self, marker: str) -> int:
        """Row of root that holds a marker's height; -1 where the drawing's is taken."""
        known = list(self.pose.marker_height_m)
        return LENS + POSE + known.index(marker) if marker in known else -1

    def slopes_on_bed(self, p_W: Float[np.ndarray, "n 3"], row: np.ndarray) -> Float[np.ndarray, "n 3 all"]:
        """How far points are misplaced in W [m] per error of the calibration; row: see `height_row`."""
        at, heights = self.pose.plane.from_world(p_W), len(self.pose.marker_height_m)
        marker = np.where(row < 0, heights, row - LENS - POSE)
        along = placing_slopes(self.view, self.pose.plane, at[:, :2], self.toward * at[:, 2], marker, heights + 1)
        return np.einsum("nia,iw->nwa", along[..., :-1], self.pose.plane.axes()[:2])

    def placed(self, tracks: pd.DataFrame, drawn_m: dict[str, Float[np.ndarray, "3"]]) -> pd.DataFrame:
        """Tracks in pixels with their places on the bed; drawn_m: where the markers are drawn, for their heights."""
        made = tracks.copy()
        made[list(METRES)], made["sigma_m"] = np.nan, np.nan
        for marker, rows in tracks.groupby("marker", sort=False):
            px = rows[["x_px", "y_px"]].to_numpy(float)
            seen = np.flatnonzero(np.isfinite(px).all(1))
            if not seen.size:
                continue
            drawn = self.toward * float(self.pose.plane.from_world(drawn_m[str(marker)])[2])
            height = np.full(seen.size, self.pose.marker_height_m.get(str(marker), drawn))
            xy = self.view.on_plane(px[seen], self.pose.plane, height)
            at = rows.index[seen]
            made.loc[at, list(METRES)] = self.pose.plane.to_world(xy)
            if "cov_xx_px2" in tracks:
                p_W = self.pose.plane.at(np.c_[xy, self.toward * height])
                J = np.linalg.inv(self.view.slopes(p_W)[1] @ self.pose.plane.axes()[:2].T)
                entries = rows.loc[at, ["cov_xx_px2", "cov_xy_px2", "cov_xy_px2", "cov_yy_px2"]].to_numpy(float)
                made.loc[at, "sigma_m"] = np.sqrt(np.einsum("nij,njk,nik->n", J, entries.reshape(-1, 2, 2), J) / 2)
        return made


def has_pixels(experiment: Experiment) -> bool:
    """Whether the tracks say where dots were seen in the picture."""
    tracks = experiment.tracks
    return tracks is not None and "x_px" in tracks and bool(np.isfinite(tracks["x_px"].to_numpy(float)).any())


def has_metres(experiment: Experiment) -> bool:
    """Whether the tracks say where dots were in the world."""
    return experiment.tracks is not None and bool(np.isfinite(experiment.tracks[list(METRES)].to_numpy(float)).any())
