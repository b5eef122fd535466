"""What an experiment measured, as one flat list of numbers with time, channel and noise."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from backend.fit.eye import Eye, has_metres, has_pixels
from backend.fit.noise import Source, channel_noise
from backend.mechanism.study import Experiment
from backend.model.model import Model

AXES = ("x_m", "y_m", "z_m")
PIXELS = ("x_px", "y_px")


@dataclass(frozen=True)
class Channel:
    """One measured quantity: where (`joint:j1`, `marker:tip`), which coordinate, and its column in a prediction.

    Columns of a prediction: q of all joints, then x, y, z of all markers, then the effort of all joints; of a
    pixel, the marker's first.
    """

    at: str
    coordinate: str
    column: int
    unit: str
    noise: Source


@dataclass(frozen=True)
class Measured:
    """All samples of one experiment, sorted by channel, then time. time_s is as stated, `channel` indexes channels.

    still: sampled before the release, while the mechanism was held.
    """

    time_s: Float[np.ndarray, " n"]
    value: Float[np.ndarray, " n"]
    sigma: Float[np.ndarray, " n"]
    channel: Int[np.ndarray, " n"]
    channels: tuple[Channel, ...]
    release_s: float

    @property
    def column(self) -> Int[np.ndarray, " n"]:
        """Column of a prediction for each sample."""
        return np.array([c.column for c in self.channels], int)[self.channel]

    @property
    def still(self) -> np.ndarray:
        """Samples before the release."""
        return self.time_s < self.release_s

    def of(self, channel: int) -> np.ndarray:
        """Indices of one channel's samples."""
        return np.flatnonzero(self.channel == channel)


def measured(experiment: Experiment, model: Model, in_pixels: bool = False) -> Measured:
    """Gather an experiment's tables; coordinates that were not measured are skipped. So is one without a sigma that
    repeats one number while others of its marker move: written for a plane that nobody measured. Other channels that
    cannot tell their noise have the largest of those of their unit that can.

    in_pixels: tracks as places in the picture; otherwise places in the world, found through the experiment's camera
    where the tracks hold pixels alone.

    Raises ValueError naming the experiment and channel when it holds nothing, or when noise can neither be read
    nor estimated.
    """
    release = experiment.release.time_s
    parts: list[Part] = []
    channels: list[Channel] = []
    for at, coordinate, column, unit, time, value, sigma in _series(experiment, model, in_pixels):
        seen = np.isfinite(value)
        if not experiment.release.at_rest:
            seen &= time >= release  # before the release of a moving start there is nothing to predict
        if not np.any(seen):
            continue
        time, value, sigma = time[seen], value[seen], sigma[seen]
        order = np.argsort(time, kind="stable")
        time, value, sigma = time[order], value[order], sigma[order]
        noise = channel_noise(time, value, sigma, release)
        channels.append(Channel(at, coordinate, column, unit, noise.source))
        parts.append((time, value, noise.sigma))
    if not parts:
        raise ValueError(
            f"experiment '{experiment.id}' measured nothing at or after its release at {release:g} s: "
            "check its tables and its clock"
        )
    channels, parts = _all_noisy(experiment.id, channels, parts)
    lengths = [p[0].size for p in parts]
    time, value, sigma = (np.concatenate([p[i] for p in parts]) for i in range(3))
    return Measured(time, value, sigma, np.repeat(np.arange(len(parts)), lengths), tuple(channels), release)


Part = tuple[np.ndarray, np.ndarray, np.ndarray]


