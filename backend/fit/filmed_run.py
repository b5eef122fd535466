"""An experiment seen by a calibrated camera: residuals in pixels; the calibration gives way within its covariance.

Tracks that hold pixels are compared in the picture.  Tracks that hold metres alone stay in metres; what an error of the
calibration would do to them is carried to first order.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Self

import numpy as np
from jaxtyping import Float, Int

from backend.fit.eye import METRES, Eye, has_pixels
from backend.fit.measured import PIXELS, drawn_markers, measured
from backend.fit.prediction import Addresses
from backend.fit.run import Run
from backend.mechanism.study import Experiment
from backend.model.model import Model
from backend.observe.viewpoint import LENS, POSE


@dataclass(frozen=True)
class Sighting:
    """Which samples are a camera's: (marker, instant) pairs, and which of them and which coordinate each sample is.

    plain: the other samples.  height_row: of the pair's marker in the camera's covariance; raised: how much higher
    above the bed the dot was found than it is drawn [m].
    """

    plain: Int[np.ndarray, " plain"]
    seen: Int[np.ndarray, " seen"]
    pair: Int[np.ndarray, " seen"]
    axis: Int[np.ndarray, " seen"]
    since_s: Float[np.ndarray, " pairs"]
    column: Int[np.ndarray, " pairs"]
    height_row: Int[np.ndarray, " pairs"]
    raised: Float[np.ndarray, " pairs"]


@dataclass
class FilmedRun(Run):
    """A run whose own numbers may be followed by the camera's, z; without them the camera is taken at `known`."""

    eye: Eye | None = None
    in_pixels: bool = False
    known: Float[np.ndarray, " k"] = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def of(cls, experiment: Experiment, model: Model, addresses: Addresses, step_s: float) -> Self:
        """Read the tables and the camera, and find the start (from places on the bed)."""
        made, eye = super().of(experiment, model, addresses, step_s), Eye.of(experiment)
        if eye is None:
            raise ValueError(f"experiment '{experiment.id}' names no camera")
        pixels = has_pixels(experiment)
        data = measured(experiment, made.model, pixels) if pixels else made.data
        return replace(made, data=data, eye=eye, in_pixels=pixels, known=np.zeros(eye.root.shape[1]))

    @property
    def camera(self) -> Eye:
        """Its camera."""
        if self.eye is None:
            raise ValueError(f"experiment '{self.experiment.id}' has no camera")
        return self.eye

    @cached_property
    def sighting(self) -> Sighting:
        """How samples and points of the motion belong together."""
        eye, data, joints = self.camera, self.data, len(self.model.topology.joint_ids)
        axes = PIXELS if self.in_pixels else METRES
        channel = np.array([axes.index(c.coordinate) if c.coordinate in axes else -1 for c in data.channels])
        axis = channel[data.channel]
        seen = np.flatnonzero(axis >= 0)
        marker = (data.column[seen] - joints) // 3
        pairs, pair = np.unique(np.c_[marker, self.since_release_s[seen]], axis=0, return_inverse=True)
        whose, ids = pairs[:, 0].astype(int), self.model.marker_ids
        drawn = drawn_markers(self.model)
        rows = np.array([eye.height_row(name) for name in ids], int)
        height = [eye.toward * eye.pose.plane.from_world(drawn[name])[2] for name in ids]
        raised = np.array([eye.pose.marker_height_m.get(n, h) - h for n, h in zip(ids, height, strict=True)])
        return Sighting(
            np.flatnonzero(axis < 0), seen, pair.ravel(), axis[seen], pairs[:, 1], joints + 3 * whose, rows[whose],
            raised[whose],
        )  # fmt: skip

    @property
    def asked(self) -> tuple[Float[np.ndarray, " m"], Int[np.ndarray, " m"]]:
        """The plain samples, then x, y, z of every dot at every instant."""
        s = self.sighting
        since = np.concatenate([self.since_release_s[s.plain], np.repeat(s.since_s, 3)])
        return since, np.concatenate([self.data.column[s.plain], (s.column[:, None] + np.arange(3)).ravel()])

    def reported(self, value: np.ndarray, slope: np.ndarray, own: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pixels, or places as the calibration would have them; slope in (values, own, z) where own ends in z."""
        s, eye, plain = self.sighting, self.camera, self.sighting.plain.size
        with_z = own.size > self.unknowns
        z = own[self.unknowns :] if with_z else self.known
        p_W = value[plain:].reshape(-1, 3)
        p_W = p_W + np.outer(eye.toward * s.raised, eye.pose.plane.axes()[2])
        by_motion = slope[plain:].reshape(len(p_W), 3, slope.shape[1])
        out, by_point, by_z = (self._pixels if self.in_pixels else self._places)(p_W, value[plain:].reshape(-1, 3), z)
        by_motion = by_motion if by_point is None else by_point @ by_motion
        made, J = np.empty(self.data.time_s.size), np.zeros((self.data.time_s.size, slope.shape[1] + z.size))
        made[s.plain], J[s.plain, : slope.shape[1]] = value[:plain], slope[:plain]
        made[s.seen] = out[s.pair, s.axis]
        J[s.seen] = np.concatenate([by_motion[s.pair, s.axis], by_z[s.pair, s.axis]], 1)
        return made, J if with_z else J[:, : slope.shape[1]]

    def handed_back(self, value: np.ndarray, own: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Weights of what was asked of the rollout from those of what the data would say, and the camera's share."""
        s, plain = self.sighting, self.sighting.plain.size
        axes = np.concatenate([np.zeros((plain, 3)), np.tile(np.eye(3), (s.since_s.size, 1))])
        along = weight[:, None] * self.reported(value, axes, own)[1]  # slopes along x, y, z of each sample's own dot
        dots = np.zeros((s.since_s.size, 3))
        np.add.at(dots, s.pair, along[s.seen, :3])
        return np.concatenate([weight[s.plain], dots.ravel()]), along[:, 3:].sum(0)

    def _pixels(self, p_W: np.ndarray, _: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        s, eye = self.sighting, self.camera
        change, normal = eye.root @ z, eye.toward * eye.pose.plane.axes()[2]
        has, rise = s.height_row >= 0, np.zeros(len(p_W))
        rise[has] = change[s.height_row[has]]
        p_W, view = p_W + np.outer(rise, normal), eye.view.moved(change[: LENS + POSE])
        by_view, by_point = view.slopes(p_W)
        by_z = by_view @ eye.root[: LENS + POSE]
        by_z[has] += (by_point[has] @ normal)[..., None] * eye.root[s.height_row[has]][:, None]
        return view.pixels(p_W), by_point, by_z

    def _places(self, p_W: np.ndarray, seen_at: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, None, np.ndarray]:
        """The motion moves what a wrong calibration adds by next to nothing: its slope is left out."""
        by_z = self.camera.slopes_on_bed(np.nan_to_num(p_W), self.sighting.height_row) @ self.camera.root
        return seen_at + by_z @ z, None, by_z


def run_of(experiment: Experiment, model: Model, addresses: Addresses, step_s: float) -> Run:
    """The experiment through its camera, where it names one and has tracks."""
    kind = FilmedRun if experiment.camera is not None and experiment.tracks is not None else Run
    return kind.of(experiment, model, addresses, step_s)


def seen_by(run: Run, numbers: Mapping[Path, np.ndarray]) -> Run:
    """A held-out experiment through its camera as others of the same camera have found it."""
    if isinstance(run, FilmedRun) and run.camera.source in numbers:
        return replace(run, known=numbers[run.camera.source], _last=None)
    return run
