"""A bar that swings on one pin in the xy plane, as its markers see it."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from tests.mechanisms import DOWN, Z, bar, drawing

TIME = np.arange(240) / 120
RELEASE_S = 0.25
NOISE_M = 2e-4
POINTS = {"tip": (0.2, 0.0, 0.0), "middle": (0.1, 0.03, 0.0), "tail": (-0.05, 0.0, 0.0)}


def pendulum(points: Mapping = POINTS, type="revolute", gravity=DOWN, effects=()):
    """Drawn level, its pin at the origin."""
    markers = [(id, "link", point) for id, point in points.items()]
    pins = [("pin", type, "ground", "link", (0, 0, 0), Z)]
    return drawing("pendulum", [bar("link", (0, 0, 0), (0.2, 0, 0))], pins, effects, markers, gravity)


def filmed(points: Mapping = POINTS, noise=NOISE_M, lean=0.0, sigma=np.nan, planar=True):
    """Held at 40 degrees below the level, then let go.  lean: of the world about y; planar: z was not measured."""
    rng = np.random.default_rng(2)
    angle = -np.pi / 2 + np.radians(50) * np.cos(7.0 * np.maximum(TIME - RELEASE_S, 0.0))
    seen = Rotation.from_euler("y", lean) * Rotation.from_euler("z", angle[:, None])
    tables = []
    for id, point in points.items():
        x, y, z = (seen.apply(point) + noise * rng.standard_normal((TIME.size, 3))).T
        z = np.full(TIME.size, np.nan) if planar else z
        tables.append(pd.DataFrame({"time_s": TIME, "marker": id, "x_m": x, "y_m": y, "z_m": z, "sigma_m": sigma}))
    return pd.concat(tables, ignore_index=True)


def swapped(table, one, other):
    return table.assign(**{one: table[other], other: table[one]})
