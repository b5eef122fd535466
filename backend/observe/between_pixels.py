"""Light between the pixels of a picture, at any number of points."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float

WIDE = 1024  # OpenCV's remap takes no row or column of points longer than 32766


def light_at(
    luma: np.ndarray, u: Float[np.ndarray, "*n"], v: Float[np.ndarray, "*n"], how: int = cv2.INTER_LINEAR
) -> Float[np.ndarray, "*n"]:
    """Codes at points (u, v) [px], beyond the edge those of the edge.  how: cv2.INTER_LINEAR or cv2.INTER_CUBIC."""
    count, fill = u.size, -u.size % WIDE
    across, down = (np.pad(k.ravel().astype(np.float32), (0, fill)).reshape(-1, WIDE) for k in (u, v))
    seen = cv2.remap(luma, across, down, how, borderMode=cv2.BORDER_REPLICATE)
    return seen.ravel()[:count].reshape(u.shape).astype(float)