def _all_noisy(experiment: str, channels: list[Channel], parts: list[Part]) -> tuple[list[Channel], list[Part]]:
    """Without coordinates that nobody measured, and with a sigma where a channel could not tell its own."""
    told = [bool(np.all(np.isfinite(sigma))) for _, _, sigma in parts]
    move = {c.at for c, (_, value, _) in zip(channels, parts, strict=True) if c.unit == "m" and np.ptp(value) > 0.0}
    kept: list[tuple[Channel, Part]] = []
    for channel, part, tells in zip(channels, parts, told, strict=True):
        if not tells:
            if channel.at in move and channel.coordinate in AXES and np.ptp(part[1]) == 0.0:
                continue
            alike = [p[2].max() for c, p, t in zip(channels, parts, told, strict=True) if t and c.unit == channel.unit]
            if not alike:
                count = part[1].size
                what = "does not vary at all" if np.ptp(part[1]) == 0.0 else f"varies in too few of its {count} samples"
                raise ValueError(
                    f"experiment '{experiment}', {channel.at} {channel.coordinate} {what}, so its noise cannot be "
                    f"estimated, nor can that of any other channel in {channel.unit}. Give sigma in the data."
                )
            channel = replace(channel, noise="others")
            part = (*part[:2], np.where(np.isfinite(part[2]), part[2], max(alike)))
        kept.append((channel, part))
    return [channel for channel, _ in kept], [part for _, part in kept]


def drawn_markers(model: Model) -> dict[str, Float[np.ndarray, "3"]]:
    """World positions of the markers as drawn [m]."""
    poses, points = np.array(model.drawn_poses), np.array(model.marker_points)
    return {
        name: poses[body, :3] + Rotation.from_quat(poses[body, 3:], scalar_first=True).apply(point)
        for name, body, point in zip(model.marker_ids, model.marker_bodies, points, strict=True)
    }


def _in_world(experiment: Experiment, tracks: pd.DataFrame, model: Model) -> pd.DataFrame:
    eye = Eye.of(experiment)
    if eye is None or not has_pixels(experiment) or has_metres(experiment):
        return tracks
    return eye.placed(tracks, drawn_markers(model))


def _series(experiment: Experiment, model: Model, in_pixels: bool) -> Iterator[tuple]:
    """(at, coordinate, column, unit, time, value, sigma) of every channel."""
    joints, markers = model.topology.joint_ids, model.marker_ids
    turning = {id: type != "prismatic" for id, type in zip(joints, model.topology.joint_types, strict=True)}
    if (table := experiment.joint_positions) is not None:
        for id, rows in _groups(table, "joint"):
            unit = "rad" if turning[id] else "m"
            yield (f"joint:{id}", "q", joints.index(id), unit, *_columns(rows, "q", "sigma"))
    if (table := experiment.tracks) is not None:
        table = table if in_pixels else _in_world(experiment, table, model)
        table = table[table["status"].isin(("ok", "observed"))] if "status" in table else table
        for id, rows in _groups(table, "marker"):
            if in_pixels:
                column, whole = len(joints) + 3 * markers.index(id), rows[list(PIXELS)].notna().all(axis=1)
                for name, variance in zip(PIXELS, ("cov_xx_px2", "cov_yy_px2"), strict=True):
                    sigma = np.sqrt(rows[variance]) if variance in rows else rows["time_s"] * np.nan
                    picture = rows.assign(value=rows[name].where(whole), sigma=sigma)
                    yield (f"marker:{id}", name, column, "px", *_columns(picture, "value", "sigma"))
                continue
            for axis, name in enumerate(AXES):
                column = len(joints) + 3 * markers.index(id) + axis
                yield (f"marker:{id}", name, column, "m", *_columns(rows, name, "sigma_m"))
    if (table := experiment.joint_efforts) is not None:
        for id, rows in _groups(table, "joint"):
            column = len(joints) + 3 * len(markers) + joints.index(id)
            unit = "N m" if turning[id] else "N"
            yield (f"joint:{id}", "effort", column, unit, *_columns(rows, "effort", "sigma"))


def _groups(table, key: str) -> Iterator[tuple[str, Any]]:
    for id, rows in table.groupby(key, sort=False):
        yield str(id), rows


def _columns(rows, value: str, sigma: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return tuple(rows[name].to_numpy(float) for name in ("time_s", value, sigma))  # type: ignore[return-value]
