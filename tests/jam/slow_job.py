"""Chunks that take their time and keep a diary of who began them: what a scheduler of real ones is tested with."""

import os
import time
from dataclasses import dataclass
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from backend.jam.batch import Verdicts


@dataclass(frozen=True)
class SlowJob:
    diary: str
    chunk: int
    takes_s: float

    def ask(self, samples: np.ndarray) -> Verdicts:
        """Jammed above 0.5.  Rests where numbers are float64, as they must be on a worker too."""
        with Path(self.diary).open("a") as diary:
            diary.write(f"{os.getpid()} {samples[0, 0]:.17g}\n")
        time.sleep(self.takes_s)
        exact = np.full(len(samples), jnp.zeros(()).dtype == jnp.float64)
        return Verdicts(samples[:, 0] > 0.5, exact, samples[:, 0], np.zeros(len(samples), dtype=bool))
