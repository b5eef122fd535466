"""Tables in another unit than the contract's: places in millimetres."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from backend.mechanism.mechanism import Mechanism
from backend.mechanism.tracks import PLACES

if TYPE_CHECKING:
    import pandas as pd

FAR = 100.0  # times all that the parts measure together: no mechanism reaches so far, and millimetres are a thousand


def far_tracks(tracks: pd.DataFrame, mechanism: Mechanism) -> Iterator[str]:
    """A sentence where markers are seen so far from where they are drawn that their places can be in no metres."""
    reach, bodies = reach_m(mechanism), {body.id: body.pose for body in mechanism.bodies}
    drawn = {
        marker.id: np.array(bodies[marker.body].position_m)
        + bodies[marker.body].rotation() @ np.array(marker.position_m)
        for marker in mechanism.markers
    }
    places = tracks[list(PLACES)].to_numpy(float)
    measured = np.isfinite(places).any(axis=1)
    if not measured.any() or not reach:
        return
    names, whose = np.unique(tracks["marker"].to_numpy(str)[measured], return_inverse=True)
    off = places[measured] - np.array([drawn[name] for name in names])[whose]
    away = np.sqrt(np.nansum(off**2, axis=1))[np.argsort(whose, kind="stable")]
    far = [float(np.median(its)) for its in np.split(away, np.cumsum(np.bincount(whose))[:-1])]
    most = max(far)
    if most > FAR * reach:
        yield (
            f'marker "{names[far.index(most)]}" is seen {most:.4g} m from where it is drawn (the median), '
            f"{most / reach:.3g} times what all parts measure together, {reach:.3g} m; places are in m (1 mm is "
            "0.001), in the drawing's world frame"
        )


def reach_m(mechanism: Mechanism) -> float:
    """What the parts measure together, each from end to end of its joints, markers and centre of mass [m]."""
    points: dict[str, list[tuple[float, float, float]]] = {body.id: [] for body in mechanism.bodies}
    for joint in mechanism.joints:
        points[joint.body_a].append(joint.frame_a.position_m)
        points[joint.body_b].append(joint.frame_b.position_m)
    for marker in mechanism.markers:
        points[marker.body].append(marker.position_m)
    for body in mechanism.moving_bodies():
        points[body.id].append(body.moving_inertial().center_of_mass_m)
    return sum(float(np.linalg.norm(np.ptp(np.array(its), axis=0))) for its in points.values() if its)
