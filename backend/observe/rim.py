"""The centre of a dot that has no ring, from where its rim is.

Beside a bare dot lie a bar on one side and the bed on another, so its light has no common surroundings to be weighed
against.  Along each ray from its middle the rim is where the light is half way between the dot's and what comes next;
a circle through those points is the dot (least squares, Huber's weights).
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, UInt8

from backend.observe.dots import ANGLES, DotLook, radial_profile

STEP_PX = 0.25
PASSES, HUBER_PX = 6, 0.3
LEAST_CONTRAST = 8.0  # codes; a ray with less tells nothing


def fit_rims(
    luma: UInt8[np.ndarray, "h w"], px: Float[np.ndarray, "n 2"], look: DotLook
) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2 2"], Float[np.ndarray, "n"]]:
    """Centres [px], what the rims' scatter does to them [px^2], and the share of rays on which the rim was found."""
    radii = np.arange(0.4 * look.radius_px, 1.6 * look.radius_px + 1, STEP_PX)
    ray = np.stack([np.cos(ANGLES), np.sin(ANGLES)], 1)
    centre, radius = px.copy(), np.full(len(px), look.radius_px)
    for _ in range(2):  # the second round's rays start from the first one's centre
        rim, used = _rims(luma, centre, radii, look.radius_px)
        at = centre[:, None] + rim[..., None] * ray
        for _ in range(PASSES):
            out = at - centre[:, None]
            r = np.maximum(np.hypot(*out.transpose(2, 0, 1)), 1e-6)
            off = r - radius[:, None]
            weight = used / np.maximum(1.0, np.abs(off) / HUBER_PX)
            J = np.concatenate([out / r[..., None], np.ones((*r.shape, 1))], -1)
            A = np.einsum("nai,na,naj->nij", J, weight, J) + 1e-6 * np.eye(3)
            step = np.linalg.solve(A, np.einsum("nai,na->ni", J, weight * off)[..., None])[..., 0]
            centre, radius = centre + np.clip(step[:, :2], -1, 1), radius + np.clip(step[:, 2], -1, 1)
    near = used & (np.abs(off) < 3 * HUBER_PX)
    count = np.maximum(near.sum(1), 1)
    scatter = np.maximum((near * off**2).sum(1) / count, 0.05**2)
    return centre, np.linalg.inv(A)[:, :2, :2] * scatter[:, None, None], near.mean(1)


def _rims(
    luma: np.ndarray, centre: np.ndarray, radii: np.ndarray, radius: float
) -> tuple[Float[np.ndarray, "n angle"], np.ndarray]:
    """How far out the rim is on each ray [px], and whether it was found."""
    rays = radial_profile(luma, centre, radii)
    inner = np.median(rays[..., radii < 0.7 * radius].reshape(len(centre), -1), axis=1)
    outer = np.median(rays[..., (radii > 1.2 * radius) & (radii < 1.5 * radius)], axis=2)
    contrast = outer - inner[:, None]
    level = np.where(np.abs(contrast) > 1, contrast, 1)
    rise = (rays - inner[:, None, None]) / level[..., None]
    past = rise > 0.5
    past[..., 0] = False
    k = past.argmax(2)
    found = (k > 0) & (np.abs(contrast) > LEAST_CONTRAST)
    k = np.maximum(k, 1)
    high, low = (np.take_along_axis(rise, j[..., None], 2)[..., 0] for j in (k, k - 1))
    share = np.clip((0.5 - low) / np.where(high - low > 1e-3, high - low, 1), 0, 1)
    return radii[k - 1] + STEP_PX * share, found
