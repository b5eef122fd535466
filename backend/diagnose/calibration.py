"""What a calibrated camera may have wrong, as numbers beside the library's: a diagnosis must not name a cause for it.

Experiments may name the camera file of their clip.  Lens, pose and heights err together, by z ~ N(0, 1) along each axis
of their covariance (backend/fit/eye.py); to first order that shifts each place on the bed.  The numbers z are free in
every fit, like tolerances; clips of one file share them, held-out ones too.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from backend.diagnose.library import Library
from backend.fit.eye import METRES, Eye
from backend.fit.free import FreeParameter
from backend.fit.measured import Measured, drawn_markers
from backend.mechanism.study import Study
from backend.model.model import Model


def cameras_of(study: Study) -> dict[Path, Eye]:
    """Camera files of a study's experiments."""
    eyes = (Eye.of(e) for e in study.experiments if e.tracks is not None)
    return {eye.source: eye for eye in eyes if eye is not None}


def with_cameras(library: Library, cameras: Mapping[Path, Eye]) -> Library:
    """The library with the numbers of each camera as its last parameters."""
    numbers = tuple(
        FreeParameter(
            "calibration", ("camera",), f"camera{c + 1}", f"z[{k}]", "1", -np.inf, np.inf, 0.0, (), 1.0, nuisance=True
        )
        for c, eye in enumerate(cameras.values())
        for k in range(eye.root.shape[1])
    )
    first = len(library.parameters)
    return replace(
        library,
        parameters=(*library.parameters, *numbers),
        nuisances=(*library.nuisances, *range(first, first + len(numbers))),
        neutral=(*library.neutral, *np.zeros(len(numbers)).tolist()),
    )


@dataclass(frozen=True)
class Misplaced:
    """How far samples of one experiment are moved by the numbers of all cameras, of which `eye` took it.

    seen: samples that are its own; pair, axis: which point of the motion, and which coordinate of it, each of them is.
    drawn, height_m, height_row: of the points: what is not measured of them, and their height above the bed.
    """

    eye: Eye
    columns: slice
    every: int
    seen: Int[np.ndarray, " seen"]
    pair: Int[np.ndarray, " seen"]
    axis: Int[np.ndarray, " seen"]
    drawn: Float[np.ndarray, "pairs 3"]
    height_m: Float[np.ndarray, " pairs"]
    height_row: Int[np.ndarray, " pairs"]

    @classmethod
    def of(cls, data: Measured, model: Model, cameras: Mapping[Path, Eye], source: Path | None) -> Misplaced | None:
        """None where no camera took it."""
        if source is None or source not in cameras:
            return None
        eye, drawn = cameras[source], drawn_markers(model)
        ends = np.cumsum([0, *[other.root.shape[1] for other in cameras.values()]]).tolist()
        own = list(cameras).index(source)
        marker = np.array([c.at.removeprefix("marker:") for c in data.channels])[data.channel]
        coordinate = np.array([METRES.index(c.coordinate) if c.coordinate in METRES else -1 for c in data.channels])
        axis = coordinate[data.channel]
        seen = np.flatnonzero(axis >= 0)
        if not seen.size:
            return None
        names, index = np.unique(marker[seen], return_inverse=True)
        pairs, pair = np.unique(np.c_[index, data.time_s[seen]], axis=0, return_inverse=True)
        whose = pairs[:, 0].astype(int)
        at = np.array([drawn[n] for n in names])
        height = [eye.pose.marker_height_m.get(n, eye.toward * eye.pose.plane.from_world(drawn[n])[2]) for n in names]
        rows = np.array([eye.height_row(n) for n in names])
        return cls(
            eye, slice(ends[own], ends[own + 1]), ends[-1], seen, pair.ravel(), axis[seen], at[whose],
            np.array(height)[whose], rows[whose],
        )  # fmt: skip

    def slopes(self, value: Float[np.ndarray, " samples"]) -> Float[np.ndarray, "samples z"]:
        """About predicted places: measured ones carry noise, which the slopes would then explain."""
        p_W = self.drawn.copy()
        p_W[self.pair, self.axis] = np.nan_to_num(value[self.seen])
        p_bed = self.eye.pose.plane.from_world(p_W)
        p_bed[:, 2] = self.eye.toward * self.height_m
        by_z = self.eye.slopes_on_bed(self.eye.pose.plane.at(p_bed), self.height_row) @ self.eye.root
        made = np.zeros((value.size, self.every))
        made[self.seen, self.columns] = by_z[self.pair, self.axis]
        return made
