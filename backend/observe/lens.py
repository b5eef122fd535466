"""How a lens bends rays: Brown's model, as in Hartley and Zisserman ch. 7 and in OpenCV's calibration."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from jaxtyping import Float
from pydantic import Field

from backend.observe.described import Described, Number

Points = Float[np.ndarray, "n 2"]
Focal = Annotated[Number, Field(gt=0)]
NEWTON_STEPS = 12  # four suffice for a phone's lens, eight for a wide-angle one


class Lens(Described):
    """Focal length [px], alike or (x, y); distortion; optical centre [px] (default: the picture's middle).

    k1, k2, k3: radial.  p1, p2: tangential.
    """

    focal_px: Focal | tuple[Focal, Focal]
    k1: Number = 0.0
    k2: Number = 0.0
    p1: Number = 0.0
    p2: Number = 0.0
    k3: Number = 0.0
    centre_px: tuple[Number, Number] | None = None

    def focal(self) -> Float[np.ndarray, "2"]:
        """Focal lengths along x and y [px]."""
        return np.broadcast_to(np.asarray(self.focal_px, float), 2)


def bend(xy: Points, lens: Lens) -> Points:
    """Where rays of slopes x/z, y/z meet the picture, in focal lengths from the optical centre."""
    x, y = xy[:, :1], xy[:, 1:]
    r2 = x**2 + y**2
    radial = 1 + r2 * (lens.k1 + r2 * (lens.k2 + r2 * lens.k3))
    cross = 2 * x * y
    tangential = np.c_[
        lens.p1 * cross + lens.p2 * (r2 + 2 * x**2),
        lens.p1 * (r2 + 2 * y**2) + lens.p2 * cross,
    ]
    return xy * radial + tangential


def straighten(px: Points, lens: Lens, centre_px: Float[np.ndarray, "2"]) -> Points:
    """Slopes x/z, y/z of the rays through pixels: the distortion undone by Newton's method."""
    seen = (px - centre_px) / lens.focal()
    xy = seen
    for _ in range(NEWTON_STEPS if any((lens.k1, lens.k2, lens.k3, lens.p1, lens.p2)) else 0):
        xy = xy - np.linalg.solve(_slope(xy, lens), (bend(xy, lens) - seen)[..., None])[..., 0]
    return xy


def bend_slopes(xy: Points, lens: Lens) -> tuple[Float[np.ndarray, "n 2 2"], Float[np.ndarray, "n 2 5"]]:
    """d(bend)/d(xy), and d(bend)/d(k1, k2, p1, p2, k3)."""
    x, y = xy.T
    r2 = x**2 + y**2
    along_x = np.stack([x * r2, x * r2**2, 2 * x * y, r2 + 2 * x**2, x * r2**3], -1)
    along_y = np.stack([y * r2, y * r2**2, r2 + 2 * y**2, 2 * x * y, y * r2**3], -1)
    return _slope(xy, lens), np.stack([along_x, along_y], -2)


def _slope(xy: Points, lens: Lens) -> Float[np.ndarray, "n 2 2"]:
    """d(bend)/d(xy)."""
    x, y = xy.T
    r2 = x**2 + y**2
    radial = 1 + r2 * (lens.k1 + r2 * (lens.k2 + r2 * lens.k3))
    growth = 2 * (lens.k1 + r2 * (2 * lens.k2 + 3 * r2 * lens.k3))
    mixed = growth * x * y + 2 * (lens.p1 * x + lens.p2 * y)
    along_x = radial + growth * x**2 + 2 * lens.p1 * y + 6 * lens.p2 * x
    along_y = radial + growth * y**2 + 6 * lens.p1 * y + 2 * lens.p2 * x
    return np.stack([np.stack([along_x, mixed], -1), np.stack([mixed, along_y], -1)], -2)
