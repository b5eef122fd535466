"""Which of a sensor's rows shows a pixel: they are read one after another, also of a clip that is shown turned.

A phone held upright still reads the rows of its sensor, which are then columns of the picture.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class Rows:
    """size_px: of the upright picture.  quarter_turns: by which it was turned to the left to be upright."""

    size_px: tuple[int, int]
    quarter_turns: int = 0

    def share(self, px: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n"]:
        """Where among the rows upright pixels were read: 0 first, 1 last."""
        axis = 1 - self.quarter_turns % 2
        share = px[..., axis] / (self.size_px[axis] - 1)
        return 1 - share if self.quarter_turns % 4 >= 2 else share
