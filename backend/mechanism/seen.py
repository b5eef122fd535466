"""Where the markers of a table are seen, beside where the drawing has them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from backend.mechanism.mechanism import Mechanism
from backend.mechanism.study import Experiment
from backend.mechanism.tracks import PLACES

if TYPE_CHECKING:
    import pandas as pd

INSTANTS = 40


@dataclass(frozen=True)
class Series:
    """One marker as it was seen. time_s: (n,), places_m: (n, 3) in W, NaN where not measured; drawn_m: in W, as drawn.

    body: whose it is; "" for all that is fixed.
    """

    marker: str
    body: str
    drawn_m: np.ndarray
    time_s: np.ndarray
    places_m: np.ndarray

    @property
    def measured(self) -> np.ndarray:
        """(3,): coordinates that were measured; what repeats one number while others move was written for a plane."""
        finite = np.isfinite(self.places_m).any(axis=0)
        spread = np.array([np.ptp(x[np.isfinite(x)]) if np.isfinite(x).any() else 0.0 for x in self.places_m.T])
        return finite & ((spread > 0.0) | (spread.max() == 0.0))

    def at(self, time_s: np.ndarray) -> np.ndarray:
        """Its places at some instants (k, 3), joined between samples; NaN in coordinates that were not measured."""
        places = np.full((time_s.size, 3), np.nan)
        for axis in np.flatnonzero(self.measured):
            known = np.isfinite(self.places_m[:, axis])
            places[:, axis] = np.interp(time_s, self.time_s[known], self.places_m[known, axis])
        return places


def seen(tracks: pd.DataFrame, mechanism: Mechanism) -> list[Series]:
    """The markers of a table that were measured anywhere, in drawn order."""
    names, times = tracks["marker"].to_numpy(str), tracks["time_s"].to_numpy(float)
    places = tracks[list(PLACES)].to_numpy(float)
    measured = np.isfinite(places).any(axis=1)
    found = []
    for marker in mechanism.markers:
        rows = np.flatnonzero((names == marker.id) & measured)
        if rows.size:
            body = mechanism.body(marker.body)
            p_WM = body.pose.place(marker.position_m)
            found.append(Series(marker.id, "" if body.fixed else body.id, p_WM, times[rows], places[rows]))
    return found


def recorded(experiment: Experiment, mechanism: Mechanism) -> Iterator[tuple[str, np.ndarray, np.ndarray, str]]:
    """Each coordinate that was recorded at least twice: whose, its times [s], its values, and their unit (m or rad)."""
    tracks, joints = experiment.tracks, experiment.joint_positions
    for one in [] if tracks is None else seen(tracks, mechanism):
        for x in one.places_m.T[one.measured]:
            known = np.isfinite(x)
            if known.sum() > 1:
                yield f'marker "{one.marker}"', one.time_s[known], x[known], "m"
    for id, rows in [] if joints is None else joints.dropna(subset=["q"]).groupby("joint", sort=False):
        if len(rows) > 1:
            unit = "m" if mechanism.joint(str(id)).type == "prismatic" else "rad"
            yield f'joint "{id}"', rows["time_s"].to_numpy(float), rows["q"].to_numpy(float), unit


def instants(series: list[Series]) -> np.ndarray:
    """Evenly over the time in which all of them were seen; none where they were not seen together [s]."""
    first = max((one.time_s[0] for one in series), default=0.0)
    last = min((one.time_s[-1] for one in series), default=-1.0)
    return np.linspace(first, last, INSTANTS) if first <= last else np.zeros(0)


@dataclass(frozen=True)
class Pair:
    """Two markers of one body, and how far apart they are [m]: seen (the median) and drawn, in measured coordinates."""

    one: Series
    other: Series
    seen_m: float
    drawn_m: float

    def whole(self, axis: int | None) -> bool:
        """Whether coordinates enough were measured for their distance to stay. axis: along which nothing moves."""
        measured = self.one.measured & self.other.measured
        return bool(measured.all() or (axis is not None and np.delete(measured, axis).all()))


def pairs(series: list[Series]) -> Iterator[Pair]:
    """Markers of one body: whatever the mechanism does, their distance stays, but where they turn out of the plane of
    two measured coordinates.
    """
    for one, other in combinations(series, 2):
        axes = one.measured & other.measured
        if one.body == other.body and axes.any() and (when := instants([one, other])).size:
            apart = np.linalg.norm((one.at(when) - other.at(when))[:, axes], axis=1)
            yield Pair(one, other, float(np.median(apart)), float(np.linalg.norm((one.drawn_m - other.drawn_m)[axes])))


def reach_m(mechanism: Mechanism) -> float:
    """What the parts measure together, each from end to end of its joints, markers and centre of mass [m]; all that is
    fixed is one part.
    """
    bodies = {body.id: body for body in mechanism.bodies}
    points: dict[str, list[np.ndarray]] = {}

    def add(body: str, point: tuple[float, float, float]):
        its = bodies[body]
        points.setdefault("" if its.fixed else body, []).append(its.pose.place(point))

    for joint in mechanism.joints:
        add(joint.body_a, joint.frame_a.position_m)
        add(joint.body_b, joint.frame_b.position_m)
    for marker in mechanism.markers:
        add(marker.body, marker.position_m)
    for body in mechanism.moving_bodies():
        add(body.id, body.moving_inertial().center_of_mass_m)
    return sum(float(np.linalg.norm(np.ptp(np.array(its), axis=0))) for its in points.values())
